//! A hand on a particle: a mouse, a claw, a script.

use bevy::math::Vec3A;
use bevy::prelude::*;
use polpo_solver::Stiffness;

use crate::particles::Awake;
use crate::{Particles, SubstepTime};

/// Pulls one particle of the body towards a point, as a spring would that is fixed there. Remove it to let go.
#[derive(Component, Debug, Clone, Copy, PartialEq)]
pub struct Grab {
    /// Index of the particle. One that does not exist or is pinned is not pulled.
    pub particle: u32,
    /// Where it is pulled to \[m\], in the world.
    pub target: Vec3,
    /// As the spring on which the particle alone would swing about the target. The particle is light beside its body: 30 Hz lifts a body of 300 by one of them.
    pub stiffness: Stiffness,
}

/// In phase `SolveConstraints`, after the body's own constraints.
pub(crate) fn pull_grabbed(time: Res<SubstepTime>, mut bodies: Query<(&mut Particles, &Transform, &Grab), Awake>) {
    for (mut particles, transform, grab) in &mut bodies {
        if !grab.target.is_finite() {
            continue;
        }
        let fraction = grab.stiffness.share(time.delta).stiffness;
        let target = Vec3A::from(grab.target - transform.translation);
        let i = grab.particle as usize;
        if let Some(&x) = particles.position.get(i)
            && particles.inverse_mass[i] > 0.0
        {
            particles.displace(i, (target - x) * fraction, 1.0 / time.delta);
        }
    }
}
