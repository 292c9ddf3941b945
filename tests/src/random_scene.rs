//! Scenes made from a seed, for contracts that have to hold in any scene.

use bevy::prelude::*;
use polpo::prelude::*;
use polpo::{EdgeStiffness, Inflation, Material, ParticleStiffness, Plasticity, RodShape, RodSolve, Rods, Section};
use polpo_rapier::{PushRigidBodies, RapierWorld, RigidBodyFollower};
use polpo_rig::{MeshHash, Particle, Rig};
use polpo_scenes::octopus_asset;
use rapier3d::prelude::*;

use crate::lattice;
use crate::random_capabilities::{add_groups, add_rest_pose, flex};

/// A small generator of pseudo-random numbers (SplitMix64).
pub struct Random(pub u64);

impl Random {
    /// Any 64 bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// Uniform in 0 … 1.
    pub fn unit(&mut self) -> f32 {
        (self.bits() >> 40) as f32 / (1u64 << 24) as f32
    }

    /// Uniform in −1 … 1, each component.
    pub fn vector(&mut self) -> Vec3 {
        Vec3::new(self.unit(), self.unit(), self.unit()) * 2.0 - Vec3::ONE
    }

    /// Uniform in 0 … n − 1.
    pub fn below(&mut self, n: usize) -> usize {
        (self.bits() % n as u64) as usize
    }

    /// True once in `n` times.
    pub fn once_in(&mut self, n: usize) -> bool {
        self.below(n) == 0
    }

    pub(crate) fn turn(&mut self) -> Quat {
        let axis = self.vector();
        Quat::from_axis_angle(axis.try_normalize().unwrap_or(Vec3::Y), 3.0 * self.unit())
    }
}

/// Fills `app`, which has `SimulationPlugins`, with bodies of several kinds, capabilities given and taken at random, among colliders of several kinds, some of them driven or falling. Where it is reproducible, so
/// is this.
pub fn random_scene(app: &mut App, seed: u64) {
    let mut random = Random(seed);
    app.add_systems(FixedUpdate, flex);
    app.insert_resource(Wind(random.vector() * 3.0));
    app.insert_resource(SolverSettings { substeps: 3 + random.below(4) as u32, iterations: 1 + random.below(2) as u32, ..default() });
    let mut world = app.world_mut().resource_mut::<RapierWorld>();
    let dynamic = add_colliders(&mut world, &mut random);
    let hook = app.world_mut().spawn((Transform::default(), RigidBodyFollower(dynamic))).id();
    for index in 0..7 {
        let rig = match random.below(4) {
            // One that is big enough for systems to go parallel.
            _ if index == 0 => octopus_asset().1.as_ref().clone(),
            0 => chain(&mut random, 8),
            1 => sheet(&mut random, 5),
            _ => lattice(0.06 + 0.06 * random.unit()),
        };
        spawn(app.world_mut(), &mut random, rig, index, hook);
    }
}

/// Gives back one of the dynamic bodies. It hangs by a spring.
fn add_colliders(world: &mut RapierWorld, random: &mut Random) -> RigidBodyHandle {
    world.insert_fixed(ColliderBuilder::halfspace(rapier3d::na::Unit::new_unchecked(Vec3::Y)).friction(0.7));
    for kind in 0..10 {
        let size = 0.1 + 0.3 * random.unit();
        let shape = match kind % 5 {
            0 => ColliderBuilder::ball(size),
            1 => ColliderBuilder::cuboid(size, 0.5 * size, 1.5 * size),
            2 => ColliderBuilder::capsule_x(size, 0.4 * size),
            3 => ColliderBuilder::cylinder(0.6 * size, size),
            _ => ColliderBuilder::convex_hull(&(0..9).map(|_| random.vector() * size).collect::<Vec<_>>()).unwrap(),
        };
        let shape = shape.friction(random.unit());
        let place = Vec3::new(1.5, 0.5, 1.5) * random.vector() + Vec3::Y * 0.5;
        let body = match random.below(4) {
            0 => RigidBodyBuilder::kinematic_velocity_based().angvel(random.vector() * 2.0).linvel(0.1 * random.vector()),
            1 => RigidBodyBuilder::dynamic().linvel(random.vector()),
            _ => RigidBodyBuilder::fixed(),
        };
        let body = world.bodies.insert(body.translation(place).rotation(random.vector()));
        world.colliders.insert_with_parent(shape, body, &mut world.bodies);
    }
    let above = world.bodies.insert(RigidBodyBuilder::fixed().translation(Vec3::Y * 2.0));
    let hanging = world.bodies.insert(RigidBodyBuilder::dynamic().translation(Vec3::Y).angvel(random.vector()));
    world.colliders.insert_with_parent(ColliderBuilder::cuboid(0.2, 0.1, 0.2).density(50.0), hanging, &mut world.bodies);
    world.impulse_joints.insert(above, hanging, SpringJointBuilder::new(0.8, 30.0, 1.0), true);
    hanging
}

