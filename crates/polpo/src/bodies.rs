//! The component that makes an entity a soft body, and what happens when it is inserted.

use std::sync::Arc;

use bevy::math::Vec3A;
use bevy::prelude::*;
use polpo_rig::{Rig, RigError};
use polpo_solver::{ParticleError, ParticleRest};

use crate::recall::Recall;
use crate::rods::RodsOfRig;
use crate::{
    Blocks, BodyContact, Collision, ContactMemory, Contacts, Damping, DistanceConstraints, Frozen, KeepMomentum, Particles, Rods,
    ShapeMatching, Sleep, Sleeping, StepStart, Torsion,
};

/// Makes an entity a soft body.
///
/// When it is inserted, the rig becomes [`Particles`] at the entity's `Transform`: its rotation and (uniform, positive) scale are taken into the particles, and from then on the `Transform` has
/// neither: its translation follows the centre of mass. Moving the translation by hand moves the whole body. The entity should have no parent that moves.
///
/// Inserting it again, with another rig say, builds the body anew, awake. Components that come with a body and were taken off are back then. Spawned with [`Sleeping`] or [`Frozen`], a body stays where it is put until it is woken or that is taken off.
///
/// A rig with regions gives the body [`ExplicitGroups`](crate::ExplicitGroups), [`ParticleStiffness`](crate::ParticleStiffness) and [`ParticleFriction`](crate::ParticleFriction) for them, each unless you put your own
/// beside it; outside the regions [`ShapeMatching`] and [`Collision`] go on to count.
///
/// A rig that cannot be simulated, or a transform that is not finite or not uniformly scaled, is refused with the event [`SoftBodyRejected`] and an error in the log; the entity then just does not
/// move.
#[derive(Component, Debug, Clone)]
#[component(immutable)]
#[require(Transform, ShapeMatching, DistanceConstraints, Torsion, Damping, Collision, BodyContact, KeepMomentum, Sleep)]
pub struct SoftBody {
    /// What the body is made of; shared by all bodies made from it. The component is immutable: another rig comes by inserting it again.
    pub rig: Arc<Rig>,
}

impl SoftBody {
    /// A body made from `rig`.
    pub fn new(rig: impl Into<Arc<Rig>>) -> Self {
        Self { rig: rig.into() }
    }
}

/// The velocity a body starts with, as a rigid piece. Read when its [`SoftBody`] is inserted; later changes have no effect.
#[derive(Component, Debug, Clone, Copy, PartialEq, Default)]
pub struct InitialVelocity {
    /// Of the centre of mass \[m/s\].
    pub linear: Vec3,
    /// About the centre of mass \[rad/s\], world axes.
    pub angular: Vec3,
}

/// Why a [`SoftBody`] could not be built.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RejectReason {
    /// The rig is not whole.
    #[error("{0}")]
    Rig(String),
    /// A particle of the rig, scaled by the transform, cannot be simulated.
    #[error("{0}")]
    Particle(#[from] ParticleError),
    /// The transform is not finite, or its scale is not uniform and positive.
    #[error(
        "its transform has translation {translation}, rotation {rotation}, scale {scale}: it must be finite and uniformly, positively scaled"
    )]
    Transform {
        /// Where it was to be.
        translation: Vec3,
        /// How it was turned.
        rotation: Quat,
        /// How it was scaled.
        scale: Vec3,
    },
}

impl From<RigError> for RejectReason {
    fn from(error: RigError) -> Self {
        Self::Rig(error.to_string())
    }
}

/// Triggered on an entity whose [`SoftBody`] could not be built.
#[derive(EntityEvent, Debug, Clone)]
pub struct SoftBodyRejected {
    /// The entity.
    pub entity: Entity,
    /// What was wrong with it.
    pub reason: RejectReason,
}

/// What the capabilities of a body have made from its particles; made anew when these are.
type Built =
    (Blocks, crate::CalibratedEdges, crate::Edges, crate::ExplicitState, crate::ImplicitGroups, crate::Posed, crate::SelfPairs, Recall);

/// What a body brings along when it is built anew: its contacts with the world, and rods, which may be those of its last rig.
type Past =
    (Option<(&'static mut Contacts, &'static mut ContactMemory)>, Option<&'static Rods>, Option<&'static RodsOfRig>, Has<Particles>);

/// Builds the particles as soon as a [`SoftBody`] is inserted.
pub(crate) fn build_body(
    insert: On<Insert, SoftBody>,
    mut commands: Commands,
    mut bodies: Query<(&SoftBody, &mut Transform, Option<&InitialVelocity>, Past)>,
) {
    let entity = insert.entity;
    let Ok((body, mut transform, velocity, (met, rods, of_rig, anew))) = bodies.get_mut(entity) else {
        return;
    };
    // A body that is built anew has no past.
    if let Some((mut contacts, mut memory)) = met {
        contacts.list.clear();
        memory.position.clear();
    }
    // Whoever changed the rods that came with a rig made them their own.
    let own_rods = rods.is_some_and(|rods| !of_rig.is_some_and(|of_rig| of_rig.are(rods)));
    match particles_at(&body.rig, &transform) {
        Ok((mut particles, origin)) => {
            if let Some(velocity) = velocity {
                particles.set_rigid_velocity(velocity.linear.into(), velocity.angular.into());
            }
            let scale = transform.scale.x;
            *transform = Transform::from_translation(origin);
            let start = StepStart { position: particles.position.clone(), rotation: particles.rotation.clone(), origin };
            let mut entity = commands.entity(entity);
            entity.remove::<Built>();
            // A new one may be spawned asleep or frozen.
            if anew {
                entity.remove::<(Frozen, Sleeping)>();
            }
            if particles.len() >= Blocks::LARGE {
                entity.try_insert(Blocks::default());
            }
            if own_rods {
                entity.remove::<RodsOfRig>();
            } else if let Some(rods) = Rods::of_rig(&body.rig, scale) {
                entity.try_insert((rods, RodsOfRig { rig: body.rig.clone(), scale }));
            } else if rods.is_some() || of_rig.is_some() {
                entity.remove::<(Rods, RodsOfRig)>();
            }
            entity.try_insert((Particles(particles), start));
        }
        Err(reason) => {
            tracing::error!("soft body {entity} was not built: {reason}");
            commands.entity(entity).remove::<(Particles, StepStart, Built)>();
            commands.trigger(SoftBodyRejected { entity, reason });
        }
    }
}

/// The rig's particles placed by `transform`, relative to their centre of mass, and where that is.
pub(crate) fn particles_at(rig: &Rig, transform: &Transform) -> Result<(polpo_solver::Particles, Vec3), RejectReason> {
    rig.validate()?;
    let Transform { translation, rotation, scale } = *transform;
    let s = scale.x;
    let uniform = (scale - Vec3::splat(s)).abs().max_element() <= 1e-4 * s;
    if !(transform.is_finite() && s > 0.0 && uniform && rotation.length_squared() > 0.25) {
        return Err(RejectReason::Transform { translation, rotation, scale });
    }
    let rest: Vec<ParticleRest> = rig
        .particles
        .iter()
        .map(|p| ParticleRest {
            position: Vec3A::from(p.position) * s,
            frame: p.frame,
            radii: Vec3A::from(p.radii) * s,
            mass: p.mass * s * s * s,
        })
        .collect();
    let mut particles = polpo_solver::Particles::new(&rest)?;
    particles.place(rotation.normalize(), Vec3A::ZERO);
    let center = particles.center_of_mass();
    particles.shift_origin(center);
    Ok((particles, translation + Vec3::from(center)))
}
