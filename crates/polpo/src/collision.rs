//! Collision: a body stays out of colliders.

use bevy::prelude::*;

use crate::particles::{Awake, for_each_body};
use crate::{ExplicitState, Particles, SubstepTime};

/// How a body meets colliders. Comes with every [`SoftBody`](crate::SoftBody).
///
/// The colliders come from elsewhere: `polpo_rapier` fills [`Contacts`] from Rapier's; a system of yours may do so in [`PolpoSystems::DetectContacts`](crate::PolpoSystems::DetectContacts).
#[derive(Component, Debug, Clone, Copy, PartialEq)]
#[require(Contacts, ContactMemory)]
pub struct Collision {
    /// Coulomb's coefficient of the body's skin, combined with the collider's by the collider's rule. Range 0 (ice) to infinity; default 0.6. Negative and NaN count as 0.
    pub friction: f32,
    /// The layers the body is in, one bit each. Default: the first.
    pub memberships: u32,
    /// The layers whose colliders the body meets. Default: all.
    pub filter: u32,
    /// The speed at most at which an overlap is undone that nobody's motion made, as after spawning inside a wall \[m/s\]. Range 0 (stays stuck) to infinity (may explode); default 3. Negative and NaN
    /// count as 0.
    pub push_speed: f32,
}

impl Default for Collision {
    fn default() -> Self {
        Self { friction: 0.6, memberships: 1, filter: u32::MAX, push_speed: 3.0 }
    }
}

/// A friction for each particle, instead of [`Collision`]'s one for all, against colliders; between bodies and of a body with itself there is one for all.
///
/// One coefficient a particle, in the rig's order, in the range of [`Collision::friction`]; a particle beyond the end has that.
#[derive(Component, Debug, Clone, Default, PartialEq)]
pub struct ParticleFriction(pub Vec<f32>);

/// The planes that the body's particles must stay above in this step. Refilled each step in phase `DetectContacts`.
#[derive(Component, Debug, Clone, Default, Deref, DerefMut)]
pub struct Contacts(pub polpo_solver::Contacts);

/// Where each particle was when it was last on the right side of everything, see [`FreePositions`](polpo_solver::FreePositions). Empty until somebody fills it, as `polpo_rapier` does; kept relative to the body's
/// present origin. Clear it after writing to a body's particles by hand; it is made anew.
#[derive(Component, Debug, Clone, Default, PartialEq, Deref, DerefMut)]
pub struct ContactMemory(pub polpo_solver::FreePositions);

/// A body that does not collide any more has nothing to lie on: pairs, groups and whoever lists what it touches would read its last planes for ever.
pub(crate) fn forget_planes(remove: On<Remove, Collision>, mut bodies: Query<(&mut Contacts, &mut ContactMemory)>) {
    if let Ok((mut contacts, mut memory)) = bodies.get_mut(remove.entity) {
        (*contacts, *memory) = default();
    }
}

pub(crate) fn solve_contacts(
    time: Res<SubstepTime>,
    mut bodies: Query<(&mut Particles, &mut Contacts, &Collision, Option<&ExplicitState>), Awake>,
) {
    for_each_body(
        &mut bodies,
        |(_, contacts, ..)| 60 * contacts.list.len(),
        |(mut particles, mut contacts, collision, explicit)| {
            let (dt, push_speed) = (time.delta, collision.push_speed.max(0.0));
            match explicit {
                Some(groups) => polpo_solver::solve_contacts_beside(groups, &mut contacts, &mut particles, dt, push_speed),
                None => polpo_solver::solve_contacts(&mut contacts, &mut particles, dt, push_speed),
            }
        },
    );
}
