//! What is flat feels flat, corners hold, and neither depends on where in the world it is.

#[path = "colliders_harness.rs"]
mod harness;

use bevy::prelude::*;
use harness::*;
use polpo::{Collision, GravityScale, Particles};
use rapier3d::prelude::*;

/// Slides a particle over a floor at 5 m/s; the fastest it ever moves up or down [m/s].
fn bump(floor: Vec<ColliderBuilder>, rig: polpo_rig::Rig, friction: f32, offset: Vec3) -> f32 {
    let mut lab = Lab::new();
    for part in floor {
        lab.rapier().insert_fixed(part);
    }
    let height = rig.particles[0].radii.y;
    let skin = Collision { friction, ..Default::default() };
    let start = offset + Vec3::new(-8.0, height, 0.07);
    let body = lab.spawn_with(rig, Transform::from_translation(start), Vec3::X * 5.0, skin);
    let mut worst = 0.0f32;
    for _ in 0..180 {
        lab.step();
        worst = worst.max(lab.velocity(body, 0).y.abs());
    }
    let went = lab.center(body, 0).x - offset.x + 8.0;
    assert!(went > 8.0, "stopped after {went} m");
    worst
}

fn boxes(offset: Vec3) -> Vec<ColliderBuilder> {
    let builder = |i| ColliderBuilder::cuboid(0.5, 0.5, 2.0).translation(offset + Vec3::new(i as f32 - 9.5, -0.5, 0.0));
    (0..20).map(|i| builder(i).friction(0.0).friction_combine_rule(CoefficientCombineRule::Min)).collect()
}

fn slippery(builder: ColliderBuilder) -> Vec<ColliderBuilder> {
    vec![builder.friction(0.0).friction_combine_rule(CoefficientCombineRule::Min)]
}

#[test]
fn sliding_over_seams_feels_no_bump() {
    for (kind, rig) in [("ball", ball as fn() -> _), ("ellipsoid", long)] {
        for (name, floor) in [
            ("20 boxes", boxes(Vec3::ZERO)),
            ("triangles", slippery(flat_mesh(10.0, 37))),
            ("height field", slippery(ground(20.0, 37, |_, _| 0.0))),
        ] {
            let worst = bump(floor, rig(), 0.0, Vec3::ZERO);
            println!("{kind:9} over {name:12}: up or down at most {worst:.1e} m/s");
            assert!(worst < 1e-3, "{kind} over {name}: {worst} m/s");
        }
    }
    // Rolling, with friction.
    let worst = bump(vec![flat_mesh(10.0, 37).friction(0.6)], ball(), 0.6, Vec3::ZERO);
    assert!(worst < 1e-3, "rolling: {worst} m/s");
}

/// Floor and wall of one mesh both hold, also where triangles of both touch the particle.
#[test]
fn a_corner_in_one_mesh_holds_both_ways() {
    let points: Vec<Vec3> =
        [(-3.0, 0.0), (0.0, 0.0), (0.0, 3.0)].iter().flat_map(|&(x, y)| [Vec3::new(x, y, -3.0), Vec3::new(x, y, 3.0)]).collect();
    let mesh = ColliderBuilder::trimesh(points, vec![[0, 1, 3], [0, 3, 2], [2, 3, 5], [2, 5, 4]]).unwrap();
    for rig in [ball(), long(), lattice(3)] {
        let mut lab = Lab::new();
        lab.rapier().insert_fixed(mesh.clone());
        let body = lab.spawn(rig, Vec3::new(-0.8, 0.6, 0.1), Vec3::new(4.0, 0.0, 0.0));
        let mut deepest = 0.0f32;
        for _ in 0..120 {
            // Pressed into the corner.
            for v in &mut lab.app.world_mut().get_mut::<Particles>(body).unwrap().velocity {
                v.x += 20.0 * DT;
            }
            lab.step();
            deepest = deepest.max(lab.penetration(body));
        }
        let n = lab.particles(body).len();
        for i in 0..n {
            let at = lab.center(body, i);
            assert!(at.x < 0.0 && at.y > 0.0, "particle {i} got out of the corner to {at}");
        }
        println!("{n} particles: at most {deepest:.1e} m deep");
        assert!(deepest < 5e-3, "{deepest}");
    }
}

