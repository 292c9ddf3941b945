//! The constraints of one large body on the bare kernels, in one piece or in blocks.

use bevy::math::Vec3A;
use polpo_benches::cube;
use polpo_solver::{
    Blocks, Constraints, Edges, ImplicitGroups, InTurn, ParticleRest, Particles, Stiffness, Sweep, Turning, match_shapes, predict,
    solve_blocks, solve_distances, solve_torsion,
};

/// The length of a substep \[s\].
const DT: f32 = 1.0 / 300.0;

/// A cube that wobbles, as stiff as bodies are by default.
pub(crate) struct Constrained {
    particles: Particles,
    groups: ImplicitGroups,
    edges: Edges,
    blocks: Option<Blocks>,
}

impl Constrained {
    pub(crate) fn new(side: usize, in_blocks: bool) -> Self {
        let rig = cube(side);
        let rest: Vec<ParticleRest> = rig
            .particles
            .iter()
            .map(|p| ParticleRest { position: p.position.into(), frame: p.frame, radii: p.radii.into(), mass: p.mass })
            .collect();
        let mut particles = Particles::new(&rest).expect("the cube is sound");
        let edges = Edges::new(&particles, &rig.edges).expect("the cube is sound");
        let groups = ImplicitGroups::new(&particles, &edges);
        let blocks = in_blocks.then(|| Blocks::new(&particles, &groups, &edges));
        for (v, x) in particles.velocity.iter_mut().zip(&particles.position) {
            let [x, y, z] = (*x * 5.0).to_array();
            *v = Vec3A::new(y.sin(), z.sin(), x.sin()) * 0.2;
        }
        Self { particles, groups, edges, blocks }
    }

    /// One substep, of which what is no constraint takes a fiftieth.
    pub(crate) fn solve(&mut self) {
        let Self { particles, groups, edges, blocks } = self;
        let share = |frequency| Stiffness::hertz(frequency).share(DT).into();
        let [shapes, distances, torsion] = [25.0, 40.0, 15.0].map(share);
        let sweep = Sweep::only(DT);
        predict(particles, Vec3A::ZERO, DT);
        match blocks {
            Some(blocks) => {
                let constraints = Constraints { shapes, turning: Turning::AllMembers, tension: distances, compression: distances, torsion };
                solve_blocks(blocks, particles, &constraints, sweep, &InTurn);
            }
            None => {
                match_shapes(groups, particles, shapes, Turning::AllMembers, sweep);
                solve_distances(edges, particles, distances, distances, sweep);
                solve_torsion(edges, particles, torsion, sweep);
            }
        }
    }

    pub(crate) fn block_count(&self) -> usize {
        self.blocks.as_ref().map_or(0, Blocks::len)
    }

    /// The largest distance between a particle's places in the two \[m\].
    pub(crate) fn distance(&self, other: &Self) -> f32 {
        let places = self.particles.position.iter().zip(&other.particles.position);
        places.map(|(a, b)| a.distance(*b)).fold(0.0, f32::max)
    }
}
