//! Phase `Predict`.

use bevy::math::Vec3A;
use bevy::prelude::*;

use crate::particles::{Awake, for_each_body};
use crate::{Gravity, GravityScale, Particles, SubstepTime};

pub(crate) fn predict_particles(
    time: Res<SubstepTime>,
    gravity: Res<Gravity>,
    mut bodies: Query<(&mut Particles, Option<&GravityScale>), Awake>,
) {
    let acceleration = Vec3A::from(gravity.0);
    for_each_body(
        &mut bodies,
        |(particles, _)| 25 * particles.len(),
        |(mut particles, scale)| {
            polpo_solver::predict(&mut particles, acceleration * scale.map_or(1.0, |s| s.0), time.delta);
        },
    );
}
