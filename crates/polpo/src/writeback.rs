//! Phase `Writeback`: the entity follows its particles.

use bevy::math::Vec3A;
use bevy::prelude::*;

use crate::particles::Awake;
use crate::{ContactMemory, Particles, StepStart};

/// Moves each body's origin to its centre of mass.
///
/// The particles are shifted by what the translation really changed by, which far from the world's origin is not what was asked for: at 10 km a float is a millimetre. The rest stays in the
/// particles, and nothing is lost or shaken.
pub(crate) fn follow_center_of_mass(
    mut bodies: Query<(&mut Particles, &mut StepStart, &mut Transform, Option<&mut ContactMemory>), Awake>,
) {
    for (mut particles, mut start, mut transform, memory) in &mut bodies {
        let center = Vec3::from(particles.center_of_mass());
        let moved = transform.translation + center;
        let shift = Vec3A::from(moved - transform.translation);
        if shift != Vec3A::ZERO && shift.is_finite() {
            transform.translation = moved;
            particles.shift_origin(shift);
            for x in &mut start.position {
                *x -= shift;
            }
            if let Some(mut memory) = memory {
                for x in &mut memory.position {
                    *x -= Vec3::from(shift);
                }
            }
        }
        start.origin = transform.translation;
    }
}
