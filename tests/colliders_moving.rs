//! Colliders that move, come, go, or do not count.

#[path = "colliders_harness.rs"]
mod harness;

use bevy::math::Vec3A;
use bevy::prelude::*;
use harness::*;
use polpo::{Collision, Particles};
use polpo_rapier::{ContactDetector, DetectionInput, Obstacles};
use polpo_solver::ParticleRest;
use rapier3d::prelude::*;

const FLOOR: f32 = -0.5;

fn floor() -> ColliderBuilder {
    ColliderBuilder::cuboid(20.0, 0.5, 20.0).translation(Vec3::Y * FLOOR).friction(0.6)
}

fn turned(angle: f32) -> Rotation {
    Rotation::from_axis_angle(Vec3::Y, angle)
}

/// A body on a turntable goes round with it, at the turntable's speed, whichever shape it has and however it is driven.
#[test]
fn a_turntable_carries_a_body_along() {
    let spin = 1.5f32;
    for (shape, by_velocity) in
        [(SharedShape::cylinder(0.2, 2.0), true), (SharedShape::cylinder(0.2, 2.0), false), (SharedShape::cuboid(2.0, 0.2, 2.0), false)]
    {
        let mut lab = Lab::new();
        let table = {
            let mut rapier = lab.rapier();
            let rapier = &mut *rapier;
            let body = if by_velocity {
                RigidBodyBuilder::kinematic_velocity_based().angvel(Vec3::Y * spin)
            } else {
                RigidBodyBuilder::kinematic_position_based()
            };
            let table = rapier.bodies.insert(body.translation(Vec3::Y * -0.2));
            rapier.colliders.insert_with_parent(ColliderBuilder::new(shape).friction(1.0), table, &mut rapier.bodies);
            table
        };
        let body = lab.spawn(lattice(2), Vec3::new(1.0, 0.2, 0.0), Vec3::ZERO);
        // From rest it would tip over: friction is stronger than half its width over its height.
        let mut particles = lab.app.world_mut().get_mut::<Particles>(body).unwrap();
        particles.set_rigid_velocity(Vec3A::NEG_Z * spin, Vec3A::Y * spin);
        for k in 0..300 {
            if !by_velocity {
                lab.rapier().bodies[table].set_next_kinematic_rotation(turned(spin * DT * (k + 1) as f32));
            }
            lab.step();
        }
        let at = lab.origin(body);
        let n = lab.particles(body).len();
        let velocity = (0..n).map(|i| lab.velocity(body, i)).sum::<Vec3>() / n as f32;
        let expected = (Vec3::Y * spin).cross(at);
        println!("at radius {:.3} m: {velocity} against {expected}", at.xz().length());
        assert!((velocity - expected).length() < 0.02 * expected.length(), "{velocity} against {expected}");
        assert!((at.xz().length() - 1.0).abs() < 0.01, "slid out to {at}");
    }
}

/// A wheel that spins under a ball that cannot stick to it leaves it where it is: its material goes round, its shape does not move.
#[test]
fn a_spinning_wheel_does_not_shake_what_slides_on_it() {
    let mut lab = Lab::new();
    {
        let mut rapier = lab.rapier();
        let rapier = &mut *rapier;
        let wheel = rapier.bodies.insert(RigidBodyBuilder::kinematic_velocity_based().translation(Vec3::NEG_Y).angvel(Vec3::Z * 20.0));
        let drum = ColliderBuilder::cylinder(1.0, 1.0).rotation(Vec3::X * std::f32::consts::FRAC_PI_2).friction(0.0);
        let drum = drum.friction_combine_rule(CoefficientCombineRule::Min);
        rapier.colliders.insert_with_parent(drum, wheel, &mut rapier.bodies);
    }
    let body = lab.spawn(ball(), Vec3::Y * 0.1, Vec3::ZERO);
    let mut highest = 0.0f32;
    for _ in 0..60 {
        lab.step();
        highest = highest.max((lab.center(body, 0) - Vec3::Y * 0.1).length());
    }
    assert!(highest < 2e-3, "moved by {highest} m");
}

