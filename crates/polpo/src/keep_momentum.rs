//! Angular momentum: what a body's own constraints do to each other does not brake its spin.

use bevy::math::Vec3A;
use bevy::prelude::*;

use crate::particles::{Awake, for_each_body};
use crate::{Particles, SubstepTime};

/// The body's constraints keep its angular momentum exactly, where the method alone loses a share of ω²·Δt a second. Comes with every [`SoftBody`](crate::SoftBody).
///
/// Everything in [`ConstraintSchedule`](crate::ConstraintSchedule) counts as internal to the body. Remove it from a body that you pull from outside by a constraint of your own in that schedule, or order
/// your system after that schedule instead. Bodies with a pinned particle are left alone.
#[derive(Component, Debug, Clone, Copy, PartialEq, Default)]
pub struct KeepMomentum {
    before: Vec3A,
}

/// In phase `SolveConstraints`, before the constraints.
pub(crate) fn measure_momentum(mut bodies: Query<(&Particles, &mut KeepMomentum), Awake>) {
    for_each_body(
        &mut bodies,
        |(particles, _)| 5 * particles.len(),
        |(particles, mut keep)| keep.before = polpo_solver::momentum(particles).angular,
    );
}

/// In phase `SolveConstraints`, after the constraints.
pub(crate) fn restore_momentum(time: Res<SubstepTime>, mut bodies: Query<(&mut Particles, &KeepMomentum), Awake>) {
    for_each_body(
        &mut bodies,
        |(particles, _)| 10 * particles.len(),
        |(mut particles, keep)| polpo_solver::restore_angular_momentum(&mut particles, keep.before, time.delta),
    );
}
