//! Stiffness is a frequency: what one asks for is what one sees, at every time step.

use bevy::math::Vec3A;
use bevy::prelude::*;
use bevy::time::TimeUpdateStrategy;
use polpo::Particles;
use polpo::prelude::*;
use polpo_rig::{MeshHash, Particle, Rig};

/// Two particles on a spring of 3 Hz swing against each other at 3 Hz.
fn measured(rate: f64, substeps: u32) -> f32 {
    let particle = |x: f32, mass: f32| Particle { position: Vec3::X * x, frame: Quat::IDENTITY, radii: Vec3::splat(0.05), mass };
    let rig =
        Rig { mesh_hash: MeshHash(0), particles: vec![particle(0.0, 1.0), particle(0.5, 3.0)], edges: vec![[0, 1]], ..Rig::default() };
    let mut app = App::new();
    app.add_plugins((MinimalPlugins, PolpoPlugin::default()))
        .insert_resource(TimeUpdateStrategy::FixedTimesteps(1))
        .insert_resource(Time::<Fixed>::from_hz(rate))
        .insert_resource(SolverSettings { substeps, iterations: 1, ..default() })
        .insert_resource(Gravity(Vec3::ZERO));
    app.finish();
    let body = app.world_mut().spawn((SoftBody::new(rig), DistanceConstraints::new(Stiffness::hertz(3.0)))).id();
    app.world_mut().entity_mut(body).remove::<(ShapeMatching, Torsion, Damping)>();
    app.world_mut().get_mut::<Particles>(body).unwrap().position[1] += Vec3A::X * 0.05;
    let (mut crossings, mut last) = (Vec::new(), 0.05);
    for step in 0..(2.0 * rate) as usize {
        app.update();
        let p = app.world().get::<Particles>(body).unwrap();
        let stretch = p.position[0].distance(p.position[1]) - 0.5;
        if last * stretch < 0.0 {
            crossings.push((step as f32 + last / (last - stretch)) / rate as f32);
        }
        last = stretch;
    }
    0.5 * (crossings.len() - 1) as f32 / (crossings[crossings.len() - 1] - crossings[0])
}

#[test]
fn a_spring_swings_at_its_frequency_at_every_time_step() {
    for (rate, substeps, tolerance) in [(30.0, 5, 0.03), (60.0, 5, 0.01), (60.0, 20, 0.003), (240.0, 1, 0.01)] {
        let hertz = measured(rate, substeps);
        assert!((hertz / 3.0 - 1.0).abs() < tolerance, "{rate} Hz × {substeps}: {hertz} Hz");
    }
}
