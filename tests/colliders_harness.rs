//! Soft bodies and Rapier's world without a window, for the tests of colliders.
#![allow(dead_code, reason = "each test uses a part of it")]

use std::time::Duration;

use bevy::prelude::*;
use polpo::{Particles, PolpoPlugin, SoftBody};
use polpo_rapier::{PolpoRapierPlugin, RapierWorld};
use polpo_rig::{MeshHash, Particle, Rig};
use rapier3d::geometry::{Array2, ColliderBuilder};
use rapier3d::math::Vector;

pub(crate) const DT: f32 = 1.0 / 60.0;

/// A world that is stepped by hand, 60 times a second unless told otherwise.
pub(crate) struct Lab {
    pub app: App,
    pub dt: f32,
}

impl Lab {
    pub(crate) fn new() -> Self {
        let mut app = App::new();
        app.add_plugins((MinimalPlugins, PolpoPlugin::default(), PolpoRapierPlugin::default()));
        app.finish();
        app.cleanup();
        Self { app, dt: DT }
    }

    pub(crate) fn rapier(&mut self) -> Mut<'_, RapierWorld> {
        self.app.world_mut().resource_mut::<RapierWorld>()
    }

    /// A body of `particles` moving at `velocity`.
    pub(crate) fn spawn(&mut self, rig: Rig, at: Vec3, velocity: Vec3) -> Entity {
        self.spawn_with(rig, Transform::from_translation(at), velocity, ())
    }

    pub(crate) fn spawn_with(&mut self, rig: Rig, at: Transform, velocity: Vec3, extra: impl Bundle) -> Entity {
        let world = self.app.world_mut();
        let body = world.spawn((SoftBody::new(rig), at, extra)).id();
        world.flush();
        let mut particles = world.get_mut::<Particles>(body).expect("the rig is sound");
        for v in &mut particles.velocity {
            *v = velocity.into();
        }
        body
    }

    pub(crate) fn step(&mut self) {
        let dt = self.dt;
        let world = self.app.world_mut();
        world.resource_mut::<Time>().advance_by(Duration::from_secs_f32(dt));
        world.run_schedule(FixedPostUpdate);
    }

    pub(crate) fn steps(&mut self, n: usize) {
        for _ in 0..n {
            self.step();
        }
    }

    pub(crate) fn particles(&self, body: Entity) -> &Particles {
        self.app.world().get::<Particles>(body).expect("a body")
    }

    pub(crate) fn origin(&self, body: Entity) -> Vec3 {
        self.app.world().get::<Transform>(body).expect("a body").translation
    }

    /// Centre of particle `i` in the world.
    pub(crate) fn center(&self, body: Entity, i: usize) -> Vec3 {
        self.origin(body) + Vec3::from(self.particles(body).position[i])
    }

    pub(crate) fn velocity(&self, body: Entity, i: usize) -> Vec3 {
        self.particles(body).velocity[i].into()
    }

    /// How far particle `i` reaches down.
    pub(crate) fn reach_down(&self, body: Entity, i: usize) -> f32 {
        self.particles(body).ellipsoid(i).support(Vec3A::NEG_Y).0
    }

    /// Lowest centre of the body.
    pub(crate) fn lowest(&self, body: Entity) -> f32 {
        (0..self.particles(body).len()).map(|i| self.center(body, i).y).fold(f32::INFINITY, f32::min)
    }

    pub(crate) fn penetration(&self, body: Entity) -> f32 {
        let rapier = self.app.world().resource::<RapierWorld>();
        polpo_rapier::penetration(self.particles(body), self.origin(body), &rapier.bodies, &rapier.colliders)
    }
}

pub(crate) fn particle(position: Vec3, radii: Vec3) -> Particle {
    Particle { position, frame: Quat::IDENTITY, radii, mass: 1.0 }
}

/// One particle alone.
pub(crate) fn single(radii: Vec3) -> Rig {
    Rig { mesh_hash: MeshHash(0), particles: vec![particle(Vec3::ZERO, radii)], edges: vec![], ..Rig::default() }
}

pub(crate) fn ball() -> Rig {
    single(Vec3::splat(0.1))
}

/// Four times as long as wide, lying along z.
pub(crate) fn long() -> Rig {
    single(Vec3::new(0.05, 0.05, 0.2))
}

/// `n`³ balls 0.2 m apart with radius 0.1 m, joined along edges and diagonals.
pub(crate) fn lattice(n: usize) -> Rig {
    let mut particles = Vec::new();
    for i in 0..n * n * n {
        let cell = Vec3::new((i % n) as f32, (i / n % n) as f32, (i / n / n) as f32);
        particles.push(particle((cell - Vec3::splat(0.5 * (n - 1) as f32)) * 0.2, Vec3::splat(0.1)));
    }
    let mut edges = Vec::new();
    for a in 0..particles.len() {
        for b in a + 1..particles.len() {
            if particles[a].position.distance(particles[b].position) < 0.36 {
                edges.push([a as u32, b as u32]);
            }
        }
    }
    Rig { mesh_hash: MeshHash(0), particles, edges, ..Rig::default() }
}

/// `n` balls of radius 0.1 m in a row along x, each joined to the next and the one after.
pub(crate) fn chain(n: usize) -> Rig {
    let particles = (0..n).map(|i| particle(Vec3::X * (0.2 * i as f32), Vec3::splat(0.1))).collect();
    let edges = (0..n).flat_map(|i| (i + 1..n.min(i + 3)).map(move |j| [i as u32, j as u32])).collect();
    Rig { mesh_hash: MeshHash(0), particles, edges, ..Rig::default() }
}

/// A floor at height 0 from `−half` to `half`, `n` squares of two triangles each a side, shifted so that seams do not fall on the axes.
pub(crate) fn flat_mesh(half: f32, n: usize) -> ColliderBuilder {
    let at = |i: usize| half * (2.0 * i as f32 / n as f32 - 1.0) + if n > 2 { 0.013 } else { 0.0 };
    let mut points = Vec::new();
    for z in 0..=n {
        for x in 0..=n {
            points.push(Vector::new(at(x), 0.0, at(z)));
        }
    }
    let mut triangles = Vec::new();
    for z in 0..n {
        for x in 0..n {
            let [a, b, c, d] = [(x, z), (x + 1, z), (x, z + 1), (x + 1, z + 1)].map(|(x, z)| (z * (n + 1) + x) as u32);
            triangles.extend([[a, c, b], [b, c, d]]);
        }
    }
    ColliderBuilder::trimesh(points, triangles).expect("a sound mesh")
}

/// A height field of `n` by `n` cells and size `size`, height `height(x, z)`.
pub(crate) fn ground(size: f32, n: usize, height: impl Fn(f32, f32) -> f32) -> ColliderBuilder {
    let at = |i: usize| size * (i as f32 / n as f32 - 0.5);
    let mut heights = Array2::zeros(n + 1, n + 1);
    for row in 0..=n {
        for column in 0..=n {
            heights[(row, column)] = height(at(column), at(row));
        }
    }
    ColliderBuilder::heightfield(heights, Vector::new(size, 1.0, size))
}
