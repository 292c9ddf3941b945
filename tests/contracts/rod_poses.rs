//! Rods follow the rest pose and inflation, however they are solved.

use bevy::prelude::*;
use polpo::prelude::*;
use polpo::{Inflation, Material, Particles, RestPose, RodShape, RodSolve, Rods, Section};
use polpo_rig::{MeshHash, Particle, Rig};
use polpo_solver::{momentum, quat_log};
use polpo_tests::{simulation, steps};

const COUNT: usize = 9;
const BOTH: [RodSolve; 2] = [RodSolve::Direct, RodSolve::Sweep { spin_radius: 0.1 }];

fn rope(app: &mut App, solve: RodSolve) -> Entity {
    let particle = |i| Particle { position: Vec3::X * (0.1 * i as f32), frame: Quat::IDENTITY, radii: Vec3::splat(0.02), mass: 1.0 };
    let edges = (1..COUNT as u32).map(|i| [i - 1, i]).collect();
    let rig = Rig { mesh_hash: MeshHash(0), particles: (0..COUNT).map(particle).collect(), edges, ..Rig::default() };
    let material = Material { youngs_modulus: 2e6, poissons_ratio: 0.4, density: 1000.0 };
    let rods = Rods { solve, ..Rods::new(material, Section::circle(0.02)) };
    app.insert_resource(Gravity(Vec3::ZERO)).insert_resource(SolverSettings { substeps: 12, iterations: 1, ..default() });
    let body = app.world_mut().spawn((SoftBody::new(rig), rods, Damping { drag: 0.0, internal: 6.0 })).id();
    app.world_mut().entity_mut(body).remove::<(Collision, BodyContact)>();
    body
}

/// A helix: each particle bent by 0.25 rad and twisted by 0.15 rad against the one before.
fn helix() -> RestPose {
    let mut pose = RestPose::default();
    let (mut place, mut turn) = (Vec3::ZERO, Quat::IDENTITY);
    let step = Quat::from_rotation_z(0.25) * Quat::from_rotation_x(0.15);
    for _ in 0..COUNT {
        pose.position.push(place);
        pose.rotation.push(turn);
        place += (turn.lerp(turn * step, 0.5)) * Vec3::X * 0.1;
        turn *= step;
    }
    pose
}

/// The largest differences from the pose, `size` times as large, in the distance of any two and in the turn of any neighbours against each other.
fn off(app: &App, body: Entity, pose: &RestPose, size: f32) -> [f32; 2] {
    let p = app.world().get::<Particles>(body).unwrap();
    let mut worst = [0.0f32; 2];
    for i in 0..COUNT {
        for j in 0..i {
            let wanted = size * pose.position[i].distance(pose.position[j]);
            worst[0] = worst[0].max((p.position[i].distance(p.position[j]) / wanted - 1.0).abs());
        }
        if i > 0 {
            let turn = p.rotation[i - 1].inverse() * p.rotation[i];
            let wanted = pose.rotation[i - 1].inverse() * pose.rotation[i];
            worst[1] = worst[1].max(quat_log(turn * wanted.inverse()).length());
        }
    }
    worst
}

#[test]
fn a_rod_comes_to_rest_in_its_rest_pose() {
    for solve in BOTH {
        let mut app = simulation();
        let body = rope(&mut app, solve);
        steps(&mut app, 2);
        let pose = helix();
        app.world_mut().entity_mut(body).insert(pose.clone());
        steps(&mut app, 600);
        let [length, turn] = off(&app, body, &pose, 1.0);
        println!("{solve:?}: lengths off by {length:.1e}, turns by {turn:.1e} rad");
        assert!(length < 1e-3 && turn < 2e-3, "{solve:?}: {length} {turn}");
        let m = momentum(app.world().get::<Particles>(body).unwrap());
        assert!(m.linear.length() < 1e-4 && m.angular.length() < 1e-4, "no muscle pulls from outside: {m:?}");
        // Rods that are made anew take the pose there is.
        let mut entity = app.world_mut().entity_mut(body);
        entity.get_mut::<Rods>().unwrap().material.youngs_modulus *= 2.0;
        steps(&mut app, 120);
        let [length, turn] = off(&app, body, &pose, 1.0);
        assert!(length < 1e-3 && turn < 2e-3, "{solve:?}, anew: {length} {turn}");
        // And without it they are straight again.
        app.world_mut().entity_mut(body).remove::<RestPose>();
        steps(&mut app, 600);
        let straight =
            RestPose { position: (0..COUNT).map(|i| Vec3::X * (0.1 * i as f32)).collect(), rotation: vec![Quat::IDENTITY; COUNT] };
        let [length, turn] = off(&app, body, &straight, 1.0);
        assert!(length < 1e-3 && turn < 2e-3, "{solve:?}, straight: {length} {turn}");
    }
}

#[test]
fn an_inflated_rod_is_longer() {
    for solve in BOTH {
        let mut app = simulation();
        let body = rope(&mut app, solve);
        steps(&mut app, 2);
        let length = |app: &App| {
            let p = app.world().get::<Particles>(body).unwrap();
            p.position[0].distance(p.position[COUNT - 1]) / (0.1 * (COUNT - 1) as f32)
        };
        for (inflation, wanted) in [(Some(1.2), 1.2), (Some(0.9), 0.9), (None, 1.0)] {
            match inflation {
                Some(scale) => app.world_mut().entity_mut(body).insert(Inflation::new(scale)),
                None => app.world_mut().entity_mut(body).remove::<Inflation>(),
            };
            steps(&mut app, 300);
            assert!((length(&app) - wanted).abs() < 1e-3, "{solve:?}: {} against {wanted}", length(&app));
        }
        // Bent and inflated at once.
        let pose = helix();
        app.world_mut().entity_mut(body).insert((pose.clone(), Inflation::new(1.2)));
        steps(&mut app, 600);
        let [length, turn] = off(&app, body, &pose, 1.2);
        assert!(length < 1e-3 && turn < 2e-3, "{solve:?}: {length} {turn}");
    }
}

/// Rods in the front half only: the paper's groups behind them and the rods strive for the same bend.
#[test]
fn rods_and_groups_share_a_pose() {
    for solve in BOTH {
        let mut app = simulation();
        let body = rope(&mut app, solve);
        let mut entity = app.world_mut().entity_mut(body);
        let mut rods = entity.get_mut::<Rods>().unwrap();
        rods.shape = RodShape::Section { section: Section::circle(0.02), edges: Some((0..4).collect()) };
        let pose = helix();
        app.world_mut().entity_mut(body).insert(pose.clone());
        steps(&mut app, 900);
        let [length, turn] = off(&app, body, &pose, 1.0);
        println!("{solve:?}: lengths off by {length:.1e}, turns by {turn:.1e} rad");
        assert!(length < 5e-3 && turn < 1e-2, "{solve:?}: {length} {turn}");
    }
}
