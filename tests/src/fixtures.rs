//! Bodies and worlds for the contract tests.

use bevy::prelude::*;
use bevy::time::TimeUpdateStrategy;
use polpo::{Particles, SoftBody, state_hash};
use polpo_rig::{MeshHash, Particle, Rig};
use polpo_scenes::SimulationPlugins;

use crate::Random;

/// A 3×3×3 lattice of balls of 10 g, `spacing` \[m\] apart, joined along its axes and face diagonals. It has no skin.
pub fn lattice(spacing: f32) -> Rig {
    balls(3, spacing, 0.01)
}

/// A cube of `n`³ balls that touch, of side `side` \[m\] and mass `mass` \[kg\] together, joined along axes and face diagonals. It has no skin.
pub fn cube(n: usize, side: f32, mass: f32) -> Rig {
    balls(n, side / n as f32, mass / (n * n * n) as f32)
}

/// A cube of `n`³ balls of 10 cm and 0.5 kg, a little out of their lattice, joined along axes and face diagonals. It has no skin. From 18³ on it is a large body, see [`Blocks`](polpo::Blocks).
pub fn shaken(n: usize) -> Rig {
    let (mut rig, mut random) = (balls(n, 0.1, 0.5), Random(42));
    for particle in &mut rig.particles {
        particle.position += 0.005 * random.vector();
    }
    rig
}

fn balls(n: usize, spacing: f32, mass: f32) -> Rig {
    let mut particles = Vec::new();
    for i in 0..n * n * n {
        let cell = Vec3::new((i % n) as f32, (i / n % n) as f32, (i / n / n) as f32) - Vec3::splat(0.5 * (n - 1) as f32);
        particles.push(Particle { position: cell * spacing, frame: Quat::IDENTITY, radii: Vec3::splat(0.5 * spacing), mass });
    }
    let mut edges = Vec::new();
    for i in 0..particles.len() {
        for j in i + 1..particles.len() {
            if particles[i].position.distance(particles[j].position) < 1.5 * spacing {
                edges.push([i as u32, j as u32]);
            }
        }
    }
    Rig { mesh_hash: MeshHash(0), particles, edges, ..Rig::default() }
}

/// Soft bodies and Rapier's colliders without a renderer, at 60 steps a second, one step an update.
pub fn simulation() -> App {
    simulation_at(60.0)
}

/// The same at `rate` steps a second.
pub fn simulation_at(rate: f64) -> App {
    let mut app = App::new();
    app.add_plugins((MinimalPlugins, SimulationPlugins)).insert_resource(TimeUpdateStrategy::FixedTimesteps(1)).insert_resource(Time::<
        Fixed,
    >::from_hz(
        rate
    ));
    app.finish();
    // The first update has no time in it.
    app.update();
    app
}

/// Takes `count` steps.
pub fn steps(app: &mut App, count: usize) {
    for _ in 0..count {
        app.update();
    }
}

/// The hash of all soft bodies.
pub fn state_of(world: &mut World) -> u64 {
    let mut bodies = world.query_filtered::<(&Transform, &Particles), With<SoftBody>>();
    state_hash(bodies.iter(world))
}