#[test]
fn ten_kilometres_out_is_like_home() {
    // Multiples of a float's step there, so that the world is the same, not a rounded one.
    for offset in [Vec3::new(8192.0, 0.0, -8192.0), Vec3::new(-9216.0, 2048.0, 10240.0)] {
        let worst = bump(boxes(offset), ball(), 0.0, offset);
        println!("20 boxes at {offset}: up or down at most {worst:.1e} m/s");
        assert!(worst < 1e-3, "{worst} m/s at {offset}");
        let rest = |offset: Vec3| {
            let mut lab = Lab::new();
            lab.rapier().insert_fixed(flat_mesh(4.0, 10).translation(offset));
            let body = lab.spawn(lattice(3), offset + Vec3::Y * 1.0, Vec3::ZERO);
            lab.steps(180);
            (0..27).map(|i| lab.center(body, i) - offset).collect::<Vec<_>>()
        };
        for (here, there) in rest(Vec3::ZERO).into_iter().zip(rest(offset)) {
            assert!(here.distance(there) < 5e-3, "{here} at home, {there} at {offset}");
        }
    }
}

/// A floor whose place in the world, ten kilometres up, no float can hold: the sum of its body's place and its own offset would be rounded by a quarter of a millimetre.
#[test]
fn an_offset_is_not_lost_far_out() {
    let high = 8192.0;
    let mut lab = Lab::new();
    {
        let mut rapier = lab.rapier();
        let rapier = &mut *rapier;
        let rock = rapier.bodies.insert(RigidBodyBuilder::fixed().translation(Vec3::Y * high));
        rapier.colliders.insert_with_parent(
            ColliderBuilder::cuboid(1.0, 0.5, 1.0).translation(Vec3::Y * -0.50025),
            rock,
            &mut rapier.bodies,
        );
    }
    let body = lab.spawn(ball(), Vec3::Y * (high + 0.125), Vec3::ZERO);
    lab.steps(120);
    let above = (lab.origin(body).y - high) + lab.particles(body).position[0].y;
    assert!((above - (0.1 - 0.00025)).abs() < 2e-5, "rests {above} m up");
}

#[test]
fn the_same_bits_twice() {
    let run = || {
        let mut lab = Lab::new();
        {
            let mut rapier = lab.rapier();
            let rapier = &mut *rapier;
            rapier.insert_fixed(ground(10.0, 40, |x, z| 0.1 * (x * 2.0).fract() + 0.05 * (z * 3.0).fract()));
            for part in boxes(Vec3::new(2.0, 0.2, 0.0)) {
                rapier.insert_fixed(part);
            }
            let spinner =
                rapier.bodies.insert(RigidBodyBuilder::kinematic_velocity_based().translation(Vec3::Y * 0.3).angvel(Vec3::Y * 3.0));
            rapier.colliders.insert_with_parent(ColliderBuilder::cuboid(1.5, 0.05, 0.05), spinner, &mut rapier.bodies);
        }
        let bodies: Vec<Entity> =
            (0..3).map(|k| lab.spawn(lattice(3), Vec3::new(k as f32 - 1.0, 1.0 + k as f32, 0.1), Vec3::new(0.0, -3.0, 1.0))).collect();
        lab.steps(240);
        let world = lab.app.world();
        polpo::state_hash(bodies.iter().map(|b| (world.get::<Transform>(*b).unwrap(), world.get::<Particles>(*b).unwrap())))
    };
    assert_eq!(run(), run());
}

/// A body of no weight that touches nothing costs no contact.
#[test]
fn a_body_far_from_everything_has_no_contacts() {
    let mut lab = Lab::new();
    lab.rapier().insert_fixed(ColliderBuilder::ball(1.0));
    let body = lab.spawn_with(lattice(3), Transform::from_xyz(0.0, 50.0, 0.0), Vec3::ZERO, GravityScale(0.0));
    lab.steps(3);
    assert!(lab.app.world().get::<polpo::Contacts>(body).unwrap().list.is_empty());
}
