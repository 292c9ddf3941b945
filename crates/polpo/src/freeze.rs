//! What happens to a body that is no longer made of numbers.

use bevy::math::Vec3A;
use bevy::prelude::*;
use polpo_solver::StateError;

use crate::particles::Awake;
use crate::{ExplicitState, Particles, Sleeping, SoftBody, StepStart};

/// A body that cannot be stepped: it stays at its last good state and takes no part in the step. Remove it to let the body try again.
#[derive(Component, Debug, Clone, Copy, PartialEq, Eq)]
pub struct Frozen;

/// Why a body was frozen.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum FreezeReason {
    /// Its particles are not fit to be stepped.
    #[error("{0}")]
    Particles(#[from] StateError),
    /// Its `Transform` is not finite.
    #[error("its transform has translation {translation}, rotation {rotation}, scale {scale}")]
    Transform {
        /// Where it was to be.
        translation: Vec3,
        /// How it was turned.
        rotation: Quat,
        /// How it was scaled.
        scale: Vec3,
    },
}

/// Triggered on a body that was frozen.
#[derive(EntityEvent, Debug, Clone)]
pub struct BodyFrozen {
    /// The body.
    pub entity: Entity,
    /// What was wrong with it.
    pub reason: FreezeReason,
}

type Steppable = (Entity, &'static mut Particles, &'static mut Transform, &'static mut StepStart, Option<&'static SoftBody>);

/// In phase `Prepare`, before anything reads what a game may have written: a body that cannot be stepped goes back to its last good state, at rest, and is [`Frozen`]; the rest of the world goes on.
///
/// What a body is made of (masses, radii, frames, rest positions) has no last good state and is left as it is; where it has the wrong length, it is filled up with NaN, so that the body freezes again until
/// somebody puts it right or inserts its [`SoftBody`] anew.
///
/// A body that is frozen already is looked at too, because others may touch it; nobody is told again.
pub(crate) fn freeze_unfit_bodies(mut commands: Commands, mut bodies: Query<(Steppable, Has<Frozen>), Without<Sleeping>>) {
    for ((entity, mut particles, mut transform, mut start, body), frozen) in &mut bodies {
        let count = body.map_or(particles.len(), |body| body.rig.particles.len());
        let Some(reason) = fault(&particles, &transform, count) else { continue };
        // Between steps, what of the places is in order is newer than the start of the last one.
        let p = &*particles;
        if p.position.len() == count && p.position.iter().all(|x| x.is_finite()) {
            start.position.clone_from(&p.position);
        }
        if p.rotation.len() == count && p.rotation.iter().all(|q| q.is_finite() && q.length_squared() > 0.25) {
            start.rotation.clone_from(&p.rotation);
        }
        go_back((&mut particles, &mut transform), &start, count);
        if !frozen {
            freeze(&mut commands, entity, reason);
        }
    }
}

/// In phase `Writeback`: the same for a body that broke within the step; it goes back to where the step began.
pub(crate) fn freeze_broken_bodies(mut commands: Commands, mut bodies: Query<Steppable, Awake>) {
    for (entity, mut particles, mut transform, start, body) in &mut bodies {
        let count = body.map_or(particles.len(), |body| body.rig.particles.len());
        if let Some(reason) = fault(&particles, &transform, count) {
            go_back((&mut particles, &mut transform), &start, count);
            freeze(&mut commands, entity, reason);
        }
    }
}

fn fault(particles: &Particles, transform: &Transform, count: usize) -> Option<FreezeReason> {
    let Transform { translation, rotation, scale } = *transform;
    match particles.check(count) {
        Err(error) => Some(error.into()),
        Ok(()) => (!transform.is_finite()).then_some(FreezeReason::Transform { translation, rotation, scale }),
    }
}

fn freeze(commands: &mut Commands, entity: Entity, reason: FreezeReason) {
    tracing::error!("soft body {entity} was frozen: {reason}");
    // Explicit groups remember the motion that broke; they are made anew.
    commands.entity(entity).remove::<ExplicitState>().try_insert(Frozen);
    commands.trigger(BodyFrozen { entity, reason });
}

/// The body as it was at `start`, at rest.
fn go_back((p, transform): (&mut polpo_solver::Particles, &mut Transform), start: &StepStart, count: usize) {
    if !transform.is_finite() {
        *transform = Transform::from_translation(start.origin);
    }
    p.position.clone_from(&start.position);
    p.rotation.clone_from(&start.rotation);
    p.position.resize(count, Vec3A::ZERO);
    p.rotation.resize(count, Quat::IDENTITY);
    p.previous_position.clone_from(&p.position);
    p.previous_rotation.clone_from(&p.rotation);
    for velocity in [&mut p.velocity, &mut p.angular_velocity] {
        velocity.clear();
        velocity.resize(count, Vec3A::ZERO);
    }
    p.reaction.clear();
    for list in [&mut p.mass, &mut p.inverse_mass, &mut p.inertia, &mut p.inverse_inertia] {
        list.resize(count, f32::NAN);
    }
    for list in [&mut p.rest_position, &mut p.radii] {
        list.resize(count, Vec3A::NAN);
    }
    p.frame.resize(count, Quat::NAN);
}
