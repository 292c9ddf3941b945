//! Soft bodies that push rigid ones.

use bevy::ecs::query::QueryData;
use bevy::math::Vec3A;
use bevy::prelude::*;
use polpo::{Awake, Collision, Contacts, Edges, ExplicitState, Gravity, ImplicitGroups, Particles, PinTarget, Pins, SubstepTime};
use polpo_solver::{Movers, PushContact, RigidMover, Tie, begin_pushes, solve_pushes as sweep_pushes, solve_ties, undo_overlaps};
use rapier3d::dynamics::RigidBodyHandle;

use crate::movers::{Reaction, add_feet, center_arm, hand_over as hand_over_one, is_pushable, is_pushed, mover_of, take_off};
use crate::plugin::{Detector, Surroundings};
use crate::{RapierWorld, RigidBodyFollower};

/// The body's contacts with dynamic rigid bodies, and its pins to them, give back what they take: the momentum of the pair is conserved. Without it dynamic bodies push the soft one as if they were driven.
///
/// Within the soft bodies' substeps the rigid body is a proxy that takes each impulse at once; the sum is handed to Rapier before its step, and wakes the body. Locked axes stay locked. A particle that is jammed between a
/// rigid body and the ground carries it as the ground would, whatever their masses.
///
/// What goes wrong: a body on joints gives way in the substeps as if it had none, and Rapier's step puts it right; a light rigid body under a heavy soft one is pressed into what it
/// stands on for the length of a step. Rapier puts a body to sleep by its speed, this wakes it as long as a soft body that is awake touches it.
#[derive(Component, Debug, Clone, Copy, Default, PartialEq, Eq)]
#[require(PushState, Contacts)]
pub struct PushRigidBodies;

/// The contacts with rigid bodies that a body pushes, in the running step. Comes with [`PushRigidBodies`].
#[derive(Component, Debug, Clone, Default)]
pub struct PushState {
    /// Its contacts; they are not in [`Contacts`].
    pub contacts: Vec<PushContact>,
    /// Its pins to rigid bodies.
    pub ties: Vec<Tie>,
    /// The velocity and spin that tied particles had before they were pinned, and their pins.
    tied: Vec<Tied>,
}

#[derive(Debug, Clone, Copy)]
struct Tied {
    pin: usize,
    body: RigidBodyHandle,
    velocity: Vec3A,
    spin: Vec3A,
}

/// The rigid bodies that are pushed in this step.
#[derive(Resource, Default)]
pub(crate) struct Pushing {
    /// The soft bodies that push, in the order in which they are solved: that of their entities, not of where their components lie in memory.
    order: Vec<Entity>,
    movers: Movers,
    /// Theirs, in the same order.
    handles: Vec<RigidBodyHandle>,
    /// The forces that the game applies to those that were pushed.
    forces: Vec<(RigidBodyHandle, Vec3, Vec3)>,
    /// The velocities that those on joints would have after Rapier's step without joints and gravity, and what these made of them in the last.
    sent: Vec<(RigidBodyHandle, Vec3, Vec3)>,
    pub(crate) reactions: Vec<Reaction>,
}

impl Pushing {
    /// Those that are pushed in this step.
    pub(crate) fn handles(&self) -> &[RigidBodyHandle] {
        &self.handles
    }

    /// The index of the mover for `body`, added if it is new. `None` if it cannot be pushed.
    fn index_of(&mut self, world: &RapierWorld, body: RigidBodyHandle, gravity: Vec3) -> Option<usize> {
        if let Some(index) = self.handles.iter().position(|&other| other == body) {
            return Some(index);
        }
        let mover = mover_of(world, body, gravity, &self.reactions)?;
        let index = self.handles.len();
        self.handles.push(body);
        self.movers.list.push(mover);
        add_feet(&mut self.movers, index, world, body);
        Some(index)
    }
}

/// Before `Prepare`, where pins take hold: remembers the velocities of particles that are pinned to what gives way.
pub(crate) fn free_the_tied(
    world: Res<RapierWorld>,
    followers: Query<&RigidBodyFollower>,
    mut bodies: Query<(&Particles, &Pins, &mut PushState), (With<PushRigidBodies>, Awake)>,
) {
    for (particles, pins, mut state) in &mut bodies {
        state.tied.clear();
        for (index, pin) in pins.list.iter().enumerate() {
            let i = pin.particle as usize;
            // The last pin of a particle counts.
            let counts = i < particles.len() && !pins.list[index + 1..].iter().any(|later| later.particle == pin.particle);
            if let PinTarget::Entity(entity, offset, rotation) = pin.to
                && let Ok(follower) = followers.get(entity)
                && counts
                && (pin.position || pin.rotation)
                && offset.is_finite()
                && rotation.is_finite()
                && is_pushable(&world, follower.0)
            {
                state.tied.push(Tied {
                    pin: index,
                    body: follower.0,
                    velocity: particles.velocity[i],
                    spin: particles.angular_velocity[i],
                });
            }
        }
    }
}

