//! Damping: drag against the air, and wobble that dies.

use bevy::prelude::*;

use crate::particles::{Awake, for_each_body};
use crate::{ExplicitState, Particles, SubstepTime};

/// How fast motion dies, as rates: after the time 1/k the share 1/e is left, at every time step. Comes with every [`SoftBody`](crate::SoftBody).
#[derive(Component, Debug, Clone, Copy, PartialEq)]
pub struct Damping {
    /// Of all velocity \[1/s\], as in air or water. Range 0 (none) to infinity; default 0. Negative and NaN count as 0.
    pub drag: f32,
    /// Of the motion inside the body \[1/s\]: what differs from its rigid flight and spin, which are left alone, as is the turning of [`ExplicitGroups`](crate::ExplicitGroups) against each other. Range 0 (wobbles for ever) to infinity (stiffens); default 4. Negative and
    /// NaN count as 0.
    pub internal: f32,
}

impl Default for Damping {
    fn default() -> Self {
        Self { drag: 0.0, internal: 4.0 }
    }
}

/// In phase `Integrate`, after the velocities are known.
pub(crate) fn damp_internally(time: Res<SubstepTime>, mut bodies: Query<(&mut Particles, &Damping, Option<&ExplicitState>), Awake>) {
    for_each_body(
        &mut bodies,
        |(particles, damping, _)| if damping.internal > 0.0 { 20 * particles.len() } else { 0 },
        |(mut particles, damping, explicit)| match explicit {
            Some(groups) => polpo_solver::damp_beside(groups, &mut particles, time.delta, damping.internal),
            None => polpo_solver::damp_internally(&mut particles, time.delta, damping.internal),
        },
    );
}
