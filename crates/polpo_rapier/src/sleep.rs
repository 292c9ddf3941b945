//! Soft bodies that sleep among rigid ones: what keeps them awake, and what goes to sleep with them.

use bevy::ecs::system::SystemParam;
use bevy::prelude::*;
use polpo::{Awake, Collision, Frozen, Particles, PinTarget, Pins, Sleep, Sleeping, StepStart, Stillness};
use rapier3d::dynamics::{RigidBody, RigidBodyHandle};

use crate::detect::{bounds_of, layers};
use crate::movers::is_pushable;
use crate::plugin::Surroundings;
use crate::push::Pushing;
use crate::{PushRigidBodies, PushState, RapierWorld, RigidBodyFollower};

/// Bodies near a collider that is not as it was do not sleep. While nothing stirs, nothing is looked at.
///
/// Not so what a body carries: a rigid body that it pushes, and that is as quiet as it has to be itself, will sleep with it.
pub(crate) fn disturb(
    mut commands: Commands,
    world: Res<RapierWorld>,
    surroundings: Res<Surroundings>,
    mut bodies: Query<
        (Entity, &Particles, &Transform, &Collision, Option<&Sleep>, &mut Stillness, Has<Sleeping>, Has<PushRigidBodies>),
        Without<Frozen>,
    >,
    mut island: Local<Vec<RigidBodyHandle>>,
) {
    if surroundings.0.stirred.is_empty() {
        return;
    }
    for (entity, particles, transform, collision, sleep, mut stillness, asleep, pushes) in &mut bodies {
        let Some((mins, maxs)) = bounds_of(&particles.position, &particles.radii) else { continue };
        let layers = layers(collision.memberships, collision.filter);
        let quiet = sleep.filter(|_| pushes && !asleep).map(|sleep| sleep.quiet_speed(particles));
        let disturbed = surroundings.0.stirred_near(mins, maxs, transform.translation, layers).any(|stirred| {
            let carried = stirred.body.filter(|_| quiet.is_some_and(|quiet| stirred.speed <= quiet));
            carried.is_none_or(|body| !is_resting(&world, body, &mut island))
        });
        if disturbed {
            stillness.0 = 0.0;
            if asleep {
                commands.entity(entity).remove::<Sleeping>();
            }
        }
    }
}

/// In phase `DetectContacts`, when it is known who pushes what: bodies that push the same rigid one have been quiet for as long as the least quiet of them, so that they sleep together.
pub(crate) fn wait_for_each_other(
    pushing: Res<Pushing>,
    mut bodies: Query<(&PushState, Option<&mut Stillness>), (With<PushRigidBodies>, Awake)>,
    mut least: Local<Vec<f32>>,
) {
    least.clear();
    least.resize(pushing.handles.len(), f32::INFINITY);
    let index_of = |body: &RigidBodyHandle| pushing.handles.iter().position(|other| other == body);
    let mut waiting = !least.is_empty();
    while waiting {
        waiting = false;
        for (state, still) in &mut bodies {
            // One without stillness never sleeps.
            let mut own = still.as_ref().map_or(0.0, |still| still.0);
            for at in state.pushed.iter().filter_map(index_of) {
                own = own.min(least[at]);
            }
            for at in state.pushed.iter().filter_map(index_of) {
                waiting |= own < least[at];
                least[at] = own;
            }
            if let Some(mut still) = still
                && own < still.0
            {
                still.0 = own;
            }
        }
    }
}

/// Before Rapier's step: what lost its carrier wakes, and what those carry that have just fallen asleep sleeps with them, unless one that is awake pushes it too.
pub(crate) fn lull(
    mut pushing: ResMut<Pushing>,
    mut world: ResMut<RapierWorld>,
    asleep: Query<&PushState, (With<PushRigidBodies>, With<Sleeping>)>,
    awake: Query<&PushState, (With<PushRigidBodies>, Awake)>,
    mut island: Local<Vec<RigidBodyHandle>>,
) {
    // Those that pushed in this step. What others once pushed is not known.
    let Pushing { order, lulled, woken, .. } = &mut *pushing;
    sort(woken);
    for body in woken.drain(..) {
        // Asking for it mutably would already count as a change.
        if is_pushable(&world, body)
            && world.bodies.get(body).is_some_and(RigidBody::is_sleeping)
            && let Some(body) = world.bodies.get_mut(body)
        {
            body.wake_up(true);
        }
    }
    lulled.clear();
    for state in order.iter().filter_map(|&body| asleep.get(body).ok()) {
        lulled.extend(state.pushed.iter().filter(|body| !awake.iter().any(|other| other.pushed.contains(body))));
    }
    sort(lulled);
    lulled.retain(|&body| {
        if !is_resting(&world, body, &mut island) {
            return false;
        }
        for &body in &*island {
            if world.bodies.get(body).is_some_and(|body| !body.is_sleeping())
                && let Some(body) = world.bodies.get_mut(body)
            {
                body.sleep();
            }
        }
        true
    });
}

