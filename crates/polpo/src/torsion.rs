//! Torsion: edges resist twist.

use bevy::prelude::*;
use polpo_solver::Stiffness;

use crate::particles::{Awake, for_each_body};
use crate::stiffness::shares_of;
use crate::{Blocks, EdgeStiffness, Edges, Particles, SubstepTime};

/// The edges of a body resist the twist between their ends. Comes with every [`SoftBody`](crate::SoftBody).
#[derive(Component, Debug, Clone, Copy, PartialEq)]
pub struct Torsion {
    /// As the spring on which the two ends of one edge alone would swing about it; default 15 Hz, undamped. [`EdgeStiffness`] overrides it edge by edge.
    pub stiffness: Stiffness,
}

impl Torsion {
    /// The same for every edge.
    pub const fn new(stiffness: Stiffness) -> Self {
        Self { stiffness }
    }
}

impl Default for Torsion {
    fn default() -> Self {
        Self::new(Stiffness::hertz(15.0))
    }
}

pub(crate) fn solve_torsion(
    time: Res<SubstepTime>,
    mut bodies: Query<(&mut Particles, &mut Edges, &Torsion, Option<&mut EdgeStiffness>), (Awake, Without<Blocks>)>,
) {
    let sweep = time.sweep();
    for_each_body(
        &mut bodies,
        |(_, edges, ..)| 30 * edges.len(),
        |(mut particles, mut edges, torsion, mut each)| {
            let each = each.as_mut().and_then(|e| e.bypass_change_detection().torsion.as_mut());
            polpo_solver::solve_torsion(&mut edges, &mut particles, shares_of(each, torsion.stiffness, sweep.dt), sweep);
        },
    );
}
