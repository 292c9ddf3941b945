//! How deep a body is in the colliders: a measure for tests and statistics.

use polpo_solver::Particles;
use rapier3d::dynamics::RigidBodySet;
use rapier3d::geometry::ColliderSet;
use rapier3d::math::Vector;

use crate::{ContactDetector, DetectionInput, Obstacles};

/// The greatest depth of any particle's ellipsoid below the true surface of any collider, now \[m\]; 0 if nothing overlaps.
///
/// `origin` is where the particles' origin is in the world, the translation of the body's `Transform`. For a solid the depth is how far the ellipsoid reaches in, also with its centre inside; for a
/// mesh without thickness it is how far it reaches through, at most to its centre, because a mesh does not say which side is the right one. Layers are ignored, sensors and disabled
/// colliders do not count.
///
/// Allocates, and takes every collider's snapshot: for tests and for a figure a second, not for every body in every step.
pub fn penetration(particles: &Particles, origin: Vector, bodies: &RigidBodySet, colliders: &ColliderSet) -> f32 {
    let mut obstacles = Obstacles::default();
    obstacles.gather(bodies, colliders, 0.0);
    let body = DetectionInput {
        particles,
        origin,
        acceleration: Vector::ZERO,
        dt: 0.0,
        friction: 0.0,
        frictions: &[],
        memberships: u32::MAX,
        filter: u32::MAX,
    };
    ContactDetector::default().deepest(&body, &obstacles, colliders)
}
