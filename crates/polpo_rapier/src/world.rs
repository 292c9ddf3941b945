//! Rapier's world: what a game fills with rigid bodies and colliders, and what steps it.

use bevy::prelude::Resource;
use rapier3d::dynamics::{
    CCDSolver, ImpulseJointSet, IntegrationParameters, IslandManager, MultibodyJointSet, RigidBodyHandle, RigidBodySet,
};
use rapier3d::geometry::{BroadPhaseBvh, Collider, ColliderHandle, ColliderSet, NarrowPhase};
use rapier3d::math::Vector;
use rapier3d::pipeline::PhysicsPipeline;

/// Rapier's rigid bodies and colliders, and all that Rapier needs to step them. Fill and change `bodies` and `colliders` by Rapier's own API at any time: the next step sees it.
///
/// Soft bodies see every collider. Dynamic rigid bodies push soft ones as if they were driven; those with [`PushRigidBodies`](crate::PushRigidBodies) push back.
#[derive(Resource, Default)]
pub struct RapierWorld {
    /// Fixed, driven and dynamic rigid bodies.
    pub bodies: RigidBodySet,
    /// Their shapes, and shapes without a body, which are fixed.
    pub colliders: ColliderSet,
    /// Joints between rigid bodies.
    pub impulse_joints: ImpulseJointSet,
    /// Joints of articulated rigid bodies.
    pub multibody_joints: MultibodyJointSet,
    /// How Rapier solves. Its `dt` is set by every step.
    pub parameters: IntegrationParameters,
    /// Which rigid bodies are awake; Rapier's own methods ask for it.
    pub islands: IslandManager,
    /// Pairs that may touch.
    pub broad_phase: BroadPhaseBvh,
    /// Pairs that touch.
    pub narrow_phase: NarrowPhase,
    /// Rapier's own continuous collision.
    pub ccd_solver: CCDSolver,
    /// The step itself.
    pub pipeline: PhysicsPipeline,
}

impl RapierWorld {
    /// Steps the rigid bodies by `dt` \[s\] under `gravity` \[m/s²\]. Nothing happens if `dt` is not positive and finite.
    pub fn step(&mut self, gravity: Vector, dt: f32) {
        if !(dt > 0.0 && dt.is_finite()) {
            return;
        }
        self.parameters.dt = dt;
        self.pipeline.step(
            gravity,
            &self.parameters,
            &mut self.islands,
            &mut self.broad_phase,
            &mut self.narrow_phase,
            &mut self.bodies,
            &mut self.colliders,
            &mut self.impulse_joints,
            &mut self.multibody_joints,
            &mut self.ccd_solver,
            &(),
            &(),
        );
    }

    /// Inserts a collider that belongs to no rigid body and stays where it is put.
    pub fn insert_fixed(&mut self, collider: impl Into<Collider>) -> ColliderHandle {
        self.colliders.insert(collider)
    }

    /// Removes a collider. `None` if it was not there.
    pub fn remove_collider(&mut self, handle: ColliderHandle) -> Option<Collider> {
        self.colliders.remove(handle, &mut self.islands, &mut self.bodies, true)
    }

    /// Removes a rigid body with its colliders and joints. Whether it was there.
    pub fn remove_body(&mut self, handle: RigidBodyHandle) -> bool {
        let sets = (&mut self.islands, &mut self.colliders, &mut self.impulse_joints, &mut self.multibody_joints);
        self.bodies.remove(handle, sets.0, sets.1, sets.2, sets.3, true).is_some()
    }
}