/// In phase `DetectContacts`: parts the contacts with what gives way from those with what does not.
pub(crate) fn gather_movers(
    gravity: Res<Gravity>,
    world: Res<RapierWorld>,
    surroundings: Res<Surroundings>,
    mut pushing: ResMut<Pushing>,
    pushers: Query<Entity, (With<PushRigidBodies>, Awake)>,
    mut bodies: Query<
        (&mut Particles, &Transform, &mut Contacts, &Detector, Option<&Pins>, &mut PushState),
        (With<PushRigidBodies>, Awake),
    >,
) {
    let pushing = &mut *pushing;
    pushing.movers.list.clear();
    pushing.movers.feet.clear();
    pushing.handles.clear();
    pushing.order.clear();
    pushing.order.extend(&pushers);
    pushing.order.sort_unstable();
    for at in 0..pushing.order.len() {
        let Ok((mut particles, transform, mut contacts, detector, pins, mut state)) = bodies.get_mut(pushing.order[at]) else { continue };
        let origin = transform.translation;
        let center_of = |body: RigidBodyHandle| {
            world.bodies.get(body).map(|body| (body.position().translation - origin) + center_arm(body)).map(Vec3A::from)
        };
        let PushState { contacts: pushes, ties, tied } = &mut *state;
        pushes.clear();
        let mut at = 0;
        contacts.list.retain(|contact| {
            let source = detector.0.sources.get(at).and_then(|&source| surroundings.0.list.get(source as usize));
            at += 1;
            let Some(obstacle) = source else { return true };
            let Some(body) = obstacle.body else { return true };
            let (Some(mover), Some(center)) = (pushing.index_of(&world, body, gravity.0), center_of(body)) else { return true };
            let new = PushContact::new(contact.particle, mover as u32, center, contact.point - center, contact.normal);
            let extra = contact.angular_velocity - Vec3A::from(obstacle.angular_velocity);
            pushes.push(PushContact { friction: contact.friction, extra, ..new });
            false
        });
        // Both lists are in the order of the particles.
        let mut from = 0;
        for push in &mut *pushes {
            let before = |from: usize| contacts.list.get(from).is_some_and(|contact| contact.particle < push.particle);
            while before(from) {
                from += 1;
            }
            let own = contacts.list[from..].iter().take_while(|contact| contact.particle == push.particle).count();
            push.support = [from as u32, (from + own) as u32];
        }
        ties.clear();
        for tied in tied.drain(..) {
            let Some(pin) = pins.and_then(|pins| pins.list.get(tied.pin)) else { continue };
            let i = pin.particle as usize;
            let (PinTarget::Entity(_, offset, rotation), Some(body)) = (pin.to, world.bodies.get(tied.body)) else { continue };
            let (Some(mover), Some(center)) = (pushing.index_of(&world, tied.body, gravity.0), center_of(tied.body)) else { continue };
            if i >= particles.len() {
                continue;
            }
            particles.pin(i, false, false);
            particles.velocity[i] = tied.velocity;
            particles.angular_velocity[i] = tied.spin;
            let axes = body.position().rotation;
            ties.push(Tie {
                particle: pin.particle,
                mover: mover as u32,
                center,
                arm: (axes * (offset - body.local_center_of_mass())).into(),
                rotation: (axes * rotation).normalize(),
                holds: [pin.position, pin.rotation],
                impulse: Vec3A::ZERO,
            });
        }
    }
}

