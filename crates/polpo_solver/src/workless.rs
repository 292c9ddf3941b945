//! Work: what nothing can bend does none.
//!
//! A constraint that gives holds energy, ½·k·e², which it gives back. One that corrects its whole error at once holds none: by d'Alembert's principle its forces do no work. Yet the way by which it moves a particle enters the velocity
//! at way/Δt, and where nobody's motion made the error (a body that starts squashed, inside out or in one point, or that a collider bends) that is as if it were a spring of stiffness m/Δt²: ½·m·(e/Δt)². Also a body that turns by
//! a good part of a radian a substep, and so is drawn out and in again, would gain by it what the restoring of its angular momentum adds.
//!
//! So those that rigid constraints have moved in a substep get no more kinetic energy, in all, than they would have without. What is beyond is taken from how they move against each other, which leaves P and L, spin included, as they
//! were:
//!
//! ```text
//! v_i ← V + ω×r_i + k·(v_i − V − ω×r_i),   ω_i ← ω + k·(ω_i − ω),   k² = (E − E_rigid)/(E_now − E_rigid)
//! ```
//!
//! with V = P/M, ω = J⁻¹L and E_rigid the energy of that rigid motion about the centre of mass. Places are not touched: the shape is put right at once. Degenerate: if E_rigid alone is beyond, because J has shrunk, k = 0 and ω is cut,
//! and with it L; that takes a body drawn together to less than its shape while it spins.

use glam::{DMat3, DVec3, Vec3A};

use crate::Particles;
use crate::block_cholesky::invert;

/// What sums of kinetic energy can differ by because velocities are in `f32`, as a share.
const ROUNDING: f64 = 1e-6;

/// Who was moved by what nothing bends.
fn pushed(p: &Particles) -> impl Iterator<Item = usize> {
    p.rigid_push.iter().enumerate().filter(|(_, push)| **push != [Vec3A::ZERO; 2]).map(|(i, _)| i)
}

/// The kinetic energy about their centre of mass \[J\] that those whom rigid constraints have moved in this substep would have without. `None` if there are none.
pub(crate) fn allowed_energy(p: &Particles) -> Option<f64> {
    let (mut mass, mut linear, mut energy) = (0.0, DVec3::ZERO, 0.0);
    for i in pushed(p) {
        let [push, turn] = p.rigid_push[i];
        let [m, inertia] = [p.mass[i], p.inertia[i]].map(f64::from);
        let (v, spin) = ((p.velocity[i] - push).as_dvec3(), (p.angular_velocity[i] - turn).as_dvec3());
        mass += m;
        linear += v * m;
        energy += 0.5 * (m * v.length_squared() + inertia * spin.length_squared());
    }
    (mass > 0.0).then(|| (energy - 0.5 * linear.length_squared() / mass).max(0.0))
}

/// Takes from those whom rigid constraints have moved in this substep what they have in kinetic energy about their centre of mass beyond `allowed` \[J\].
pub(crate) fn shed_energy(p: &mut Particles, allowed: f64) {
    let (mut mass, mut center, mut linear) = (0.0, DVec3::ZERO, DVec3::ZERO);
    for i in pushed(p) {
        let m = f64::from(p.mass[i]);
        mass += m;
        center += p.position[i].as_dvec3() * m;
        linear += p.velocity[i].as_dvec3() * m;
    }
    (center, linear) = (center / mass, linear / mass);
    let (mut inertia, mut angular, mut energy) = (DMat3::ZERO, DVec3::ZERO, 0.0);
    for i in pushed(p) {
        let [m, spin] = [p.mass[i], p.inertia[i]].map(f64::from);
        let (r, v, w) = (p.position[i].as_dvec3() - center, p.velocity[i].as_dvec3() - linear, p.angular_velocity[i].as_dvec3());
        inertia += DMat3::from_diagonal(DVec3::splat(m * r.length_squared() + spin))
            - DMat3::from_cols(r * (m * r.x), r * (m * r.y), r * (m * r.z));
        angular += r.cross(v) * m + w * spin;
        energy += 0.5 * (m * v.length_squared() + spin * w.length_squared());
    }
    // Also false for what is not finite.
    let beyond = energy > allowed * (1.0 + ROUNDING);
    if !beyond {
        return;
    }
    let omega = invert(inertia) * angular;
    let rigid = 0.5 * omega.dot(angular);
    let keep = ((allowed - rigid).max(0.0) / (energy - rigid)).sqrt().min(1.0);
    let turn = if rigid > allowed * (1.0 + ROUNDING) { (allowed / rigid).sqrt() } else { 1.0 };
    for i in 0..p.len() {
        if p.rigid_push[i] != [Vec3A::ZERO; 2] {
            let (v, w) = (p.velocity[i].as_dvec3() - linear, p.angular_velocity[i].as_dvec3());
            let turned = omega.cross(p.position[i].as_dvec3() - center);
            p.velocity[i] = (linear + turned * turn + (v - turned) * keep).as_vec3a();
            p.angular_velocity[i] = (omega * turn + (w - omega) * keep).as_vec3a();
        }
    }
}
