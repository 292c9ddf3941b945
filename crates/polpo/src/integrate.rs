//! Phase `Integrate`.

use bevy::prelude::*;

use crate::particles::{Awake, for_each_body};
use crate::{Damping, Particles, SubstepTime};

pub(crate) fn integrate_particles(time: Res<SubstepTime>, mut bodies: Query<(&mut Particles, Option<&Damping>), Awake>) {
    for_each_body(
        &mut bodies,
        |(particles, _)| 25 * particles.len(),
        |(mut particles, damping)| polpo_solver::integrate(&mut particles, time.delta, damping.map_or(0.0, |d| d.drag)),
    );
}
