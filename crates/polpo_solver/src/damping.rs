//! Internal damping: a body's wobble dies, its flight and its spin do not.

use glam::Vec3A;

use crate::momentum::solve_inertia;
use crate::{Particles, momentum};

/// Draws every particle's velocity towards that of the rigid body with the same momentum: by the share 1 − e^(−k·Δt) for the rate `rate` k \[1/s\] (0: none, infinity: at once).
///
/// The rigid motion has the velocity P/M at the centre of mass and ω = J⁻¹L with J the inertia including spin, so pulling v_i towards P/M + ω×r_i and ω_i towards ω leaves P and L as
/// they were. If J is singular (a single particle without extent) only the linear part is used. What is pinned keeps its velocity.
pub fn damp_internally(particles: &mut Particles, dt: f32, rate: f32) {
    if rate.is_nan() || rate <= 0.0 || particles.is_empty() {
        return;
    }
    let share = 1.0 - libm::expf(-rate * dt);
    let total = momentum(particles);
    let linear = total.linear / total.mass;
    let turning = solve_inertia(total.inertia, total.angular);
    let omega = turning.unwrap_or(Vec3A::ZERO);
    for i in 0..particles.len() {
        if particles.inverse_mass[i] > 0.0 {
            let rigid = linear + omega.cross(particles.position[i] - total.center);
            let v = particles.velocity[i];
            particles.velocity[i] += (rigid - v) * share;
        }
        if turning.is_some() && particles.inverse_inertia[i] > 0.0 {
            let w = particles.angular_velocity[i];
            particles.angular_velocity[i] += (omega - w) * share;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{Random, blob};

    #[test]
    fn momentum_is_kept_and_wobble_dies() {
        let (mut p, _) = blob();
        let mut random = Random(11);
        for i in 0..p.len() {
            p.velocity[i] = random.vector() + Vec3A::X;
            p.angular_velocity[i] = random.vector() * 3.0;
        }
        let before = momentum(&p);
        for _ in 0..100 {
            damp_internally(&mut p, 0.01, 5.0);
        }
        let after = momentum(&p);
        assert!(after.linear.distance(before.linear) < 1e-5 * before.linear.length());
        assert!(after.angular.distance(before.angular) < 1e-4 * before.angular.length());
        let mut rigid = p.clone();
        rigid.set_rigid_velocity(after.linear / after.mass, after.inertia.inverse() * after.angular);
        let least = momentum(&rigid).kinetic_energy;
        assert!(after.kinetic_energy < before.kinetic_energy);
        assert!(after.kinetic_energy - least < 1e-3 * (before.kinetic_energy - least));
    }

    #[test]
    fn a_rigid_motion_is_not_damped() {
        let (mut p, _) = blob();
        p.set_rigid_velocity(Vec3A::new(1.0, 2.0, 3.0), Vec3A::new(0.5, -4.0, 1.0));
        let before = p.clone();
        damp_internally(&mut p, 0.1, 10.0);
        for i in 0..p.len() {
            assert!(p.velocity[i].distance(before.velocity[i]) < 1e-4);
        }
    }
}
