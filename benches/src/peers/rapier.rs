//! Rapier's side: its soft bodies of the same mesh on the same floor, at its own settings but for the stiffness.

use std::collections::BTreeSet;

use bevy::math::Vec3;
use polpo_benches::headless::DROP;
use polpo_rig::{Mesh, Rig};
use rapier3d_peer::prelude::*;

use crate::ours::{SETTLE, STEP};
use crate::scene::Scene;
use crate::shape::{Shape, extent};

/// What Rapier makes a body of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    /// Tetrahedra that keep their volume, and springs along their edges: its jelly as it comes.
    Jelly,
    /// The springs alone.
    Springs,
    /// Each particle and those joined to it keep their shape: one shape-matched cluster a particle.
    Clusters,
}

/// How thick the skin is in which its contacts work.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Skin {
    /// As Rapier has it: half the mean edge of the surface.
    Usual,
    /// As thick as our particles are, on average, which spares it contacts.
    Thin,
}

/// How stiff a body is: natural frequency \[Hz\] and damping ratio of all that it is made of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Softness {
    pub(crate) frequency: f32,
    pub(crate) damping: f32,
}

/// A body as Rapier would be given it, before it is put somewhere.
pub(crate) struct Model {
    kind: Kind,
    builder: SoftBodyBuilder,
    clusters: Vec<Vec<u32>>,
    rest: f32,
    lowest: f32,
}

impl Model {
    /// `mesh` in tetrahedra with about as many particles as `rig`, the same mass together.
    pub(crate) fn new(mesh: &Mesh, rig: &Rig, kind: Kind, skin: Skin) -> Self {
        let mut builder = tetrahedra(mesh, rig.particles.len()).mass(rig.particles.iter().map(|p| p.mass).sum()).self_contacts(true);
        if skin == Skin::Thin {
            let radius = |p: &polpo_rig::Particle| (p.radii.x * p.radii.y * p.radii.z).cbrt();
            let mean = rig.particles.iter().map(radius).sum::<f32>() / rig.particles.len() as f32;
            builder = builder.particle_radius(mean);
        }
        let edges = edges(&builder.cells);
        let mut clusters = Vec::new();
        if kind != Kind::Jelly {
            builder.surface = boundary(&builder);
            builder.cells.clear();
        }
        match kind {
            Kind::Jelly => {}
            Kind::Springs => builder.edges = edges,
            Kind::Clusters => {
                clusters = (0..builder.positions.len() as u32).map(|i| vec![i]).collect();
                for [a, b] in edges {
                    clusters[a as usize].push(b);
                    clusters[b as usize].push(a);
                }
            }
        }
        let heights = || builder.positions.iter().map(|p| p.y);
        let (rest, lowest) = (extent(heights()), heights().fold(f32::INFINITY, f32::min) - builder.particle_radius);
        Self { kind, builder, clusters, rest, lowest }
    }

    /// How many particles it has.
    pub(crate) fn particles(&self) -> usize {
        self.builder.positions.len()
    }

    /// The softness at which one of it, lying on the floor, is as high as `wanted`, as nearly as any that comes to rest.
    pub(crate) fn soften(&self, wanted: Shape) -> Softness {
        /// \[Hz\]
        const FREQUENCIES: [f32; 11] = [5.0, 6.0, 7.0, 8.5, 10.0, 12.0, 14.0, 17.0, 20.0, 28.0, 40.0];
        const DAMPING: [f32; 2] = [1.0, 0.3];
        /// A body that is faster than this after two seconds does not rest \[m/s\].
        const RESTLESS: f32 = 0.5;
        // Clusters that are critically damped come to no rest.
        let damping = if self.kind == Kind::Clusters { &DAMPING[..] } else { &DAMPING[..1] };
        let tries = FREQUENCIES.into_iter().flat_map(|frequency| damping.iter().map(move |&damping| Softness { frequency, damping }));
        let fault = |&softness: &Softness| {
            let Shape { height, speed } = Theirs::new(self, softness, &Scene::apart(1)).settled().shape();
            let off = (height - wanted.height).abs();
            if off.is_finite() && speed < RESTLESS { off } else { f32::INFINITY }
        };
        let faults: Vec<(f32, Softness)> = tries.map(|softness| (fault(&softness), softness)).collect();
        faults.into_iter().min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, softness)| softness).expect("there are tries")
    }
}

