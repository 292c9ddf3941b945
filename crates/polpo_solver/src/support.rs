//! Support: which particles lie on a collider, so that pairs know what bears them.

use glam::Vec3A;

use crate::{Contacts, Particles};

/// Which particles lie on a collider as the substep of `dt` \[s\] is about to solve contacts: the collider's normal for each that does, zero for the others; nothing if none does.
///
/// A pair in which something far heavier presses a particle into what it lies on cannot move it, and takes it for immovable: the collider would give back at once what the pair gave it. Taken for movable, a light particle between the
/// ground and a heavy one would be thrown to and fro and bear next to nothing.
pub fn find_support(contacts: &Contacts, p: &Particles, dt: f32, support: &mut Vec<Vec3A>) {
    support.clear();
    for contact in &contacts.list {
        let i = contact.particle as usize;
        if i < p.len()
            && contact.normal.dot(p.position[i] - contact.point - contact.velocity * dt) <= p.ellipsoid(i).support(contact.normal).0
        {
            support.resize(p.len(), Vec3A::ZERO);
            support[i] = contact.normal;
        }
    }
}