#[test]
fn a_bar_sweeps_a_body_away() {
    for speed in [1.0, 6.0] {
        let mut lab = Lab::new();
        let bar = {
            let mut rapier = lab.rapier();
            let rapier = &mut *rapier;
            rapier.insert_fixed(floor());
            let bar = rapier.bodies.insert(RigidBodyBuilder::kinematic_position_based().translation(Vec3::new(-1.5, 0.3, 0.0)));
            rapier.colliders.insert_with_parent(ColliderBuilder::cuboid(0.05, 0.2, 2.0), bar, &mut rapier.bodies);
            bar
        };
        let body = lab.spawn(lattice(2), Vec3::Y * 0.21, Vec3::ZERO);
        let mut x = -1.5;
        let mut deepest = 0.0f32;
        for _ in 0..(3.0 / (speed * DT)) as usize {
            x += speed * DT;
            lab.rapier().bodies[bar].set_next_kinematic_translation(Vec3::new(x, 0.3, 0.0));
            lab.step();
            deepest = deepest.max(lab.penetration(body));
        }
        let behind = (0..8).map(|i| lab.center(body, i).x).fold(f32::INFINITY, f32::min);
        println!("{speed} m/s: bar at {x:.3}, body from {behind:.3}, at most {deepest:.1e} m deep");
        assert!(behind > x + 0.05 + 0.099, "the bar at {x} left a particle at {behind}");
        assert!(deepest < 0.01, "{deepest}");
    }
}

#[test]
fn layers_and_sensors_filter() {
    let layer = |memberships: u32, filter: u32| {
        InteractionGroups::new(Group::from_bits_truncate(memberships), Group::from_bits_truncate(filter), InteractionTestMode::And)
    };
    let skin = |memberships, filter| Collision { memberships, filter, ..Default::default() };
    let held = |collider: ColliderBuilder, skin: Collision| {
        let mut lab = Lab::new();
        lab.rapier().insert_fixed(collider);
        let body = lab.spawn_with(ball(), Transform::from_xyz(0.0, 0.2, 0.0), Vec3::ZERO, skin);
        lab.steps(60);
        lab.center(body, 0).y > 0.0
    };
    assert!(held(floor(), skin(1, u32::MAX)));
    assert!(!held(floor().sensor(true), skin(1, u32::MAX)));
    assert!(!held(floor().enabled(false), skin(1, u32::MAX)));
    assert!(held(floor().collision_groups(layer(2, 4)), skin(4, 2)));
    assert!(!held(floor().collision_groups(layer(2, 4)), skin(1, 2)));
    assert!(!held(floor().collision_groups(layer(2, 4)), skin(4, 8)));
    assert!(!held(floor().solver_groups(layer(2, 4)), skin(1, u32::MAX)));
}

#[test]
fn colliders_that_come_move_and_go_count_at_once() {
    let mut lab = Lab::new();
    let body = lab.spawn(ball(), Vec3::Y * 0.1, Vec3::ZERO);
    let handle = lab.rapier().insert_fixed(floor());
    lab.steps(30);
    assert!((lab.center(body, 0).y - 0.1).abs() < 1e-3, "inserted: {}", lab.center(body, 0));
    // A body with a fixed parent, moved by its parent: the collider's own pose is stale until Rapier steps.
    lab.rapier().remove_collider(handle).unwrap();
    lab.step();
    assert!(lab.velocity(body, 0).y < -0.1, "removed: {}", lab.velocity(body, 0));
    let parent = {
        let mut rapier = lab.rapier();
        let rapier = &mut *rapier;
        let parent = rapier.bodies.insert(RigidBodyBuilder::fixed().translation(Vec3::Y * -100.0));
        rapier.colliders.insert_with_parent(floor(), parent, &mut rapier.bodies);
        parent
    };
    lab.step();
    let here = lab.center(body, 0).y;
    lab.rapier().bodies[parent].set_translation(Vec3::Y * (here - 0.1), true);
    lab.steps(30);
    assert!((lab.center(body, 0).y - here).abs() < 1e-3, "moved: {} against {here}", lab.center(body, 0).y);
    assert!(lab.velocity(body, 0).length() < 1e-2);
    assert!(lab.rapier().remove_body(parent));
    lab.steps(30);
    assert!(lab.center(body, 0).y < here - 1.0);
}

