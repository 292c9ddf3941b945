//! Torsion: edges resist twist.

use bevy::prelude::*;

use crate::particles::for_each_body;
use crate::{Edges, Frozen, Particles, SubstepTime};

/// The edges of a body resist the twist between their ends. Comes with every [`SoftBody`](crate::SoftBody).
#[derive(Component, Debug, Clone, Copy, PartialEq)]
pub struct Torsion {
    /// Stiffness as the frequency at which the two ends of one edge alone would swing about it \[Hz\]. Range 0 (off) to infinity (rigid); default 15. Negative and NaN count as 0.
    pub frequency: f32,
}

impl Default for Torsion {
    fn default() -> Self {
        Self { frequency: 15.0 }
    }
}

pub(crate) fn solve_torsion(time: Res<SubstepTime>, mut bodies: Query<(&mut Particles, &Edges, &Torsion), Without<Frozen>>) {
    for_each_body(
        &mut bodies,
        |(_, edges, _)| 30 * edges.len(),
        |(mut particles, edges, torsion)| {
            let fraction = polpo_solver::stiffness_fraction(torsion.frequency, time.delta);
            polpo_solver::solve_torsion(edges, &mut particles, fraction);
        },
    );
}