fn spawn(world: &mut World, random: &mut Random, rig: Rig, index: usize, hook: Entity) {
    let rest = rig.clone();
    let (particles, edges) = (rig.particles.len(), rig.edges.len());
    let is_chain = edges + 1 == particles;
    let place = Transform::from_translation(random.vector() + Vec3::Y * (1.2 + 0.3 * index as f32)).with_rotation(random.turn());
    let velocity = InitialVelocity { linear: 2.0 * random.vector(), angular: 3.0 * random.vector() };
    let mut body = world.spawn((SoftBody::new(rig), place.with_scale(Vec3::splat(0.8 + 0.5 * random.unit())), velocity));
    body.insert(ShapeMatching::new(Stiffness::damped(5.0 + 50.0 * random.unit(), random.unit())));
    let mut stiffness = || Stiffness::damped(60.0 * random.unit(), random.unit());
    let (by_particle, by_edge) = ((0..particles).map(|_| stiffness()).collect(), (0..edges).map(|_| stiffness()).collect());
    if random.once_in(3) {
        body.insert(ParticleStiffness::new(by_particle));
    }
    if random.once_in(3) {
        body.insert(EdgeStiffness::new(Some(by_edge), None, None));
    }
    let material = Material { youngs_modulus: 2e6, poissons_ratio: 0.4, density: 1000.0 };
    let rods = Rods {
        solve: if random.once_in(2) { RodSolve::Direct } else { RodSolve::Sweep { spin_radius: 0.05 } },
        ..Rods::new(material, Section::circle(0.02))
    };
    if is_chain && random.once_in(2) {
        body.insert(rods).remove::<(ShapeMatching, DistanceConstraints, Torsion)>();
    } else if random.once_in(3) {
        // A few stiff ribs in a soft body.
        let ribs = (0..4).map(|k| (k * edges / 5) as u32).collect();
        let shape = RodShape::Section { section: Section::circle(0.02), edges: Some(ribs) };
        body.insert(Rods { shape, retardation: 0.01 * random.unit(), ..rods });
    }
    if random.once_in(2) {
        add_groups(&mut body, random, &rest);
    }
    if random.once_in(2) {
        body.insert(Plasticity { yield_strain: 0.1 * random.unit(), creep: 20.0 * random.unit(), ..default() });
    }
    if random.once_in(2) {
        body.insert(SelfContact { friction: random.unit(), ..default() });
    }
    if random.once_in(2) {
        body.insert(PushRigidBodies);
    }
    if random.once_in(2) {
        add_rest_pose(&mut body, random, &rest);
    }
    if random.once_in(3) {
        let each = if random.once_in(2) { (0..particles).map(|_| 0.95 + 0.1 * random.unit()).collect() } else { Vec::new() };
        body.insert(Inflation { scale: 0.8 + 0.4 * random.unit(), each });
    }
    if random.once_in(3) {
        body.insert(AirDrag { density: 5.0 * random.unit(), ..default() });
    }
    if random.once_in(4) {
        body.insert(GravityScale(random.unit()));
    }
    if random.once_in(5) {
        body.remove::<Torsion>();
    }
    if random.once_in(5) {
        body.remove::<KeepMomentum>();
    }
    if random.once_in(3) {
        let target = place.translation + 0.3 * random.vector();
        body.insert(Grab { particle: random.below(particles) as u32, target, stiffness: Stiffness::hertz(20.0) });
    }
    if random.once_in(2) {
        // Some give way at once, some later, some never.
        let list = (0..3).map(|_| {
            if random.once_in(4) {
                // At the step's start it hangs a metre up.
                let offset = place.translation - Vec3::Y + 0.2 * random.vector();
                return Pin::to_entity(random.below(particles) as u32, hook, offset);
            }
            let pin = Pin::at(random.below(particles) as u32, place.translation + 0.2 * random.vector());
            match random.below(3) {
                0 => pin.clamped(),
                1 => pin.breaking_at(40.0 * random.unit()),
                _ => pin.breaking_at(1.0),
            }
        });
        body.insert(Pins { list: list.collect() });
    }
}

/// A row of ellipsoids.
fn chain(random: &mut Random, count: usize) -> Rig {
    let particle = |i| Particle {
        position: Vec3::X * (0.1 * i as f32),
        frame: Quat::IDENTITY,
        radii: Vec3::new(0.05, 0.03, 0.02 + 0.02 * random.unit()),
        mass: 0.02 + 0.02 * random.unit(),
    };
    let particles = (0..count).map(particle).collect();
    Rig { mesh_hash: MeshHash(0), particles, edges: (1..count as u32).map(|i| [i - 1, i]).collect(), ..Rig::default() }
}

/// A square of flat ellipsoids.
fn sheet(random: &mut Random, side: usize) -> Rig {
    let place = |i: usize| Vec3::new((i % side) as f32, 0.0, (i / side) as f32) * 0.1;
    let particle =
        |i| Particle { position: place(i), frame: Quat::IDENTITY, radii: Vec3::new(0.05, 0.015, 0.05), mass: 0.01 + 0.01 * random.unit() };
    let particles: Vec<_> = (0..side * side).map(particle).collect();
    let mut edges = Vec::new();
    for i in 0..side * side {
        for j in i + 1..side * side {
            if place(i).distance(place(j)) < 0.15 {
                edges.push([i as u32, j as u32]);
            }
        }
    }
    Rig { mesh_hash: MeshHash(0), particles, edges, ..Rig::default() }
}
