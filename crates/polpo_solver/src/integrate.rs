//! Stage 4: velocities from what the constraints left of the motion.

use glam::Quat;

use crate::{Particles, quat_log};

/// ω = log(q·q_previous⁻¹)/Δt; v has been summed up on the way (see [`Particles::displace`]) and is (x − x_previous)/Δt. Then drag: both times e^(−k·Δt) for the rate `drag` k \[1/s\].
///
/// e^(−kΔt) rather than a factor per step, so that the same k slows the same body equally at every time step. Range of `drag`: 0 (none) to infinity (stops at once).
pub fn integrate(particles: &mut Particles, dt: f32, drag: f32) {
    let mut keep = 1.0;
    if drag > 0.0 {
        keep = libm::expf(-drag * dt);
        for v in &mut particles.velocity {
            *v *= keep;
        }
    }
    let rate = keep / dt;
    for ((omega, q), previous) in particles.angular_velocity.iter_mut().zip(&particles.rotation).zip(&particles.previous_rotation) {
        let turn: Quat = *q * previous.inverse();
        *omega = quat_log(turn) * rate;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{ParticleRest, predict};
    use glam::Vec3A;

    #[test]
    fn drag_does_not_depend_on_the_time_step() {
        for rate in [30, 60, 240] {
            let mut p =
                Particles::new(&[ParticleRest { position: Vec3A::ZERO, frame: Quat::IDENTITY, radii: Vec3A::ONE, mass: 1.0 }]).unwrap();
            p.velocity[0] = Vec3A::X;
            p.angular_velocity[0] = Vec3A::Y;
            let dt = 1.0 / rate as f32;
            for _ in 0..rate {
                predict(&mut p, Vec3A::ZERO, dt);
                integrate(&mut p, dt, 2.0);
            }
            assert!((p.velocity[0].x - (-2.0f64).exp() as f32).abs() < 1e-4);
            assert!((p.angular_velocity[0].y - (-2.0f64).exp() as f32).abs() < 1e-4);
        }
    }
}