type Groups = (&'static mut ExplicitState, Option<&'static mut ImplicitGroups>, Option<&'static mut Edges>);

/// A blow from what gives way opens groups as one from the ground does.
fn strike(
    contacts: &[PushContact],
    movers: &Movers,
    particles: &Particles,
    dt: f32,
    (mut groups, implicit, edges): <Groups as QueryData>::Item<'_, '_>,
) {
    let revision = groups.revision();
    for contact in contacts {
        groups.strike(contact.particle, contact.closing_speed(movers, particles, dt));
    }
    if groups.revision() != revision {
        if let Some(mut implicit) = implicit {
            implicit.rest_where_held(&groups);
        }
        if let Some(mut edges) = edges {
            edges.rest_where_held(&groups);
        }
    }
}

/// In every substep, after contacts with what does not give way.
pub(crate) fn solve_pushes(
    time: Res<SubstepTime>,
    mut pushing: ResMut<Pushing>,
    mut bodies: Query<(Entity, &mut Particles, &Contacts, &Collision, &mut PushState), (With<PushRigidBodies>, Awake)>,
    mut groups: Query<Groups>,
) {
    /// Sweeps over all contacts. A box on dozens of jammed particles has settled by then to 1e-5 of its speed.
    const SWEEPS: usize = 8;
    let Pushing { order, movers, .. } = &mut *pushing;
    if movers.list.is_empty() {
        return;
    }
    let dt = time.delta;
    movers.begin(dt);
    let mut each = bodies.iter_many_mut(&*order);
    while let Some((entity, particles, _, _, mut state)) = each.fetch_next() {
        if let Ok(groups) = groups.get_mut(entity) {
            strike(&state.contacts, movers, &particles, dt, groups);
        }
        begin_pushes(&mut state.contacts, movers, &particles, dt);
        for tie in &mut state.ties {
            tie.impulse = Vec3A::ZERO;
        }
    }
    for _ in 0..SWEEPS {
        let mut each = bodies.iter_many_mut(&*order);
        while let Some((_, mut particles, contacts, _, mut state)) = each.fetch_next() {
            solve_ties(&mut state.ties, movers, &mut particles, dt);
            sweep_pushes(&mut state.contacts, movers, &contacts.list, &mut particles, dt);
        }
        movers.stand(dt);
    }
    let mut each = bodies.iter_many_mut(&*order);
    while let Some((_, mut particles, contacts, collision, mut state)) = each.fetch_next() {
        undo_overlaps(&mut state.contacts, movers, &contacts.list, &mut particles, dt, collision.push_speed.max(0.0));
        for tie in &state.ties {
            if let Some(reaction) = particles.reaction.get_mut(tie.particle as usize) {
                *reaction += tie.impulse;
            }
        }
    }
    movers.list.iter_mut().for_each(RigidMover::settle);
}

/// Before Rapier's step: rigid bodies get what their proxies got.
pub(crate) fn hand_over(time: Res<Time>, mut pushing: ResMut<Pushing>, mut world: ResMut<RapierWorld>) {
    let Pushing { movers, handles, forces, sent, .. } = &mut *pushing;
    forces.clear();
    sent.clear();
    let (dt, solver_steps) = (time.delta_secs(), world.parameters.num_solver_iterations);
    if dt <= 0.0 {
        return;
    }
    for (index, (mover, &handle)) in movers.list.iter().zip(&*handles).enumerate() {
        // Asking for it mutably would already count as a change.
        if is_pushed(mover)
            && let Some(body) = world.bodies.get_mut(handle)
        {
            forces.push((handle, body.user_force(), body.user_torque()));
            let has_feet = movers.feet.iter().any(|foot| foot.mover as usize == index);
            hand_over_one(mover, has_feet, body, dt, solver_steps);
        }
        if mover.anchored
            && let Some(body) = world.bodies.get(handle)
        {
            let given = Vec3::from(mover.impulse * mover.inverse_mass);
            let spun = Vec3::from(mover.inverse_inertia * mover.angular_impulse);
            sent.push((handle, body.linvel() + given, body.angvel() + spun));
        }
    }
}

/// After it: takes the impulses off again, and notes what joints did.
pub(crate) fn after_rapier(time: Res<Time>, mut pushing: ResMut<Pushing>, mut world: ResMut<RapierWorld>) {
    let Pushing { forces, sent, reactions, .. } = &mut *pushing;
    for (handle, force, torque) in forces.drain(..) {
        if let Some(body) = world.bodies.get_mut(handle) {
            take_off(body, force, torque);
        }
    }
    reactions.clear();
    let dt = time.delta_secs();
    if dt > 0.0 {
        reactions.extend(sent.iter().filter_map(|&(body, linear, angular)| {
            let now = world.bodies.get(body)?;
            Some(Reaction { body, linear: (now.linvel() - linear) / dt, angular: (now.angvel() - angular) / dt })
        }));
    }
}
