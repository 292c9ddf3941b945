//! Stage 3, for rigid groups: what contacts did to single members acts on the whole.

use glam::DVec3;

use crate::rigid_groups::{finish, is_touched};
use crate::{ExplicitGroups, Particles};

/// Lets what contacts did to single members act on their rigid groups. To be called right after [`solve_contacts`](crate::solve_contacts).
///
/// A contact has moved its particle as if it were alone. Shared out by momentum, a wheel of a hundred particles would feel a hundredth of the way and sink into the ground. But the ground is to be left
/// whatever that takes: so the impulse p and the angular impulse τ that the member got are taken as a direction, and multiplied by the κ ≥ 0 with which the whole body gives way at the member as far
/// as the member did, κ·[|p|²/M + (r×p + τ)ᵀJ⁻¹(r×p + τ)] = p·Δv + τ·Δω. Several members' κ are found by projected Gauss–Seidel. Friction stays within Coulomb's cone, since p keeps its direction.
///
/// Only for contacts with what has no momentum to lose. After contacts with other particles call [`crate::match_explicit_groups`].
pub fn land_explicit_groups(groups: &mut ExplicitGroups, particles: &mut Particles, dt: f32) {
    for g in 0..groups.len() {
        if groups.bodies[g].acting && is_touched(groups, particles, g) {
            land(groups, particles, g);
            groups.bodies[g].changed = true;
        }
    }
    finish(groups, particles, f64::from(dt));
}

/// How often [`land`] goes over a group's touched members.
const LANDING_SWEEPS: usize = 10;

fn land(groups: &mut ExplicitGroups, particles: &Particles, g: usize) {
    let row = groups.row(g);
    let ExplicitGroups { bodies, held, shape, landings, .. } = groups;
    let body = &mut bodies[g];
    let mobility = body.mobility(body.end.rotation);
    landings.clear();
    for k in row {
        let i = shape.members[k] as usize;
        let h = &held[k];
        let dv = (particles.velocity[i] - h.velocity).as_dvec3();
        // A joint's spin is only ever compared with the group's that carries it.
        let dw = if h.carried { (particles.angular_velocity[i] - body.spin).as_dvec3() } else { DVec3::ZERO };
        let p = dv * f64::from(particles.mass[i]);
        let tau = if h.pinned[1] { DVec3::ZERO } else { dw * f64::from(particles.inertia[i]) };
        let torque = (body.end.rotation * body.arm(shape.rest[k])).cross(p) + tau;
        let yielding = p.length_squared() / body.mass + torque.dot(mobility * torque);
        if !h.pinned[0] && yielding > 0.0 {
            landings.push(Landing { p, torque, goal: p.dot(dv) + tau.dot(dw), yielding, factor: 0.0 });
        }
    }
    let (mut linear, mut angular) = (DVec3::ZERO, DVec3::ZERO);
    for _ in 0..LANDING_SWEEPS {
        for l in &mut *landings {
            let reached = l.p.dot(linear) / body.mass + l.torque.dot(mobility * angular);
            let factor = (l.factor + (l.goal - reached) / l.yielding).max(0.0);
            linear += l.p * (factor - l.factor);
            angular += l.torque * (factor - l.factor);
            l.factor = factor;
        }
    }
    body.linear += linear;
    body.angular += angular;
}

/// The impulse of a contact on a member, and about the group's centre; how fast the member yielded to it, how fast the group would.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Landing {
    p: DVec3,
    torque: DVec3,
    goal: f64,
    yielding: f64,
    factor: f64,
}
