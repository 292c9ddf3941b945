//! Stage 1: where the particles would go if nothing held them.

use core::f32::consts::PI;

use fearless_simd::prelude::*;
use fearless_simd::{Level, dispatch};
use glam::{Quat, Vec3A};

use crate::lanes::{Eights, LANES, Lanes, Rows, SMALL, bits};
use crate::{Particles, quat_exp};

/// Remembers where the substep of `dt` \[s\] begins and moves every particle by its velocity: v += Δt·a, x += Δt·v, q = exp(ω·Δt)·q, for the acceleration `a` \[m/s²\].
///
/// What is pinned feels no acceleration and goes on at the velocity it has, which whoever pinned it sets.
///
/// Returns how many spins were clamped: a rotation by more than π within one substep cannot be told from the shorter one the other way round, so |ω|·Δt is limited to π. More substeps
/// are the cure.
pub fn predict(particles: &mut Particles, acceleration: Vec3A, dt: f32) -> usize {
    particles.rigid_push.clear();
    let limit = PI / dt;
    let dv = acceleration * dt;
    let moving = particles.position.iter_mut().zip(&mut particles.previous_position).zip(&mut particles.velocity);
    for (((x, previous), v), &w) in moving.zip(&particles.inverse_mass) {
        *previous = *x;
        if w > 0.0 {
            *v += dv;
        }
        *x += *v * dt;
    }
    let mut clamped = 0;
    for omega in &mut particles.angular_velocity {
        if omega.length_squared() > limit * limit {
            *omega = omega.normalize_or_zero() * limit;
            clamped += 1;
        }
    }
    particles.previous_rotation.copy_from_slice(&particles.rotation);
    dispatch!(Level::new(), simd => turn_in_lanes(Lanes::<_, false>(simd), &mut particles.rotation, &particles.angular_velocity, dt));
    clamped
}

/// q = exp(ω·Δt)·q, eight at a time; those that turn by more than half a radian one by one.
#[inline(always)]
fn turn_in_lanes<S: Simd>(lanes: Lanes<S, false>, rotation: &mut [Quat], spin: &[Vec3A], dt: f32) {
    let spin = Eights::of(spin);
    let (full, rest) = rotation.as_chunks_mut();
    let mut last = [Quat::default(); LANES];
    last[..rest.len()].copy_from_slice(rest);
    for (k, q) in full.iter_mut().chain([&mut last]).enumerate() {
        let omega = spin.get(k);
        let half = lanes.vectors(|l| omega[l]) * lanes.splat(0.5 * dt);
        let far = !(lanes.length_squared(half).simd_lt(SMALL).to_bitmask() as u8);
        let turned = lanes.product(lanes.half_exp(half), lanes.quats(|l| q[l]));
        let mut rows = Rows::default();
        rows.store(lanes.normalize(turned).columns());
        if far != 0 {
            turn_far(&mut rows, far, q, omega, dt);
        }
        for (l, q) in q.iter_mut().enumerate() {
            *q = rows.quat(l);
        }
    }
    rest.copy_from_slice(&last[..rest.len()]);
}

#[cold]
fn turn_far(rows: &mut Rows, far: u8, q: &[Quat; LANES], omega: &[Vec3A; LANES], dt: f32) {
    for l in bits(far) {
        rows.set(l, (quat_exp(omega[l] * dt) * q[l]).normalize().into());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{ParticleRest, integrate, quat_log};

    fn one() -> Particles {
        Particles::new(&[ParticleRest { position: Vec3A::ZERO, frame: Quat::IDENTITY, radii: Vec3A::splat(0.1), mass: 2.0 }]).unwrap()
    }

    /// Symplectic Euler errs by exactly ½·g·Δt·t on a fall from rest.
    #[test]
    fn free_fall_errs_as_symplectic_euler_does() {
        let mut p = one();
        let dt = 1.0 / 60.0;
        for _ in 0..60 {
            predict(&mut p, Vec3A::new(0.0, -9.81, 0.0), dt);
            integrate(&mut p, dt, 0.0);
        }
        let expected = -0.5 * 9.81 - 0.5 * 9.81 * dt;
        assert!((p.position[0].y - expected).abs() < 2e-5, "{} against {expected}", p.position[0].y);
    }

    #[test]
    fn spin_is_kept_and_clamped_at_half_a_turn_a_substep() {
        let mut p = one();
        p.angular_velocity[0] = Vec3A::new(1.0, 2.0, -2.0);
        assert_eq!(predict(&mut p, Vec3A::ZERO, 0.01), 0);
        assert!((quat_log(p.rotation[0]) - Vec3A::new(0.01, 0.02, -0.02)).length() < 1e-7);
        integrate(&mut p, 0.01, 0.0);
        assert!((p.angular_velocity[0] - Vec3A::new(1.0, 2.0, -2.0)).length() < 3e-5);
        p.angular_velocity[0] = Vec3A::X * 1e6;
        assert_eq!(predict(&mut p, Vec3A::ZERO, 0.01), 1);
        assert!(p.rotation[0].is_finite());
    }
}
