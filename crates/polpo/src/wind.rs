//! Wind and the resistance of the air, by the area that a particle shows it.

use bevy::prelude::*;

use crate::particles::{Awake, for_each_body};
use crate::{Particles, SubstepTime};

/// The velocity of the air everywhere \[m/s\]. Only bodies with [`AirDrag`] feel it. Default still.
#[derive(Resource, Debug, Clone, Copy, PartialEq, Default, Deref, DerefMut)]
pub struct Wind(pub Vec3);

/// The body is slowed down by the air, or carried by [`Wind`]: quadratically, by the area of each ellipsoid across the wind. A body without it pays nothing.
#[derive(Component, Debug, Clone, Copy, PartialEq)]
pub struct AirDrag {
    /// Density of the medium \[kg/m³\]. Range 0 (vacuum) up; default 1.2, air; water has 1000. Negative and NaN count as 0.
    pub density: f32,
    /// Drag coefficient: 0.47 for a sphere, about 1 for a plate; default 0.5. Negative and NaN count as 0.
    pub coefficient: f32,
}

impl Default for AirDrag {
    fn default() -> Self {
        Self { density: 1.2, coefficient: 0.5 }
    }
}

/// In phase `Predict`, before gravity.
pub(crate) fn blow(time: Res<SubstepTime>, wind: Res<Wind>, mut bodies: Query<(&mut Particles, &AirDrag), Awake>) {
    for_each_body(
        &mut bodies,
        |(particles, _)| 30 * particles.len(),
        |(mut particles, drag)| polpo_solver::blow(&mut particles, wind.0.into(), drag.density, drag.coefficient, time.delta),
    );
}
