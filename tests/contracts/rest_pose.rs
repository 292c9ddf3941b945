//! Muscles and inflation in the whole step.

use core::f32::consts::TAU;

use bevy::prelude::*;
use polpo::prelude::*;
use polpo::{CapabilityRejected, Frozen, ImplicitGroups, Inflation, Particles, Posed, RestPose};
use polpo_rig::{MeshHash, Particle, Rig};
use polpo_solver::momentum;
use polpo_tests::{lattice, simulation, steps};

/// Twelve flat ellipsoids, nose at x = 0, tail at x = −1.1.
fn fish() -> Rig {
    let particle = |i: u32| Particle {
        position: Vec3::NEG_X * (0.1 * i as f32),
        frame: Quat::IDENTITY,
        radii: Vec3::new(0.06, 0.03, 0.12),
        mass: 1.0,
    };
    Rig {
        mesh_hash: MeshHash(0),
        particles: (0..12).map(particle).collect(),
        edges: (1..12).map(|i| [i - 1, i]).collect(),
        ..Rig::default()
    }
}

/// A wave of curvature that grows towards the tail, at time `t` \[s\].
fn wave(t: f32) -> RestPose {
    let (mut angle, mut x, mut pose) = (0.0, Vec3::ZERO, RestPose::default());
    for i in 0..12 {
        let s = i as f32 / 11.0;
        angle += 0.1 * (1.0 + 2.0 * s) * (TAU * (s - t)).sin() * t.abs().min(1.0);
        pose.rotation.push(Quat::from_rotation_z(angle));
        pose.position.push(x);
        x -= pose.rotation[i] * Vec3::X * 0.1;
    }
    pose
}

/// How far it gets in ten seconds, the wave running towards the tail or the other way, in a medium of `density`, and what momentum it has then.
fn swim(direction: f32, density: f32) -> (f32, polpo_solver::Momentum) {
    let mut app = simulation();
    app.insert_resource(Gravity(Vec3::ZERO));
    let stiffness = Stiffness::damped(30.0, 1.0);
    let body = app
        .world_mut()
        .spawn((
            SoftBody::new(fish()),
            ShapeMatching::new(stiffness),
            DistanceConstraints::new(stiffness),
            Torsion::new(stiffness),
            AirDrag { density, coefficient: 1.0 },
        ))
        .id();
    app.world_mut().entity_mut(body).remove::<(Damping, Collision)>();
    let start = app.world().get::<Transform>(body).unwrap().translation.x;
    for k in 0..600 {
        app.world_mut().entity_mut(body).insert(wave(direction * k as f32 / 60.0));
        steps(&mut app, 1);
    }
    (app.world().get::<Transform>(body).unwrap().translation.x - start, momentum(app.world().get::<Particles>(body).unwrap()))
}

#[test]
fn a_fish_swims_by_its_muscles_and_only_in_water() {
    let ((ahead, _), (astern, _), (nowhere, m)) = (swim(1.0, 1000.0), swim(-1.0, 1000.0), swim(1.0, 0.0));
    println!("fish: {ahead} m ahead, {astern} m with the wave reversed, {nowhere} m without water; P {}, L {}", m.linear, m.angular);
    assert!(ahead > 0.5 && astern < -0.3);
    assert!(nowhere.abs() < 1e-4 && m.linear.length() < 1e-4 && m.angular.length() < 1e-4);
}

#[test]
fn a_body_is_inflated_and_shrinks_again() {
    let mut app = simulation();
    app.insert_resource(Gravity(Vec3::ZERO));
    let body = app.world_mut().spawn(SoftBody::new(lattice(0.1))).id();
    let size = |app: &App| {
        let p = app.world().get::<Particles>(body).unwrap();
        p.position[0].distance(p.position[26]) / (0.2 * 3f32.sqrt())
    };
    for (inflation, expected) in
        [(Some(Inflation::new(1.4)), 1.4), (Some(Inflation { scale: 0.5, each: vec![1.5; 27] }), 0.75), (None, 1.0)]
    {
        match inflation {
            Some(inflation) => app.world_mut().entity_mut(body).insert(inflation),
            None => app.world_mut().entity_mut(body).remove::<Inflation>(),
        };
        steps(&mut app, 240);
        assert!((size(&app) / expected - 1.0).abs() < 2e-3, "{} against {expected}", size(&app));
    }
    assert!(!app.world().entity(body).contains::<Posed>());
    // Groups that come later take the pose there is.
    app.world_mut().entity_mut(body).insert(Inflation::new(2.0)).remove::<ShapeMatching>();
    steps(&mut app, 1);
    app.world_mut().entity_mut(body).insert(ShapeMatching::default());
    steps(&mut app, 1);
    let groups = app.world().get::<ImplicitGroups>(body).unwrap();
    assert!((0..groups.len()).flat_map(|g| groups.rest(g)).map(|r| r.length()).fold(0.0, f32::max) > 0.25);
}

#[test]
fn bad_poses_are_refused_by_name() {
    #[derive(Resource, Default)]
    struct Told(Vec<String>);
    let mut app = simulation();
    app.init_resource::<Told>().add_observer(|event: On<CapabilityRejected>, mut told: ResMut<Told>| {
        told.0.push(format!("{}: {}", event.component, event.reason))
    });
    let body = app.world_mut().spawn(SoftBody::new(lattice(0.1))).id();
    app.world_mut().entity_mut(body).insert((RestPose { position: vec![Vec3::ZERO; 3], ..default() }, Inflation::new(-1.0)));
    steps(&mut app, 3);
    let told = &app.world().resource::<Told>().0;
    assert_eq!(*told, ["RestPose: there are 3 positions for 27 particles", "Inflation: particle 0: its size is not positive and normal"]);
    let entity = app.world().entity(body);
    assert!(!entity.contains::<RestPose>() && !entity.contains::<Inflation>() && !entity.contains::<Posed>());
    assert!(app.world().get::<Particles>(body).unwrap().is_finite());
}

/// What is asked of a frozen body is neither made from what froze it nor forgotten.
#[test]
fn a_pose_outlives_a_quarantine() {
    for scales in [[1.1, 1.5], [1.5, 1.5]] {
        let mut app = simulation();
        app.insert_resource(Gravity(Vec3::ZERO));
        let body = app.world_mut().spawn((SoftBody::new(lattice(0.1)), Inflation::new(scales[0]))).id();
        steps(&mut app, 3);
        let rest = app.world().get::<Particles>(body).unwrap().rest_position.clone();
        app.world_mut().get_mut::<Particles>(body).unwrap().rest_position[3].x = f32::NAN;
        steps(&mut app, 2);
        assert!(app.world().entity(body).contains::<Frozen>());
        app.world_mut().get_mut::<Inflation>(body).unwrap().scale = scales[1];
        steps(&mut app, 2);
        app.world_mut().get_mut::<Particles>(body).unwrap().rest_position = rest;
        app.world_mut().entity_mut(body).remove::<Frozen>();
        steps(&mut app, 300);
        assert!(!app.world().entity(body).contains::<Frozen>());
        let p = app.world().get::<Particles>(body).unwrap();
        let across = p.position[0].distance(p.position[2]);
        assert!((across - 0.3).abs() < 0.01, "{scales:?}: {across} m");
    }
}
