//! Entities that ride on a particle: a hat, a light, a sound.

use bevy::prelude::*;

use crate::Particles;

/// Puts this entity's `Transform` on a particle of a body, and keeps it there after every step: in the particle's axes, which are the world's at rest.
///
/// The entity should have no parent that moves. A body or a particle that does not exist moves nothing.
#[derive(Component, Debug, Clone, Copy, PartialEq)]
pub struct ParticleAnchor {
    /// The soft body.
    pub body: Entity,
    /// Index of its particle.
    pub particle: u32,
    /// Where in the particle's axes the entity is \[m\].
    pub offset: Vec3,
    /// How it is turned in them.
    pub rotation: Quat,
}

impl ParticleAnchor {
    /// On the centre of `particle` of `body`.
    pub fn new(body: Entity, particle: u32) -> Self {
        Self { body, particle, offset: Vec3::ZERO, rotation: Quat::IDENTITY }
    }
}

/// In phase `Writeback`, after the bodies' own transforms.
pub(crate) fn carry_riders(
    bodies: Query<(&Particles, &Transform), Without<ParticleAnchor>>,
    mut riders: Query<(&ParticleAnchor, &mut Transform)>,
) {
    for (anchor, mut transform) in &mut riders {
        let i = anchor.particle as usize;
        let Ok((particles, origin)) = bodies.get(anchor.body) else { continue };
        let (Some(&x), Some(&q)) = (particles.position.get(i), particles.rotation.get(i)) else { continue };
        transform.translation = origin.translation + Vec3::from(x) + q * anchor.offset;
        transform.rotation = (q * anchor.rotation).normalize();
    }
}
