//! The bodies that kernels are run on, and how they are when a kernel gets them.

use glam::{Mat3A, Vec3A};
use polpo_rig::Rig;
use polpo_solver::{
    CalibratedEdges, Contact, Contacts, Edges, Facet, ImplicitGroups, Material, ParticleRest, Particles, Section, Shares, Stiffness, Sweep,
    Turning, damp_internally, integrate, match_shapes, momentum, predict, quat_exp, restore_angular_momentum, solve_contacts,
    solve_distances, solve_torsion,
};

use crate::noise::noise;
use crate::{block, octopus};

/// Length of a step and of a substep \[s\].
const STEP: f32 = 1.0 / 60.0;
const SUBSTEPS: u32 = 5;
pub(super) const DT: f32 = STEP / SUBSTEPS as f32;
pub(super) const GRAVITY: Vec3A = Vec3A::new(0.0, -9.81, 0.0);
/// As a body in the plugin comes. [Hz]
pub(super) const SHAPE: Stiffness = Stiffness::hertz(25.0);
pub(super) const LENGTH: Stiffness = Stiffness::hertz(40.0);
pub(super) const TWIST: Stiffness = Stiffness::hertz(15.0);
pub(super) const FRICTION: f32 = 0.6;
pub(super) const PUSH_SPEED: f32 = 3.0;
pub(super) const DAMPING: f32 = 4.0;
/// Steps after which a body that was put on a floor lies: 2 s.
const SETTLE: u32 = 120;

/// A body without an ECS, at rest.
#[derive(Clone)]
pub struct Body {
    /// Its particles.
    pub particles: Particles,
    /// Each with its neighbours.
    pub groups: ImplicitGroups,
    /// Between neighbours.
    pub edges: Edges,
}

impl Body {
    /// The octopus of 300 particles.
    pub fn octopus() -> Self {
        Self::new(&octopus().1)
    }

    /// A block, see [`block`](block::block).
    pub fn block(lattice: [u32; 3]) -> Self {
        Self::new(&block::block(lattice))
    }

    fn new(rig: &Rig) -> Self {
        let rest =
            |p: &polpo_rig::Particle| ParticleRest { position: p.position.into(), frame: p.frame, radii: p.radii.into(), mass: p.mass };
        let rest: Vec<ParticleRest> = rig.particles.iter().map(rest).collect();
        let particles = Particles::new(&rest).expect("a rig's particles are sound");
        let edges = Edges::new(&particles, &rig.edges).expect("a rig's edges are sound");
        Self { groups: ImplicitGroups::new(&particles, &edges), particles, edges }
    }

    /// Its edges as bars of rubber, and its particles with their masses.
    ///
    /// # Panics
    ///
    /// If an edge has no length.
    pub fn rods(&self) -> (Particles, CalibratedEdges) {
        let mut particles = self.particles.clone();
        let section = Section::circle(0.25 * self.mean_length());
        let rods = CalibratedEdges::rods(&mut particles, &self.edges, &RUBBER, &section, Some(self.mean_length()), &[]);
        (particles, rods.expect("a body's edges can be rods"))
    }

    /// A facet in the middle of each edge, as of cells of rubber, and its particles with their masses: edges with contact points.
    ///
    /// # Panics
    ///
    /// If an edge has no length.
    pub fn facets(&self) -> (Particles, CalibratedEdges) {
        let mut particles = self.particles.clone();
        let volumes: Vec<f32> = particles.mass.iter().map(|m| m / RUBBER.density).collect();
        let facet = |&pair: &[u32; 2]| {
            let [a, b] = pair.map(|i| particles.rest_position[i as usize]);
            let [v, w] = pair.map(|i| volumes[i as usize]);
            let along = (b - a).normalize();
            let area = (0.5 * (v + w)).cbrt().powi(2);
            let across = Mat3A::IDENTITY - Mat3A::from_cols(along * along.x, along * along.y, along * along.z);
            // Of a square.
            Facet { pair, area: along * area, centroid: (a + b) * 0.5, moments: across * (area * area / 12.0) }
        };
        let facets: Vec<Facet> = self.edges.pairs.iter().map(facet).collect();
        let made = CalibratedEdges::from_facets(&mut particles, &facets, &volumes, &RUBBER, self.mean_length());
        (particles, made.expect("facets in the middle of edges are sound").0)
    }

    /// \[m\]
    fn mean_length(&self) -> f32 {
        self.edges.rest_length.iter().sum::<f32>() / self.edges.len() as f32
    }

    /// Its particles when it has lain on a floor for two seconds, and what they lie on: as of the start of a substep.
    pub(super) fn lying(&self) -> (Particles, Contacts) {
        let Self { mut particles, mut groups, mut edges } = self.clone();
        let floor = (0..particles.len()).map(|i| bottom(&particles, i)).fold(f32::INFINITY, f32::min);
        let share = |stiffness: Stiffness| Shares::One(stiffness.share(DT));
        let sweep = Sweep { deterministic: true, ..Sweep::only(DT) };
        let mut contacts = Contacts::default();
        for _ in 0..SETTLE {
            contacts.list.clear();
            contacts.list.extend((0..particles.len()).filter_map(|i| contact(&particles, i, floor)));
            groups.forget_rotations(&particles);
            for _ in 0..SUBSTEPS {
                predict(&mut particles, GRAVITY, DT);
                let before = momentum(&particles).angular;
                match_shapes(&mut groups, &mut particles, share(SHAPE), Turning::AllMembers, sweep);
                solve_distances(&mut edges, &mut particles, share(LENGTH), share(LENGTH), sweep);
                solve_torsion(&mut edges, &mut particles, share(TWIST), sweep);
                restore_angular_momentum(&mut particles, before, DT);
                solve_contacts(&mut contacts, &mut particles, DT, PUSH_SPEED);
                integrate(&mut particles, DT, 0.0);
                damp_internally(&mut particles, DT, DAMPING);
            }
        }
        (particles, contacts)
    }
}

const RUBBER: Material = Material { youngs_modulus: 1e6, poissons_ratio: 0.3, density: block::DENSITY };

/// How high particle `i` reaches down \[m\].
fn bottom(particles: &Particles, i: usize) -> f32 {
    particles.position[i].y - particles.ellipsoid(i).support(Vec3A::Y).0
}

/// What particle `i` may meet of a floor at the height `floor` \[m\] within a step.
fn contact(particles: &Particles, i: usize, floor: f32) -> Option<Contact> {
    let reach = (particles.velocity[i].length() + GRAVITY.length() * STEP) * STEP + 0.1 * particles.radii[i].min_element();
    (bottom(particles, i) - floor < reach).then(|| Contact {
        particle: i as u32,
        friction: FRICTION,
        point: Vec3A::new(particles.position[i].x, floor, particles.position[i].z),
        normal: Vec3A::Y,
        velocity: Vec3A::ZERO,
        angular_velocity: Vec3A::ZERO,
        impulse: 0.0,
    })
}

/// Moves every particle by up to `size` of its radius, and turns it by up to as many radians, along each axis.
pub fn stir(particles: &mut Particles, size: f32) {
    let count = particles.len();
    for i in 0..count {
        particles.position[i] += Vec3A::from(noise(i)) * (size * particles.radii[i].min_element());
        particles.rotation[i] = quat_exp(Vec3A::from(noise(i + count)) * size) * particles.rotation[i];
    }
}
