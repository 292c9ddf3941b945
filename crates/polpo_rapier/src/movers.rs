//! Rapier's dynamic bodies as the solver's movers, and back.

use bevy::math::Vec3A;
use polpo_solver::{Foot, Movers, RigidMover, quat_exp};
use rapier3d::dynamics::{RigidBody, RigidBodyHandle};
use rapier3d::geometry::{Collider, ColliderHandle, ContactPair};
use rapier3d::math::{Mat3, Pose, Vector};

use crate::RapierWorld;

/// What Rapier's joints did to a body in its last step, as accelerations.
#[derive(Clone, Copy, Debug)]
#[cfg_attr(feature = "serialize", derive(serde::Serialize, serde::Deserialize))]
pub(crate) struct Reaction {
    pub(crate) body: RigidBodyHandle,
    pub(crate) linear: Vector,
    pub(crate) angular: Vector,
}

/// `handle` as a mover, if soft bodies can push it: a dynamic body that is enabled.
///
/// Gravity and the forces that the game applies accelerate it, as Rapier will have it. One that hangs on joints, a multibody's or others, is accelerated as it was in the last step, the joints' forces included; if it sleeps, not at all.
pub(crate) fn mover_of(world: &RapierWorld, handle: RigidBodyHandle, gravity: Vector, reactions: &[Reaction]) -> Option<RigidMover> {
    let body = world.bodies.get(handle)?;
    if !is_pushable(world, handle) {
        return None;
    }
    let properties = body.mass_properties();
    let mut mover = RigidMover {
        inverse_mass: properties.effective_inv_mass.into(),
        inverse_inertia: inverse_inertia(body).into(),
        velocity: body.linvel().into(),
        angular_velocity: body.angvel().into(),
        anchored: hangs_on_joints(world, handle),
        ..RigidMover::default()
    };
    if !mover.anchored {
        let moves = Vector::from(mover.inverse_mass);
        let free = moves.cmpgt(Vector::ZERO);
        mover.acceleration = (Vector::select(free, gravity, Vector::ZERO) * body.gravity_scale() + body.user_force() * moves).into();
        mover.angular_acceleration = mover.inverse_inertia * Vec3A::from(body.user_torque());
    } else if let Some(reaction) = reactions.iter().find(|reaction| reaction.body == handle).filter(|_| !body.is_sleeping()) {
        mover.acceleration = reaction.linear.into();
        mover.angular_acceleration = reaction.angular.into();
    }
    let sound = mover.velocity.is_finite()
        && mover.angular_velocity.is_finite()
        && mover.acceleration.is_finite()
        && mover.angular_acceleration.is_finite()
        && mover.inverse_mass.is_finite()
        && mover.inverse_inertia.is_finite();
    sound.then_some(mover)
}

/// Whether soft bodies can push it at all.
pub(crate) fn is_pushable(world: &RapierWorld, handle: RigidBodyHandle) -> bool {
    world.bodies.get(handle).is_some_and(|body| body.is_dynamic() && body.is_enabled())
}

fn hangs_on_joints(world: &RapierWorld, handle: RigidBodyHandle) -> bool {
    world.impulse_joints.attached_enabled_joints(handle).next().is_some() || world.multibody_joints.rigid_body_link(handle).is_some()
}

fn inverse_inertia(body: &RigidBody) -> Mat3 {
    let i = &body.mass_properties().effective_world_inv_inertia;
    Mat3::from_cols(Vector::new(i.m11, i.m12, i.m13), Vector::new(i.m12, i.m22, i.m23), Vector::new(i.m13, i.m23, i.m33))
}

/// From the body's position to its centre of mass, in the world's axes.
pub(crate) fn center_arm(body: &RigidBody) -> Vector {
    body.position().rotation * body.local_center_of_mass()
}

/// Adds the feet of mover `index`: the points at which Rapier found it touching in its last step what does not give way, where they are now. That is taken to go on as it does. Another dynamic body is no foot: taken for immovable, one that
/// lies on what a soft body carries would press it into the soft body as hard as need be, and Rapier, for which it has its mass, would throw both. What it weighs comes with Rapier's own step.
pub(crate) fn add_feet(movers: &mut Movers, index: usize, world: &RapierWorld, handle: RigidBodyHandle) {
    let Some(body) = world.bodies.get(handle) else { return };
    for &own in body.colliders() {
        for pair in world.narrow_phase.contact_pairs_with(own) {
            let first = pair.collider1 == own;
            let other = if first { pair.collider2 } else { pair.collider1 };
            if gives_way(world, other) {
                continue;
            }
            let (Some(a), Some(b)) = (pose_of(world, pair.collider1), pose_of(world, pair.collider2)) else { continue };
            let center = body.position().translation + center_arm(body);
            let sign = if first { -1.0 } else { 1.0 };
            collect(pair, a, b, |normal, on_a, on_b| {
                let (mine, theirs) = if first { (on_a, on_b) } else { (on_b, on_a) };
                let normal = normal * sign;
                let foot = Foot {
                    mover: index as u32,
                    arm: (mine - center).into(),
                    normal: normal.into(),
                    gap: normal.dot(mine - theirs),
                    velocity: velocity_of(world, other, theirs).into(),
                    impulse: 0.0,
                };
                if foot.arm.is_finite() && foot.gap.is_finite() && foot.velocity.is_finite() {
                    movers.feet.push(foot);
                }
            });
        }
    }
}