/// A dynamic rigid body that falls on a soft one stays above it as long as nothing pushes back; the soft one is pressed out of it.
#[test]
fn a_dynamic_body_is_seen_with_its_velocity() {
    let mut lab = Lab::new();
    {
        let mut rapier = lab.rapier();
        let rapier = &mut *rapier;
        let ram = rapier
            .bodies
            .insert(RigidBodyBuilder::dynamic().translation(Vec3::new(-1.0, 0.5, 0.0)).linvel(Vec3::X * 4.0).gravity_scale(0.0));
        rapier.colliders.insert_with_parent(ColliderBuilder::ball(0.3), ram, &mut rapier.bodies);
    }
    let body = lab.spawn_with(ball(), Transform::from_xyz(0.0, 0.5, 0.0), Vec3::ZERO, polpo::GravityScale(0.0));
    lab.steps(30);
    assert!((lab.velocity(body, 0).x - 4.0).abs() < 0.1, "{}", lab.velocity(body, 0));
}

/// A lift that goes down with what stands on it, when one step is a hundred times as long as the one before: where the lift was in the last step follows from the length of that, not of this. Else the particle would seem to have
/// come up through its floor.
#[test]
fn a_long_step_after_a_short_one_mistakes_no_side() {
    let (mut bodies, mut colliders) = (RigidBodySet::new(), ColliderSet::new());
    let lift = bodies.insert(RigidBodyBuilder::kinematic_velocity_based().linvel(Vec3::Y * -5.0));
    colliders.insert_with_parent(ColliderBuilder::cuboid(1.0, 0.02, 1.0), lift, &mut bodies);
    let ball = ParticleRest { position: Vec3::Y.into(), frame: Quat::IDENTITY, radii: Vec3::splat(0.05).into(), mass: 1.0 };
    let mut particles = polpo_solver::Particles::new(&[ball]).unwrap();
    particles.position[0] = (Vec3::Y * 0.07).into();
    particles.velocity[0] = (Vec3::Y * -5.0).into();
    let (mut obstacles, mut detector) = (Obstacles::default(), ContactDetector::default());
    let (mut free, mut contacts) = (polpo_solver::FreePositions::default(), polpo_solver::Contacts::default());
    for dt in [0.001, 0.001, 0.1] {
        obstacles.gather(&bodies, &colliders, dt);
        let input = DetectionInput {
            particles: &particles,
            origin: Vec3::ZERO,
            acceleration: Vec3::ZERO,
            dt,
            friction: 0.5,
            frictions: &[],
            memberships: u32::MAX,
            filter: u32::MAX,
        };
        detector.detect(&input, &obstacles, &colliders, &mut free, &mut contacts);
        assert!(!contacts.list.is_empty() && contacts.list.iter().all(|c| c.normal.y > 0.9), "{dt} s: {contacts:?}");
        let way = Vec3::Y * (-5.0 * dt);
        let at = bodies[lift].translation() + way;
        bodies[lift].set_translation(at, true);
        particles.position[0] += Vec3A::from(way);
    }
}

/// In the middle of a step the tip of a bar that turns fast is farther out than at either end of it.
#[test]
fn the_tip_of_a_fast_bar_sweeps_all_of_its_arc() {
    for (sense, small) in [(1.0f32, 0.003f32), (-1.0, 0.003), (1.0, 0.001)] {
        let mut lab = Lab::new();
        let turn = 20.0 * sense;
        {
            let mut rapier = lab.rapier();
            let rapier = &mut *rapier;
            // Half of the step's turn before the particle, and half after it.
            let start = Vec3::Y * (-0.5 * turn * DT);
            let body = RigidBodyBuilder::kinematic_velocity_based().angvel(Vec3::Y * turn).rotation(start);
            let bar = rapier.bodies.insert(body);
            rapier.colliders.insert_with_parent(ColliderBuilder::cuboid(1.0, 0.05, 0.005), bar, &mut rapier.bodies);
        }
        lab.app.insert_resource(polpo::Gravity(Vec3::ZERO));
        let body = lab.spawn(single(Vec3::splat(small)), Vec3::X * 0.994, Vec3::ZERO);
        lab.steps(2);
        let velocity = lab.velocity(body, 0);
        println!("{turn} rad/s, {small} m: {velocity}");
        assert!(velocity.z * -sense > 10.0, "{turn} rad/s, {small} m: {velocity}");
    }
}
