//! Distance constraints: edges keep their length.

use bevy::prelude::*;

use crate::particles::for_each_body;
use crate::{Edges, Frozen, Particles, SubstepTime};

/// The edges of a body resist stretching and compression. Comes with every [`SoftBody`](crate::SoftBody).
#[derive(Component, Debug, Clone, Copy, PartialEq)]
pub struct DistanceConstraints {
    /// Stiffness as the frequency at which the two ends of one edge alone would swing \[Hz\]. Range 0 (off) to infinity (rigid); default 40. Negative and NaN count as 0.
    pub frequency: f32,
}

impl Default for DistanceConstraints {
    fn default() -> Self {
        Self { frequency: 40.0 }
    }
}

pub(crate) fn solve_distances(time: Res<SubstepTime>, mut bodies: Query<(&mut Particles, &Edges, &DistanceConstraints), Without<Frozen>>) {
    for_each_body(
        &mut bodies,
        |(_, edges, _)| 10 * edges.len(),
        |(mut particles, edges, distance)| {
            let fraction = polpo_solver::stiffness_fraction(distance.frequency, time.delta);
            polpo_solver::solve_distances(edges, &mut particles, fraction, time.delta);
        },
    );
}