/// The points of a pair with their normal, from the first to the second.
fn collect(pair: &ContactPair, a: Pose, b: Pose, mut found: impl FnMut(Vector, Vector, Vector)) {
    for manifold in &pair.manifolds {
        let a = manifold.subshape_pos1().map_or(a, |local| a * *local);
        let b = manifold.subshape_pos2().map_or(b, |local| b * *local);
        // One that exerts no force, of a sensor or a disabled pair, has no contacts for Rapier's solver.
        if manifold.data.solver_contacts.is_empty() {
            continue;
        }
        for point in &manifold.points {
            found(manifold.data.normal, a.transform_point(point.local_p1), b.transform_point(point.local_p2));
        }
    }
}

/// Composed by hand: a collider's own world pose is stale until Rapier's next step.
fn pose_of(world: &RapierWorld, collider: ColliderHandle) -> Option<Pose> {
    let collider: &Collider = world.colliders.get(collider)?;
    Some(match collider.parent().and_then(|parent| world.bodies.get(parent)) {
        Some(body) => *body.position() * collider.position_wrt_parent().copied().unwrap_or_default(),
        None => *collider.position(),
    })
}

fn gives_way(world: &RapierWorld, collider: ColliderHandle) -> bool {
    world.colliders.get(collider).and_then(|c| c.parent()).and_then(|parent| world.bodies.get(parent)).is_some_and(RigidBody::is_dynamic)
}

fn velocity_of(world: &RapierWorld, collider: ColliderHandle, at: Vector) -> Vector {
    let body = world.colliders.get(collider).and_then(|collider| collider.parent()).and_then(|parent| world.bodies.get(parent));
    body.filter(|body| !body.is_fixed()).map_or(Vector::ZERO, |body| body.velocity_at_point(at))
}

/// Whether soft bodies gave it anything in this step, and nothing that is not a number.
pub(crate) fn is_pushed(mover: &RigidMover) -> bool {
    (mover.impulse != Vec3A::ZERO || mover.angular_impulse != Vec3A::ZERO) && mover.impulse.is_finite() && mover.angular_impulse.is_finite()
}

/// Gives the rigid body what the soft ones gave its proxy in the step of `dt` \[s\]: as a force, which Rapier spreads over its own `solver_steps` as it does gravity. As a blow at the step's start it
/// would rattle what stands on the ground. To be taken off again after Rapier's step, by [`take_off`], from what the game itself applies.
///
/// Rapier gives a body the acceleration bit by bit, the proxy got its impulses when they came. So that both end in the same place, the body is first moved by the difference: a box that lands in the middle
/// of a step stops where it landed, and not above. Not one that has feet or joints: where those end, Rapier decides.
pub(crate) fn hand_over(mover: &RigidMover, has_feet: bool, body: &mut RigidBody, dt: f32, solver_steps: usize) {
    let (place, center) = (*body.position(), center_arm(body));
    // What stands on something under a resting soft body may fall asleep. What only soft bodies push may not, however slow it is: it would lose its momentum.
    if body.is_sleeping() || !has_feet {
        body.wake_up(true);
    }
    body.add_force(Vector::from(mover.impulse) / dt, false);
    body.add_torque(Vector::from(mover.angular_impulse) / dt, false);
    if has_feet || mover.anchored {
        return;
    }
    // Symplectic Euler in n steps moves by v·dt − ½(n − 1)/n·a·dt² for the velocity v at the end.
    let n = solver_steps.max(1) as f32;
    let less = 0.5 * (n - 1.0) / n;
    let gained = mover.acceleration * dt + mover.impulse * mover.inverse_mass;
    let turned = mover.angular_acceleration * dt + mover.inverse_inertia * mover.angular_impulse;
    let way = mover.way - (mover.velocity - gained * less) * dt;
    let turn = quat_exp(-(mover.angular_velocity - turned * less) * dt) * mover.rotation;
    let rotation = (turn * place.rotation).normalize();
    let translation = place.translation + (Vector::from(way) + center - rotation * body.local_center_of_mass());
    if translation.is_finite() && rotation.is_finite() {
        body.set_position(Pose::from_parts(translation, rotation), false);
    }
}

/// Leaves the body with the force and the torque that the game applies.
pub(crate) fn take_off(body: &mut RigidBody, force: Vector, torque: Vector) {
    body.reset_forces(false);
    body.reset_torques(false);
    body.add_force(force, false);
    body.add_torque(torque, false);
}
