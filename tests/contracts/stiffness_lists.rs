//! Stiffness particle by particle and edge by edge, in hertz or as the paper's bare share: each swings as it was told, in the whole step of the plugin.

use core::f32::consts::TAU;

use bevy::math::Vec3A;
use bevy::prelude::*;
use bevy::time::TimeUpdateStrategy;
use polpo::prelude::*;
use polpo::{EdgeStiffness, ParticleStiffness, Particles};
use polpo_rig::{MeshHash, Particle, Rig};

const RATE: f32 = 240.0;

/// Three pairs of particles side by side, each joined by an edge, stretched by 1 cm and twisted by 0.1 rad. Nothing holds them but what the test adds.
fn three_pairs() -> (App, Entity) {
    let particle = |x: f32, y: f32| Particle { position: Vec3::new(x, y, 0.0), frame: Quat::IDENTITY, radii: Vec3::splat(0.05), mass: 1.0 };
    let rig = Rig {
        mesh_hash: MeshHash(0),
        particles: (0..6).map(|i| particle(0.1 * (i % 2) as f32, (i / 2) as f32)).collect(),
        edges: vec![[0, 1], [2, 3], [4, 5]],
        ..Rig::default()
    };
    let mut app = App::new();
    app.add_plugins((MinimalPlugins, PolpoPlugin::default()))
        .insert_resource(TimeUpdateStrategy::FixedTimesteps(1))
        .insert_resource(Time::<Fixed>::from_hz(f64::from(RATE)))
        .insert_resource(SolverSettings { substeps: 1, iterations: 1, ..default() })
        .insert_resource(Gravity(Vec3::ZERO));
    app.finish();
    let body = app.world_mut().spawn(SoftBody::new(rig)).id();
    app.world_mut().entity_mut(body).remove::<(ShapeMatching, DistanceConstraints, Torsion, Damping, KeepMomentum)>();
    let mut particles = app.world_mut().get_mut::<Particles>(body).unwrap();
    for i in [1, 3, 5] {
        particles.position[i] += Vec3A::X * 0.01;
        particles.rotation[i] = Quat::from_rotation_x(0.1);
    }
    (app, body)
}

/// At what the three pairs' errors swing in the next two seconds \[Hz\]; 0 for one that never changes sign.
fn frequencies(app: &mut App, body: Entity, error: impl Fn(&Particles, usize) -> f32) -> [f32; 3] {
    let mut crossings: [Vec<f32>; 3] = Default::default();
    let errors = |app: &App| [0, 2, 4].map(|i| error(app.world().get::<Particles>(body).unwrap(), i));
    let mut last = errors(app);
    for step in 0..(2.0 * RATE) as usize {
        app.update();
        let now = errors(app);
        for k in 0..3 {
            if last[k] * now[k] < 0.0 {
                crossings[k].push((step as f32 + last[k] / (last[k] - now[k])) / RATE);
            }
        }
        last = now;
    }
    crossings.map(|times| if times.len() < 2 { 0.0 } else { 0.5 * (times.len() - 1) as f32 / (times[times.len() - 1] - times[0]) })
}

fn stretch(p: &Particles, i: usize) -> f32 {
    p.position[i].distance(p.position[i + 1]) - 0.1
}

fn twist(p: &Particles, i: usize) -> f32 {
    polpo_solver::quat_log(p.rotation[i + 1] * p.rotation[i].inverse()).x
}

/// The errors die out as implicit Euler lets them, and swing at atan(ω₀Δt)/(2πΔt); crossings are found to a thousandth.
fn check(got: [f32; 3], asked: [f32; 3]) {
    for (got, asked) in got.into_iter().zip(asked) {
        let expected = (TAU * asked / RATE).atan() * RATE / TAU;
        assert!((got - expected).abs() <= 2e-3 * expected, "{got} Hz for {asked} Hz");
    }
}

#[test]
fn every_edge_swings_as_it_was_told() {
    let hertz = |list: [f32; 3]| Some(list.map(Stiffness::hertz).to_vec());
    let (mut app, body) = three_pairs();
    let each = EdgeStiffness::new(hertz([2.0, 3.0, 5.0]), hertz([2.0, 3.0, 5.0]), None);
    app.world_mut().entity_mut(body).insert((DistanceConstraints::new(Stiffness::RIGID), each));
    check(frequencies(&mut app, body, stretch), [2.0, 3.0, 5.0]);

    let (mut app, body) = three_pairs();
    app.world_mut().entity_mut(body).insert((Torsion::new(Stiffness::RIGID), EdgeStiffness::new(None, None, hertz([4.0, 0.0, 1.5]))));
    check(frequencies(&mut app, body, twist), [4.0, 0.0, 1.5]);
}

#[test]
fn every_group_swings_as_it_was_told_also_after_a_change() {
    let (mut app, body) = three_pairs();
    // One group a pair: each particle has one, and its partner's would pull as well.
    let list = |first: f32, third: f32| [first, 0.0, 0.0, 0.0, third].map(Stiffness::hertz).to_vec();
    app.world_mut().entity_mut(body).insert((ShapeMatching::new(Stiffness::RIGID), ParticleStiffness::new(list(3.0, 2.0))));
    check(frequencies(&mut app, body, stretch), [3.0, 0.0, 2.0]);
    *app.world_mut().get_mut::<ParticleStiffness>(body).unwrap().get_mut() = list(1.5, 0.0);
    let got = frequencies(&mut app, body, stretch);
    check([got[0], 0.0, 0.0], [1.5, 0.0, 0.0]);
}

/// A bare share s swings at asin(√s)/(2πΔt): at another frequency at every time step.
#[test]
fn a_bare_share_is_the_papers() {
    let (mut app, body) = three_pairs();
    let shares = [0.001f32, 0.004, 0.01];
    let list = Some(shares.map(Stiffness::Fraction).to_vec());
    app.world_mut().entity_mut(body).insert((DistanceConstraints::default(), EdgeStiffness::new(list.clone(), list, None)));
    let got = frequencies(&mut app, body, stretch);
    for (got, share) in got.into_iter().zip(shares) {
        let expected = share.sqrt().asin() * RATE / TAU;
        assert!((got - expected).abs() < 2e-3 * expected, "{got} Hz for the share {share}, not {expected}");
    }
}

/// Under tension it holds, pushed it gives way.
#[test]
fn a_rope_does_not_push() {
    let (mut app, body) = three_pairs();
    let rope = DistanceConstraints { tension: Stiffness::hertz(3.0), compression: Stiffness::OFF };
    app.world_mut().entity_mut(body).insert(rope);
    // A quarter of a swing brings each pair to its length, and nothing stops it there.
    for _ in 0..(0.2 * RATE) as usize {
        app.update();
    }
    let p = app.world().get::<Particles>(body).unwrap();
    let (length, closing) = (stretch(p, 0), p.velocity[0].x - p.velocity[1].x);
    assert!(length < -0.005 && closing > 0.1, "{length} m, {closing} m/s");
    app.update();
    let p = app.world().get::<Particles>(body).unwrap();
    assert_eq!(p.velocity[0].x - p.velocity[1].x, closing);
}
