//! Bad rigs and transforms are refused with a reason that names the culprit; bad parameters freeze one body at worst. Nothing panics and the rest of the world goes on.

use bevy::prelude::*;
use polpo::prelude::*;
use polpo::{CapabilityRejected, Frozen, Particles, SelfPairs, SoftBodyRejected, SubstepTime};
use polpo_rig::Rig;
use polpo_tests::{lattice, simulation, steps};

#[derive(Resource, Default)]
struct Reasons(Vec<String>);

fn app() -> App {
    let mut app = simulation();
    app.init_resource::<Reasons>().add_observer(|rejected: On<SoftBodyRejected>, mut reasons: ResMut<Reasons>| {
        reasons.0.push(rejected.reason.to_string());
    });
    app
}

/// Where nearly everything overlaps at rest, self-contact has nothing to hold apart: it is refused, and the body goes on without it.
#[test]
fn self_contact_of_a_lump_is_refused_and_named() {
    let mut app = app();
    app.add_observer(|refused: On<CapabilityRejected>, mut reasons: ResMut<Reasons>| {
        reasons.0.push(format!("{}: {}", refused.component, refused.reason));
    });
    let mut lump = lattice(0.1);
    let one = lump.particles[0];
    lump.particles.resize(1200, one);
    let body = app.world_mut().spawn((SoftBody::new(lump), SelfContact::default())).id();
    steps(&mut app, 2);
    let reasons = &app.world().resource::<Reasons>().0;
    assert!(reasons.len() == 1 && reasons[0].starts_with("SelfContact: ") && reasons[0].contains("its 1200 particles"), "{reasons:?}");
    let entity = app.world().entity(body);
    assert!(entity.contains::<Particles>() && !entity.contains::<SelfContact>() && !entity.contains::<SelfPairs>());
}

#[test]
fn bad_rigs_are_refused_and_named() {
    let spoil: [(&str, fn(&mut Rig)); 7] = [
        ("particle 3", |rig| rig.particles[3].position.x = f32::NAN),
        ("particle 2", |rig| rig.particles[2].mass = 0.0),
        ("particle 1", |rig| rig.particles[1].radii.y = -1.0),
        ("particle 4", |rig| rig.particles[4].frame = Quat::from_xyzw(0.0, 0.0, 0.0, 0.0)),
        ("edge 5", |rig| rig.edges[5] = [0, 999]),
        ("edge 0", |rig| rig.edges[0] = [2, 2]),
        ("particle", |rig| rig.particles.clear()),
    ];
    for (culprit, spoil) in spoil {
        let mut app = app();
        let mut rig = lattice(0.1);
        spoil(&mut rig);
        let body = app.world_mut().spawn(SoftBody::new(rig)).id();
        let good = app.world_mut().spawn(SoftBody::new(lattice(0.1))).id();
        steps(&mut app, 3);
        let reasons = &app.world().resource::<Reasons>().0;
        assert_eq!(reasons.len(), 1, "{culprit}");
        assert!(reasons[0].contains(culprit), "{culprit}: {}", reasons[0]);
        assert!(app.world().get::<Particles>(body).is_none());
        assert!(app.world().get::<Particles>(good).is_some());
    }
}

#[test]
fn transforms_that_cannot_be_simulated_are_refused() {
    for transform in [
        Transform::from_xyz(f32::NAN, 0.0, 0.0),
        Transform::from_scale(Vec3::new(1.0, 2.0, 1.0)),
        Transform::from_scale(Vec3::ZERO),
        Transform::from_scale(Vec3::splat(-1.0)),
        Transform::from_rotation(Quat::from_xyzw(0.0, 0.0, 0.0, 0.0)),
        Transform::from_scale(Vec3::splat(1e30)),
    ] {
        let mut app = app();
        app.world_mut().spawn((SoftBody::new(lattice(0.1)), transform));
        steps(&mut app, 3);
        assert_eq!(app.world().resource::<Reasons>().0.len(), 1, "{transform:?}");
    }
}

#[test]
fn a_body_that_breaks_is_frozen_where_it_was_and_the_others_go_on() {
    let mut app = app();
    let broken = app.world_mut().spawn(SoftBody::new(lattice(0.1))).id();
    let other = app.world_mut().spawn((SoftBody::new(lattice(0.1)), Transform::from_xyz(5.0, 0.0, 0.0))).id();
    steps(&mut app, 10);
    let good = app.world().get::<Particles>(broken).unwrap().position.clone();
    app.world_mut().get_mut::<Particles>(broken).unwrap().velocity[7].y = f32::NAN;
    steps(&mut app, 1);
    assert!(app.world().get::<Frozen>(broken).is_some());
    let frozen = app.world().get::<Particles>(broken).unwrap();
    assert!(frozen.is_finite());
    assert_eq!(frozen.position, good);
    let height = app.world().get::<Transform>(other).unwrap().translation.y;
    steps(&mut app, 10);
    assert!(app.world().get::<Transform>(other).unwrap().translation.y < height - 0.1);
    // Thawed, it goes on from there.
    app.world_mut().entity_mut(broken).remove::<Frozen>();
    steps(&mut app, 2);
    assert!(app.world().get::<Frozen>(broken).is_none());
}

#[test]
fn nonsense_parameters_do_not_panic() {
    for value in [f32::NAN, -1.0, f32::INFINITY, 1e30, 0.0] {
        let mut app = app();
        app.insert_resource(SolverSettings { substeps: 0, iterations: 0, ..default() });
        let body = app
            .world_mut()
            .spawn((
                SoftBody::new(lattice(0.1)),
                ShapeMatching::new(Stiffness::damped(value, value)),
                DistanceConstraints { tension: Stiffness::damped(value, value), compression: Stiffness::Fraction(value) },
                Torsion::new(Stiffness::damped(value, value)),
                Damping { drag: value, internal: value },
                Grab { particle: 1_000_000, target: Vec3::splat(value), stiffness: Stiffness::hertz(value) },
                Collision { friction: value, push_speed: value, ..default() },
            ))
            .id();
        steps(&mut app, 5);
        assert!(app.world().get::<Particles>(body).unwrap().is_finite(), "{value}");
    }
    let mut app = app();
    app.insert_resource(Gravity(Vec3::splat(f32::NAN)));
    let body = app.world_mut().spawn(SoftBody::new(lattice(0.1))).id();
    steps(&mut app, 3);
    assert!(app.world().get::<Particles>(body).unwrap().is_finite());
    assert!(app.world().get::<Frozen>(body).is_none());
    assert_eq!(app.world().resource::<Gravity>(), &Gravity::default(), "what cannot be used is not taken");
}

/// A number that would hang the game counts as the most that there may be.
#[test]
fn too_many_substeps_and_iterations_are_cut() {
    let run = |substeps: u32, iterations: u32| {
        let mut app = simulation();
        app.insert_resource(SolverSettings { substeps, iterations, ..default() });
        app.world_mut().spawn(SoftBody::new(lattice(0.1)));
        steps(&mut app, 1);
        let mut bodies = app.world_mut().query::<&Particles>();
        let particles = bodies.single(app.world()).unwrap();
        (particles.position.clone(), app.world().resource::<SubstepTime>().iterations)
    };
    let most = run(10_000, 1);
    assert_ne!(run(9_000, 1), most);
    for substeps in [10_001, 20_000] {
        assert_eq!(run(substeps, 1), most, "{substeps}");
    }
    assert_eq!(run(1, 101).1, 100);
}
