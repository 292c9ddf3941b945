//! Contacts: the planes that particles must stay above during one step.

use glam::{Vec3, Vec3A};

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
    /// In the order in which they are solved. The planes of one particle stand side by side: where they do not, each is solved as if it were the only one.
    pub list: Vec<Contact>,
}

/// Where each particle's centre was when it was last on the right side of everything, relative to the body's origin. Keep one a body from step to step.
///
/// It is how a particle that its neighbours pulled through a thin floor or a bare triangle mesh is known to be on the wrong side: the way from there to here crosses the surface. It follows the
/// particle as long as that does not happen.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FreePositions {
    /// One a particle \[m\]. Another number of them than there are particles means that nothing is known.
    pub position: Vec<Vec3>,
}
