//! A beam of about 300 particles, clamped at one end, that its own weight bends: the one of Rapier's own bench of its solvers, 2 m long and 0.2 m thick.

use bevy::prelude::*;
use polpo::prelude::*;
use polpo::{Material, Particles, Rods, Section};
use polpo_benches::headless::{RATE, Threads, app};
use polpo_rig::{MeshHash, Particle, Rig};
use rapier3d_peer::prelude as peer;

use crate::ours::STEP;

/// \[m\]
const LENGTH: f32 = 2.0;
const SIDE: f32 = 0.2;
/// \[kg\]
const MASS: f32 = 8.0;
/// \[Pa\]
const YOUNGS_MODULUS: f32 = 1.2e7;
const POISSONS_RATIO: f32 = 0.0;
/// Drag that brings it to rest \[1/s\].
const DRAG: f32 = 2.0;
/// Steps until it hangs still: 15 s.
const SETTLE: usize = (15.0 * RATE) as usize;
/// Steps over which its sag is averaged: 1 s.
const AVERAGE: usize = RATE as usize;

/// How far Timoshenko's beam hangs at its tip \[m\]: ρgA·L⁴/(8·EI) + ρg·L²/(2κG).
pub(crate) fn exact_sag() -> f32 {
    let section = Section::square(SIDE);
    let load = MASS / LENGTH * 9.81;
    let shear_modulus = YOUNGS_MODULUS / (2.0 * (1.0 + POISSONS_RATIO));
    load * LENGTH.powi(4) / (8.0 * YOUNGS_MODULUS * section.bending)
        + load * LENGTH * LENGTH / (2.0 * section.shear * shear_modulus * section.area)
}

/// Ours: calibrated edges in a row, solved directly in one substep.
pub(crate) struct OurBeam {
    app: App,
    body: Entity,
    start: f32,
}

impl OurBeam {
    const PARTICLES: u32 = 300;

    pub(crate) fn new() -> Self {
        let mut app = app(Threads::Of(1));
        app.insert_resource(SolverSettings { substeps: 1, ..default() });
        let particle = |i| Particle {
            position: Vec3::X * (LENGTH * i as f32 / (Self::PARTICLES - 1) as f32),
            frame: Quat::IDENTITY,
            radii: Vec3::splat(0.5 * SIDE),
            mass: MASS / Self::PARTICLES as f32,
        };
        let rig = Rig {
            mesh_hash: MeshHash(0),
            particles: (0..Self::PARTICLES).map(particle).collect(),
            edges: (1..Self::PARTICLES).map(|i| [i - 1, i]).collect(),
            ..Rig::default()
        };
        let section = Section::square(SIDE);
        let density = MASS / (LENGTH * section.area);
        let rods = Rods::new(Material { youngs_modulus: YOUNGS_MODULUS, poissons_ratio: POISSONS_RATIO, density }, section);
        let body = app.world_mut().spawn((SoftBody::new(rig), rods, Damping { drag: DRAG, internal: 0.0 })).id();
        let wall = place(&app, body, 0);
        let mut entity = app.world_mut().entity_mut(body);
        entity.remove::<Sleep>().insert(Pins { list: vec![Pin::at(0, wall).clamped()] });
        let start = place(&app, body, Self::PARTICLES as usize - 1).y;
        Self { app, body, start }
    }

    pub(crate) fn step(&mut self) {
        self.app.update();
    }

    fn sag(&self) -> f32 {
        self.start - place(&self.app, self.body, Self::PARTICLES as usize - 1).y
    }

    /// How far it hangs when it hangs still \[m\].
    pub(crate) fn settled_sag(&mut self) -> f32 {
        average(self, Self::step, Self::sag)
    }
}

fn place(app: &App, body: Entity, i: usize) -> Vec3 {
    let (at, particles) = (app.world().get::<Transform>(body), app.world().get::<Particles>(body));
    at.expect("a body is somewhere").translation + Vec3::from(particles.expect("a body has particles").position[i])
}

/// Rapier's: corotational tetrahedra on a lattice.
pub(crate) struct TheirBeam {
    world: peer::PhysicsWorld,
    body: peer::SoftBodyHandle,
    tip: Vec<usize>,
}

impl TheirBeam {
    /// Particles along and across, 297 in all.
    const LATTICE: [usize; 3] = [33, 3, 3];

    pub(crate) fn new(solver: peer::SoftBodySolver) -> Self {
        let mut world = peer::PhysicsWorld::new();
        world.integration_parameters.dt = STEP;
        let [along, across, deep] = Self::LATTICE;
        let half = peer::Vector::new(0.5 * LENGTH, 0.5 * SIDE, 0.5 * SIDE);
        let builder = peer::SoftBodyBuilder::cuboid(peer::Vector::new(0.5 * LENGTH, 0.0, 0.0), half, along, across, deep);
        let at = |x: f32| move |(i, p): (usize, &peer::Vector)| ((p.x - x).abs() < 1e-4).then_some(i);
        let wall: Vec<usize> = builder.particle_positions().iter().enumerate().filter_map(at(0.0)).collect();
        let tip = builder.particle_positions().iter().enumerate().filter_map(at(LENGTH)).collect();
        let material = peer::SoftBodyMaterial { young_modulus: YOUNGS_MODULUS, poisson_ratio: POISSONS_RATIO, ..Default::default() };
        let body = world.insert_soft_body(
            builder
                .cell_model(peer::SoftBodyCellModel::Corotational)
                .material(material)
                .solver(solver)
                .masses(lattice_masses(Self::LATTICE))
                .linear_damping(DRAG)
                .no_surface_collider()
                .can_sleep(false)
                .pinned_particles(wall.into_iter().map(|i| i as u32)),
        );
        Self { world, body, tip }
    }

    pub(crate) fn step(&mut self) {
        self.world.step();
    }

    fn sag(&self) -> f32 {
        let body = &self.world.soft_bodies[self.body];
        -self.tip.iter().map(|&i| body.particle_position(i).y).sum::<f32>() / self.tip.len() as f32
    }

    /// How far it hangs after the same time \[m\].
    pub(crate) fn settled_sag(&mut self) -> f32 {
        average(self, Self::step, Self::sag)
    }
}

/// Each particle's share of the beam's mass: half as much on a face as inside, and so on.
fn lattice_masses([nx, ny, nz]: [usize; 3]) -> Vec<f32> {
    let share = |i: usize, n: usize| if i == 0 || i == n - 1 { 0.5 } else { 1.0 };
    let cells = ((nx - 1) * (ny - 1) * (nz - 1)) as f32;
    let mut masses = Vec::with_capacity(nx * ny * nz);
    for i in 0..nx {
        for j in 0..ny {
            for k in 0..nz {
                masses.push(MASS / cells * share(i, nx) * share(j, ny) * share(k, nz));
            }
        }
    }
    masses
}

fn average<T>(beam: &mut T, step: fn(&mut T), sag: fn(&T) -> f32) -> f32 {
    for _ in 0..SETTLE {
        step(beam);
    }
    let mut sum = 0.0;
    for _ in 0..AVERAGE {
        step(beam);
        sum += sag(beam);
    }
    sum / AVERAGE as f32
}
