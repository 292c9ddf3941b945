//! Entities that go where rigid bodies go: their pictures, and what soft bodies are pinned to.

use bevy::prelude::*;
use polpo::Gravity;
use polpo_solver::quat_exp;
use rapier3d::dynamics::{RigidBody, RigidBodyHandle, RigidBodyType};
use rapier3d::math::{Pose, Vector};

use crate::RapierWorld;

/// Puts this entity's `Transform` where a rigid body of the [`RapierWorld`] is, after every step. Pin a soft body to the entity, and it is pinned to the rigid body:
///
/// ```
/// # use bevy::prelude::*;
/// # use polpo::{Pin, Pins};
/// # use polpo_rapier::{RapierWorld, RigidBodyFollower};
/// # use rapier3d::prelude::*;
/// # fn hang(commands: &mut Commands, world: &mut RapierWorld, jelly: Entity) {
/// let crane = world.bodies.insert(RigidBodyBuilder::kinematic_position_based());
/// let hook = commands.spawn((Transform::default(), RigidBodyFollower(crane))).id();
/// commands.entity(jelly).insert(Pins { list: vec![Pin::to_entity(0, hook, Vec3::NEG_Y)] });
/// # }
/// ```
///
/// A fixed or driven body holds the particle where it is at the end of each step. So does a dynamic one, foreseen by its velocity; if the soft body has [`PushRigidBodies`](crate::PushRigidBodies), each
/// pulls the other.
///
/// The entity should have no parent that moves, and no scale. A body that does not exist moves nothing.
#[derive(Component, Debug, Clone, Copy, PartialEq)]
pub struct RigidBodyFollower(pub RigidBodyHandle);

/// Before `Prepare`: to where the body will be at the step's end, which is where pins take their particles.
pub(crate) fn lead(
    time: Res<Time>,
    gravity: Res<Gravity>,
    world: Res<RapierWorld>,
    mut followers: Query<(&RigidBodyFollower, &mut Transform)>,
) {
    let dt = time.delta_secs();
    for (follower, mut transform) in &mut followers {
        if let Some(body) = world.bodies.get(follower.0) {
            put(&mut transform, pose_after(body, gravity.0, dt));
        }
    }
}

/// After Rapier's step: to where it is.
pub(crate) fn follow(world: Res<RapierWorld>, mut followers: Query<(&RigidBodyFollower, &mut Transform)>) {
    for (follower, mut transform) in &mut followers {
        if let Some(body) = world.bodies.get(follower.0) {
            put(&mut transform, *body.position());
        }
    }
}

fn put(transform: &mut Transform, pose: Pose) {
    if pose.translation.is_finite() && pose.rotation.is_finite() {
        transform.translation = pose.translation;
        transform.rotation = pose.rotation;
    }
}

/// Where `body` will be after `dt` \[s\] if nothing holds it.
fn pose_after(body: &RigidBody, gravity: Vector, dt: f32) -> Pose {
    let now = *body.position();
    if body.is_fixed() || !body.is_enabled() {
        return now;
    }
    if body.body_type() == RigidBodyType::KinematicPositionBased {
        return *body.next_position();
    }
    let fall = if body.is_dynamic() && !body.is_sleeping() { gravity * body.gravity_scale() } else { Vector::ZERO };
    let center = now.rotation * body.local_center_of_mass();
    let rotation = (quat_exp((body.angvel() * dt).into()) * now.rotation).normalize();
    let way = (body.linvel() + fall * dt) * dt;
    Pose::from_parts(now.translation + center + way - rotation * body.local_center_of_mass(), rotation)
}