/// The order in which Rapier is told should not hang on that of the soft bodies' components in memory.
fn sort(bodies: &mut Vec<RigidBodyHandle>) {
    bodies.sort_unstable_by_key(|body| body.into_raw_parts());
    bodies.dedup();
}

/// Soft bodies, and the rigid ones that may lie on them or hang from them.
///
/// Found by where they are, not remembered: so a body put back by a snapshot knows as well, and more rigid bodies than need to wake, those beside it, fall asleep again.
#[derive(SystemParam)]
pub(crate) struct Carriers<'w, 's> {
    pushing: ResMut<'w, Pushing>,
    surroundings: Res<'w, Surroundings>,
    followers: Query<'w, 's, &'static RigidBodyFollower>,
    bodies: Query<'w, 's, (&'static Particles, &'static StepStart, Option<&'static Pins>), With<PushRigidBodies>>,
}

impl Carriers<'_, '_> {
    /// Notes that what `carrier` carries has to wake.
    fn wake(&mut self, carrier: Entity) {
        let Ok((particles, start, pins)) = self.bodies.get(carrier) else { return };
        // Where it was in the last step, wherever it was put since.
        if let Some((mins, maxs)) = bounds_of(&start.position, &particles.radii) {
            let near = self.surroundings.0.list.iter().filter(|obstacle| obstacle.meets(mins, maxs, start.origin));
            self.pushing.woken.extend(near.filter_map(|obstacle| obstacle.body));
        }
        for pin in pins.iter().flat_map(|pins| &pins.list) {
            if let PinTarget::Entity(entity, ..) = pin.to {
                self.pushing.woken.extend(self.followers.get(entity).map(|follower| follower.0));
            }
        }
    }
}

/// A body that wakes, or is gone, no longer carries what sleeps on it.
pub(crate) fn wake_carried(remove: On<Remove, Sleeping>, mut carriers: Carriers) {
    carriers.wake(remove.entity);
}

/// One that no longer pushes does not either.
pub(crate) fn let_go(remove: On<Remove, PushRigidBodies>, mut carriers: Carriers) {
    carriers.wake(remove.entity);
}

/// Whether neither `body` nor any of the dynamic bodies that hang together with it by contacts and joints, which are put into `island`, moves faster than Rapier lets it sleep. Rapier steps a body that sleeps among others that do
/// not, so they sleep together or not at all.
fn is_resting(world: &RapierWorld, body: RigidBodyHandle, island: &mut Vec<RigidBodyHandle>) -> bool {
    island.clear();
    if !is_pushable(world, body) {
        return false;
    }
    island.push(body);
    let mut at = 0;
    while let Some(&handle) = island.get(at) {
        at += 1;
        let Some(body) = world.bodies.get(handle).filter(|body| may_sleep(body, world.parameters.length_unit)) else { return false };
        let mut join = |other: RigidBodyHandle| {
            if !island.contains(&other) && world.bodies.get(other).is_some_and(|other| !other.is_fixed()) {
                // What is driven does not hang on what it drives, but must be at rest like the others.
                island.push(other);
            }
        };
        if !body.is_dynamic() {
            continue;
        }
        for &collider in body.colliders() {
            for pair in world.narrow_phase.contact_pairs_with(collider).filter(|pair| pair.has_any_active_contact()) {
                for collider in [pair.collider1, pair.collider2] {
                    if let Some(parent) = world.colliders.get(collider).and_then(|collider| collider.parent()) {
                        join(parent);
                    }
                }
            }
        }
        for (first, second, ..) in world.impulse_joints.attached_enabled_joints(handle) {
            join(first);
            join(second);
        }
        for other in world.multibody_joints.attached_bodies(handle) {
            join(other);
        }
    }
    island.retain(|&body| is_pushable(world, body));
    true
}

fn may_sleep(body: &RigidBody, length_unit: f32) -> bool {
    if !body.is_dynamic() {
        return !body.is_moving();
    }
    let activation = body.activation();
    let (linear, angular) = (activation.normalized_linear_threshold * length_unit, activation.angular_threshold);
    // Also false where the thresholds are negative, which is how Rapier says that a body never sleeps.
    body.is_sleeping() || (body.linvel().length() < linear && body.angvel().length() < angular)
}

#[cfg(test)]
mod tests {
    use bevy::ecs::system::RunSystemOnce;
    use rapier3d::prelude::*;

