//! Snapshots of Rapier's world, beside those of the soft bodies in it.

use bevy::prelude::World;
use rapier3d::dynamics::{CCDSolver, ImpulseJointSet, IntegrationParameters, IslandManager, MultibodyJointSet, RigidBodySet};
use rapier3d::geometry::{BroadPhaseBvh, ColliderSet, NarrowPhase};

use crate::RapierWorld;
use crate::movers::Reaction;
use crate::obstacles::Obstacle;
use crate::plugin::Surroundings;
use crate::push::Pushing;

/// The state of a [`RapierWorld`] between two steps, and what soft bodies' contacts remember of it: how its colliders moved in the last step, and what joints did in it to the rigid bodies that were pushed. Put back, the steps that follow are the same as they would have been,
/// to the bit.
///
/// Take it and put it back together with the bodies' `polpo::BodySnapshot`s. A game that keeps its rigid world in a way of its own puts that back instead; soft bodies that sleep then may wake, since its colliders are
/// new to them.
///
/// It holds copies; the shapes are shared. With the feature `serialize` it can be written and read by serde, at some 700 bytes a rigid body with its collider. Rapier reads without checking: guard bytes from
/// outside by a checksum.
#[derive(Clone)]
#[cfg_attr(feature = "serialize", derive(serde::Serialize, serde::Deserialize))]
pub struct RapierSnapshot {
    bodies: RigidBodySet,
    colliders: ColliderSet,
    impulse_joints: ImpulseJointSet,
    multibody_joints: MultibodyJointSet,
    parameters: IntegrationParameters,
    islands: IslandManager,
    broad_phase: BroadPhaseBvh,
    narrow_phase: NarrowPhase,
    ccd_solver: CCDSolver,
    obstacles: Vec<Obstacle>,
    reactions: Vec<Reaction>,
}

impl RapierSnapshot {
    /// The state of the [`RapierWorld`]. `None` if there is none.
    pub fn take(world: &World) -> Option<Self> {
        let rapier = world.get_resource::<RapierWorld>()?;
        Some(Self {
            bodies: rapier.bodies.clone(),
            colliders: rapier.colliders.clone(),
            impulse_joints: rapier.impulse_joints.clone(),
            multibody_joints: rapier.multibody_joints.clone(),
            parameters: rapier.parameters,
            islands: rapier.islands.clone(),
            broad_phase: rapier.broad_phase.clone(),
            narrow_phase: rapier.narrow_phase.clone(),
            ccd_solver: rapier.ccd_solver.clone(),
            obstacles: world.get_resource::<Surroundings>()?.0.list.clone(),
            reactions: world.get_resource::<Pushing>()?.reactions.clone(),
        })
    }

    /// Puts the state back.
    pub fn restore(&self, world: &mut World) {
        let Self {
            bodies, colliders, impulse_joints, multibody_joints, parameters, islands, broad_phase, narrow_phase, ccd_solver, ..
        } = self.clone();
        let pipeline = Default::default();
        if let Some(mut surroundings) = world.get_resource_mut::<Surroundings>() {
            surroundings.0.restore(&self.obstacles, &colliders);
        }
        if let Some(mut pushing) = world.get_resource_mut::<Pushing>() {
            pushing.reactions.clone_from(&self.reactions);
        }
        world.insert_resource(RapierWorld {
            bodies,
            colliders,
            impulse_joints,
            multibody_joints,
            parameters,
            islands,
            broad_phase,
            narrow_phase,
            ccd_solver,
            pipeline,
        });
    }
}
