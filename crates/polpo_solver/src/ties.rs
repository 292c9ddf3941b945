//! Stage 3, for what is tied to a rigid body that gives way.

use glam::{Mat3A, Quat, Vec3A};

use crate::{Movers, Particles, RigidMover, quat_log};

/// A particle tied to a place of a [`RigidMover`], in position, orientation or both, so that each pulls the other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tie {
    /// The particle.
    pub particle: u32,
    /// Index of the mover.
    pub mover: u32,
    /// Where the mover's centre of mass was at the step's start, relative to the body's origin \[m\].
    pub center: Vec3A,
    /// From there to the place, at the step's start \[m\].
    pub arm: Vec3A,
    /// The rotation since rest that the particle had there at the step's start.
    pub rotation: Quat,
    /// Whether the position is held, and whether the orientation is.
    pub holds: [bool; 2],
    /// What the tie gave the particle in the running substep \[N·s\]; set it to 0 at its start.
    pub impulse: Vec3A,
}

/// Distances from the place that nobody's motion made, as when a tie is new, are undone at this speed at most \[m/s\].
const PULL_SPEED: f32 = 3.0;

/// One sweep over ties within a substep of `dt` \[s\].
///
/// *Position.* With e the distance between the particle and the place, and K = w_particle·1 − \[a\]×J⁻¹\[a\]× + 1/M the velocity that an impulse between them makes, the impulse K⁻¹(−e/Δt) closes it. It acts at the
/// particle's centre of when the substep began, which keeps P and L to rounding, see [`RigidMover::push`].
///
/// *Orientation.* With θ the turn that is missing, the angular impulse (1/I + J⁻¹)⁻¹θ/Δt.
///
/// Degenerate: between two that cannot move, nothing happens. A tie of a particle or a mover that does not exist is skipped.
pub fn solve_ties(ties: &mut [Tie], movers: &mut Movers, particles: &mut Particles, dt: f32) {
    for tie in ties {
        let Some(mover) = movers.list.get_mut(tie.mover as usize) else { continue };
        if (tie.particle as usize) < particles.len() {
            if tie.holds[0] {
                hold_position(tie, mover, particles, dt);
            }
            if tie.holds[1] {
                hold_rotation(tie, mover, particles, dt);
            }
        }
    }
}

fn hold_position(tie: &mut Tie, mover: &mut RigidMover, p: &mut Particles, dt: f32) {
    let i = tie.particle as usize;
    let arm = mover.rotation * tie.arm;
    let start = tie.center + mover.way;
    let before = p.previous_position[i] - (start + arm);
    let now = p.position[i] - (start + mover.step + mover.turn * arm);
    let left = before - before.clamp_length_max(PULL_SPEED * dt);
    let w = p.inverse_mass[i];
    let at = p.position[i] - p.velocity[i] * dt - start;
    let cross = skew(at);
    let k = Mat3A::from_diagonal((mover.inverse_mass + w).into()) - cross * mover.inverse_inertia * cross;
    if let Some(j) = solved(k, (left - now) / dt) {
        tie.impulse += j;
        p.displace(i, j * (w * dt), 1.0 / dt);
        mover.push(-j, at, dt);
    }
}

fn hold_rotation(tie: &Tie, mover: &mut RigidMover, p: &mut Particles, dt: f32) {
    let i = tie.particle as usize;
    let goal = mover.turn * mover.rotation * tie.rotation;
    let missing = quat_log(goal * p.rotation[i].inverse()).clamp_length_max(PULL_TURN);
    let spin = p.inverse_inertia[i];
    let k = Mat3A::from_diagonal(Vec3A::splat(spin).into()) + mover.inverse_inertia;
    if let Some(t) = solved(k, missing / dt) {
        p.turn(i, t * (spin * dt), 1.0 / dt);
        mover.twist(-t, dt);
    }
}

/// No tie turns a particle by more than this in one go \[rad\].
const PULL_TURN: f32 = 0.5;

fn skew(v: Vec3A) -> Mat3A {
    Mat3A::from_cols(Vec3A::new(0.0, v.z, -v.y), Vec3A::new(-v.z, 0.0, v.x), Vec3A::new(v.y, -v.x, 0.0))
}

/// `k`⁻¹·`b` for a `k` that is symmetric and not negative; `None` if it is singular or the result not finite.
fn solved(k: Mat3A, b: Vec3A) -> Option<Vec3A> {
    let scale = k.x_axis.x.max(k.y_axis.y).max(k.z_axis.z);
    if !(scale > 0.0 && scale.is_finite()) {
        return None;
    }
    let k = k * (1.0 / scale);
    if k.determinant() < 1e-12 {
        return None;
    }
    let x = k.inverse() * b / scale;
    x.is_finite().then_some(x)
}