    use super::*;

    /// A tower of two boxes on the ground, and a third that hangs on the upper one by a joint.
    fn tower() -> (RapierWorld, [RigidBodyHandle; 3]) {
        let mut world = RapierWorld::default();
        world.insert_fixed(ColliderBuilder::cuboid(5.0, 0.5, 5.0).translation(Vector::NEG_Y * 0.5));
        let bodies = [Vector::Y * 0.1, Vector::Y * 0.3, Vector::new(0.5, 0.3, 0.0)].map(|at| {
            let body = world.bodies.insert(RigidBodyBuilder::dynamic().translation(at));
            world.colliders.insert_with_parent(ColliderBuilder::cuboid(0.1, 0.1, 0.1).density(500.0), body, &mut world.bodies);
            body
        });
        let joint = FixedJointBuilder::new().local_anchor1(Vector::X * 0.25).local_anchor2(Vector::X * -0.25);
        world.impulse_joints.insert(bodies[1], bodies[2], joint, true);
        world.bodies[bodies[2]].set_gravity_scale(0.0, false);
        for _ in 0..60 {
            world.step(Vector::NEG_Y * 9.81, 1.0 / 60.0);
        }
        for body in bodies {
            world.bodies[body].wake_up(true);
        }
        (world, bodies)
    }

    #[test]
    fn what_hangs_together_rests_together() {
        let mut island = Vec::new();
        let (world, mut bodies) = tower();
        assert!(is_resting(&world, bodies[0], &mut island));
        sort(&mut island);
        bodies.sort_unstable_by_key(|body| body.into_raw_parts());
        assert_eq!(island, bodies);
        type Change = fn(&mut RigidBody);
        let changes: [(Change, bool); 4] = [
            (|body| body.set_linvel(Vector::X, true), false),
            (|body| body.activation_mut().normalized_linear_threshold = -1.0, false),
            // It would wait longer than the others, but it may.
            (|body| body.activation_mut().time_until_sleep = 60.0, true),
            (|body| body.sleep(), true),
        ];
        for (k, (change, rests)) in changes.into_iter().enumerate() {
            let (mut world, bodies) = tower();
            change(&mut world.bodies[bodies[2]]);
            assert_eq!(is_resting(&world, bodies[0], &mut island), rests, "{k}");
        }
    }

    #[test]
    fn what_hangs_together_is_put_to_sleep_together() {
        let (rapier, bodies) = tower();
        let mut world = World::new();
        world.insert_resource(rapier);
        let mut state = PushState::default();
        state.pushed.push(bodies[0]);
        let carrier = world.spawn((PushRigidBodies, state, Sleeping::default())).id();
        let mut pushing = Pushing::default();
        pushing.order.push(carrier);
        world.insert_resource(pushing);
        world.run_system_once(lull).unwrap();
        let rapier = world.resource::<RapierWorld>();
        assert_eq!(bodies.map(|body| rapier.bodies[body].is_sleeping()), [true; 3]);
        assert_eq!(world.resource::<Pushing>().lulled, [bodies[0]]);
    }

    #[test]
    fn what_lies_on_something_driven_does_not_rest() {
        let (mut world, bodies) = tower();
        let driven = world.bodies.insert(RigidBodyBuilder::kinematic_velocity_based().translation(Vector::new(0.0, 0.1, 0.19)));
        world.colliders.insert_with_parent(ColliderBuilder::cuboid(0.1, 0.1, 0.1), driven, &mut world.bodies);
        world.step(Vector::NEG_Y * 9.81, 1.0 / 60.0);
        world.bodies[driven].set_linvel(Vector::Z, true);
        assert!(!is_resting(&world, bodies[0], &mut Vec::new()));
    }
}
