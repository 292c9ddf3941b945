//! Which colliders a body touches: for sounds, for damage, for whoever puts bodies to sleep.

use bevy::prelude::*;
use polpo::{Awake, Contacts, Particles};
use rapier3d::dynamics::RigidBodyHandle;
use rapier3d::geometry::ColliderHandle;

use crate::plugin::{Detector, Surroundings};

/// The colliders that the body touches, or will touch within the running step. Refilled each step in phase `DetectContacts`; add it to the bodies of which you want to know.
#[derive(Component, Debug, Clone, Default, PartialEq)]
#[require(Contacts)]
pub struct TouchedColliders {
    /// One a collider, in the order of Rapier's set.
    pub list: Vec<Touch>,
}

/// What is known of a collider that a body touches.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Touch {
    /// The collider.
    pub collider: ColliderHandle,
    /// The rigid body that it belongs to, if any.
    pub body: Option<RigidBodyHandle>,
    /// Whether it moves in this step.
    pub moves: bool,
    /// The greatest speed at which a particle comes nearer to it, at the step's start \[m/s\]; 0 if all leave it.
    pub closing: f32,
}

pub(crate) fn list_touched(
    time: Res<Time>,
    surroundings: Res<Surroundings>,
    mut bodies: Query<(&Particles, &Contacts, &Detector, &mut TouchedColliders), Awake>,
) {
    let dt = time.delta_secs();
    for (particles, contacts, detector, mut touched) in &mut bodies {
        touched.list.clear();
        for (contact, &source) in contacts.list.iter().zip(&detector.0.sources) {
            let i = contact.particle as usize;
            if i >= particles.len() {
                continue;
            }
            let Some(obstacle) = surroundings.0.list.get(source as usize) else { continue };
            let n = contact.normal;
            let gap = n.dot(particles.position[i] - contact.point) - particles.ellipsoid(i).support(-n).0;
            let closing = -n.dot(particles.velocity[i] - contact.velocity);
            // What rests hovers by the rounding of its last step.
            if gap > closing.max(0.0) * dt + 0.01 * particles.radii[i].min_element() {
                continue;
            }
            let closing = closing.max(0.0);
            match touched.list.iter_mut().find(|touch| touch.collider == obstacle.handle) {
                Some(touch) => touch.closing = touch.closing.max(closing),
                None => {
                    let slot = obstacle.handle.into_raw_parts().0;
                    let at = touched.list.partition_point(|touch| touch.collider.into_raw_parts().0 < slot);
                    touched.list.insert(at, Touch { collider: obstacle.handle, body: obstacle.body, moves: obstacle.moves(), closing });
                }
            }
        }
    }
}
