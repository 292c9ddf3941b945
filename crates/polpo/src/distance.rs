//! Distance constraints: edges keep their length.

use bevy::prelude::*;
use polpo_solver::Stiffness;

use crate::particles::{Awake, for_each_body};
use crate::stiffness::shares_of;
use crate::{Blocks, EdgeStiffness, Edges, Particles, SubstepTime};

/// The edges of a body resist stretching and compression. Comes with every [`SoftBody`](crate::SoftBody).
#[derive(Component, Debug, Clone, Copy, PartialEq)]
pub struct DistanceConstraints {
    /// Against stretching, as the spring on which the two ends of one edge alone would swing; default 40 Hz, undamped. [`EdgeStiffness`] overrides both edge by edge.
    pub tension: Stiffness,
    /// Against compression; default the same. A rope has none.
    pub compression: Stiffness,
}

impl DistanceConstraints {
    /// The same against stretching and compression.
    pub const fn new(stiffness: Stiffness) -> Self {
        Self { tension: stiffness, compression: stiffness }
    }
}

impl Default for DistanceConstraints {
    fn default() -> Self {
        Self::new(Stiffness::hertz(40.0))
    }
}

pub(crate) fn solve_distances(
    time: Res<SubstepTime>,
    mut bodies: Query<(&mut Particles, &mut Edges, &DistanceConstraints, Option<&mut EdgeStiffness>), (Awake, Without<Blocks>)>,
) {
    let sweep = time.sweep();
    for_each_body(
        &mut bodies,
        |(_, edges, ..)| 10 * edges.len(),
        |(mut particles, mut edges, distance, mut each)| {
            let each = each.as_mut().map(|e| e.bypass_change_detection());
            let (tension, compression) = each.map_or((None, None), |e| (e.tension.as_mut(), e.compression.as_mut()));
            let tension = shares_of(tension, distance.tension, sweep.dt);
            let compression = shares_of(compression, distance.compression, sweep.dt);
            polpo_solver::solve_distances(&mut edges, &mut particles, tension, compression, sweep);
        },
    );
}
