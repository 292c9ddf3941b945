//! Contacts: the planes that particles must stay above during one step.

use glam::Vec3A;

/// The tangent plane of a collider at the point nearest to a particle, or at the point its path meets.
///
/// All vectors are relative to the body's origin and in its axes, as of the start of the step; [`solve_contacts`](crate::solve_contacts) carries the plane along with the surface's velocity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contact {
    /// The particle that must stay above the plane.
    pub particle: u32,
    /// Coulomb's coefficient μ, 0 … ∞.
    pub friction: f32,
    /// A point of the surface \[m\].
    pub point: Vec3A,
    /// Unit normal, out of the collider, towards the particle.
    pub normal: Vec3A,
    /// Velocity of the surface at `point` \[m/s\].
    pub velocity: Vec3A,
    /// Angular velocity of the surface \[rad/s\].
    pub angular_velocity: Vec3A,
    /// The normal impulse of the last substep \[N·s\]; written by the solver.
    pub impulse: f32,
}

/// The contacts of one body, found once a step. Cleared and refilled, so that a warmed-up step allocates nothing.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Contacts {
    /// In the order in which they are solved.
    pub list: Vec<Contact>,
}
