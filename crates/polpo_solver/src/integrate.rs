//! Stage 4: what is left of the motion.

use crate::Particles;

/// Drag: v and ω times e^(−k·Δt) for the rate `drag` k \[1/s\]. Both velocities have been summed up on the way, see [`Particles::displace`] and [`Particles::turn`]. What is pinned keeps its own.
///
/// e^(−kΔt) rather than a factor per step, so that the same k slows the same body equally at every time step. Range of `drag`: 0 (none) to infinity (stops at once).
pub fn integrate(particles: &mut Particles, dt: f32, drag: f32) {
    if drag > 0.0 {
        let keep = libm::expf(-drag * dt);
        for i in 0..particles.len() {
            if particles.inverse_mass[i] > 0.0 {
                particles.velocity[i] *= keep;
            }
            if particles.inverse_inertia[i] > 0.0 {
                particles.angular_velocity[i] *= keep;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{ParticleRest, predict};
    use glam::{Quat, Vec3A};

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