/// Rapier's world and the soft bodies in it.
pub(crate) struct Theirs {
    world: PhysicsWorld,
    bodies: Vec<SoftBodyHandle>,
    rest: f32,
}

impl Theirs {
    /// Bodies of `model` where ours are, which do not sleep.
    pub(crate) fn new(model: &Model, softness: Softness, scene: &Scene) -> Self {
        let mut world = PhysicsWorld::new();
        world.integration_parameters.dt = STEP;
        for it in &scene.blocks {
            let ([x, y, z], center) = (it.half_extents.to_array(), Vector::from(it.center.to_array()));
            world.insert(RigidBodyBuilder::fixed(), ColliderBuilder::cuboid(x, y, z).translation(center));
        }
        let insert = |place: &Vec3| {
            let place = Vector::new(place.x, place.y + DROP - model.lowest, place.z);
            let material = SoftBodyMaterial::uniform(SpringCoefficients::new(softness.frequency, softness.damping));
            let body = world.insert_soft_body(model.builder.clone().translated(place).material(material).can_sleep(false));
            for particles in &model.clusters {
                if let Some(cluster) = world.add_soft_body_cluster(body, particles) {
                    world.soft_bodies[body].enable_cluster_shape_matching(cluster, true);
                }
            }
            body
        };
        let bodies = scene.places.iter().map(insert).collect();
        Self { world, bodies, rest: model.rest }
    }

    pub(crate) fn step(&mut self) {
        self.world.step();
    }

    /// Steps until bodies that were dropped lie.
    pub(crate) fn settled(mut self) -> Self {
        for _ in 0..SETTLE {
            self.step();
        }
        self
    }

    /// Where the highest particle of all is \[m\].
    pub(crate) fn top(&self) -> f32 {
        let heights = self.bodies.iter().flat_map(|&body| self.world.soft_bodies[body].particle_positions().map(|p| p.y));
        heights.fold(f32::NEG_INFINITY, f32::max)
    }

    pub(crate) fn shape(&self) -> Shape {
        Shape::mean(self.bodies.iter().map(|&body| {
            let body = &self.world.soft_bodies[body];
            let speeds = body.particle_velocities().map(|v| v.length_squared()).collect();
            (extent(body.particle_positions().map(|p| p.y)), self.rest, speeds)
        }))
    }
}

/// `mesh` filled with tetrahedra, in cells of the size whose number of particles is nearest to `count`.
fn tetrahedra(mesh: &Mesh, count: usize) -> SoftBodyBuilder {
    let vertices: Vec<Vector> = mesh.positions.iter().map(|p| Vector::new(p.x, p.y, p.z)).collect();
    let fill = |size| SoftBodyBuilder::volumetric(&vertices, &mesh.triangles, size).expect("the mesh is closed");
    let off = |builder: &SoftBodyBuilder| builder.positions.len().abs_diff(count);
    let mut size = 0.25 * extent(mesh.positions.iter().map(|p| p.y));
    let mut best = fill(size);
    loop {
        size *= 0.985;
        let next = fill(size);
        let enough = next.positions.len() > count * 5 / 4;
        if off(&next) < off(&best) {
            best = next;
        }
        if enough {
            return best;
        }
    }
}

/// The edges of tetrahedra, each once.
fn edges(cells: &[[u32; 4]]) -> Vec<[u32; 2]> {
    let mut edges = BTreeSet::new();
    for cell in cells {
        for (k, &a) in cell.iter().enumerate() {
            edges.extend(cell[k + 1..].iter().map(|&b| [a.min(b), a.max(b)]));
        }
    }
    edges.into_iter().collect()
}

/// The faces that only one of the tetrahedra has, as Rapier finds and orients them.
fn boundary(builder: &SoftBodyBuilder) -> Vec<[u32; 3]> {
    let mut world = PhysicsWorld::new();
    let body = world.insert_soft_body(builder.clone());
    world.soft_bodies[body].boundary().to_vec()
}
