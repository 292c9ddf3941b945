//! What happens to a body that is no longer made of numbers.

use bevy::math::Vec3A;
use bevy::prelude::*;

use crate::{ExplicitState, Particles, StepStart};

/// A body that turned non-finite: it stays at its last good state and takes no part in the step. Remove it to let the body try again.
#[derive(Component, Debug, Clone, Copy, PartialEq, Eq)]
pub struct Frozen;

/// Triggered on a body that turned non-finite and was frozen.
#[derive(EntityEvent, Debug, Clone)]
pub struct BodyFrozen {
    /// The body.
    pub entity: Entity,
    /// The first particle that was not finite.
    pub particle: usize,
}

/// In phase `Writeback`: a body with a number missing goes back to the start of the step, at rest, and is [`Frozen`]; the rest of the world goes on.
pub(crate) fn freeze_broken_bodies(mut commands: Commands, mut bodies: Query<(Entity, &mut Particles, &StepStart), Without<Frozen>>) {
    for (entity, mut particles, start) in &mut bodies {
        if particles.is_finite() {
            continue;
        }
        let particle = (0..particles.len())
            .find(|&i| {
                !(particles.position[i].is_finite()
                    && particles.rotation[i].is_finite()
                    && particles.velocity[i].is_finite()
                    && particles.angular_velocity[i].is_finite())
            })
            .unwrap_or(0);
        tracing::error!("soft body {entity} was frozen: particle {particle} is no longer finite");
        let p = &mut particles.0;
        p.position.clone_from(&start.position);
        p.previous_position.clone_from(&start.position);
        p.rotation.clone_from(&start.rotation);
        p.previous_rotation.clone_from(&start.rotation);
        p.velocity.fill(Vec3A::ZERO);
        p.angular_velocity.fill(Vec3A::ZERO);
        // Explicit groups remember the motion that broke; they are made anew.
        commands.entity(entity).remove::<ExplicitState>().insert(Frozen);
        commands.trigger(BodyFrozen { entity, particle });
    }
}
