//! The air's drag on ellipsoids.

use core::f32::consts::PI;

use glam::Vec3A;

use crate::{Ellipsoid, Particles};

impl Ellipsoid {
    /// The area of the shadow it throws along the unit vector `n` \[m²\].
    ///
    /// The shadow of the unit ball mapped by Q·diag(a, b, c) has the area π·|cof(Q·diag)·n| with the cofactor Q·diag(bc, ca, ab): π·√((bc·n_x)² + (ca·n_y)² + (ab·n_z)²) in the ellipsoid's own axes.
    #[inline]
    pub fn projected_area(&self, n: Vec3A) -> f32 {
        let local = self.orientation.inverse() * n;
        let r = self.radii;
        PI * (Vec3A::new(r.y * r.z, r.z * r.x, r.x * r.y) * local).length()
    }
}

/// Draws every particle's velocity towards `wind` \[m/s\] by the air's drag in a substep of `dt` \[s\]: the force ½·ρ·c·|u|·M·u with u = wind − v, `density` ρ \[kg/m³\], `coefficient` c and
/// M = π·Q·diag(bc, ca, ab)·Qᵀ, the areas across the ellipsoid's axes.
///
/// |M·u|/|u| is the area that the ellipsoid shows to u ([`Ellipsoid::projected_area`]), so the force has the size ½·ρ·c·A·u² of any drag. But pressure acts along the normal of what it meets, and so the force leans
/// towards the normal of a flat particle, as does M·u: a slanted plate glides, a fin pushes off. For a ball, and along an axis, it is plain drag.
///
/// Stepped implicitly along each axis, u_k ← u_k/(1 + ½·ρ·c·A_k·|u|·Δt/m), which along a single axis is exact: no density and no speed makes it overshoot, and in still air it only takes energy. Particles
/// inside a body feel the wind as those outside do. A wind that is not finite, and a density or a coefficient that is not positive, do nothing; pinned particles are left alone.
pub fn blow(particles: &mut Particles, wind: Vec3A, density: f32, coefficient: f32, dt: f32) {
    let strength = 0.5 * density * coefficient * dt;
    if !(wind.is_finite() && density > 0.0 && coefficient > 0.0 && strength.is_finite()) {
        return;
    }
    for i in 0..particles.len() {
        let u = wind - particles.velocity[i];
        let speed = u.length();
        if particles.inverse_mass[i] == 0.0 || !(speed > 0.0 && speed.is_finite()) {
            continue;
        }
        let Ellipsoid { radii: r, orientation } = particles.ellipsoid(i);
        let area = Vec3A::new(r.y * r.z, r.z * r.x, r.x * r.y) * PI;
        let x = area * (strength * speed * particles.inverse_mass[i]);
        if x.is_finite() {
            particles.velocity[i] += orientation * (orientation.inverse() * u * (x / (Vec3A::ONE + x)));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::line;
    use crate::{predict, quat_exp};
    use glam::Quat;

    #[test]
    fn a_shadow_is_that_of_the_ellipsoid() {
        let sphere = Ellipsoid { radii: Vec3A::splat(0.5), orientation: Quat::IDENTITY };
        assert!((sphere.projected_area(Vec3A::new(0.6, 0.0, 0.8)) - PI * 0.25).abs() < 1e-6);
        let disc = Ellipsoid { radii: Vec3A::new(2.0, 1.0, 0.1), orientation: quat_exp(Vec3A::X * core::f32::consts::FRAC_PI_2) };
        // Its flat side, z, has been turned to −y.
        assert!((disc.projected_area(Vec3A::Y) - PI * 2.0).abs() < 1e-5);
        assert!((disc.projected_area(Vec3A::X) - PI * 0.1).abs() < 1e-6);
        // The area over all directions is a quarter of the surface: Cauchy. For a sphere of radius r that is π·r².
        let mut mean = 0.0;
        for k in 0..2000 {
            let (z, a) = (1.0 - (2.0 * k as f32 + 1.0) / 2000.0, 2.399_963 * k as f32);
            let r = (1.0 - z * z).sqrt();
            mean += disc.projected_area(Vec3A::new(r * libm::cosf(a), r * libm::sinf(a), z)) / 2000.0;
        }
        let p = 1.6075f32; // Thomsen's formula for the surface, good to 1 %.
        let (a, b, c) = (2.0f32, 1.0f32, 0.1f32);
        let pow = |x: f32| libm::powf(x, p);
        let surface = 4.0 * PI * libm::powf((pow(a * b) + pow(a * c) + pow(b * c)) / 3.0, 1.0 / p);
        assert!((mean / (0.25 * surface) - 1.0).abs() < 0.02, "{mean} against {}", 0.25 * surface);
    }

    /// It falls ever slower towards √(2mg/(ρcA)).
    #[test]
    fn a_fall_ends_at_terminal_velocity() {
        for rate in [30.0, 240.0] {
            let mut p = line(1, 1.0, 0.1);
            for _ in 0..(30.0 * rate) as usize {
                blow(&mut p, Vec3A::ZERO, 1.2, 0.47, 1.0 / rate);
                predict(&mut p, Vec3A::new(0.0, -9.81, 0.0), 1.0 / rate);
            }
            let exact = (2.0 * 9.81 / (1.2 * 0.47 * PI * 0.01f32)).sqrt();
            assert!((-p.velocity[0].y / exact - 1.0).abs() < 0.01, "{} against {exact}", p.velocity[0].y);
        }
    }

    #[test]
    fn no_gale_overshoots() {
        let mut p = line(1, 1.0, 0.1);
        blow(&mut p, Vec3A::X * 1e4, 1e6, 1.0, 1.0);
        assert!(p.velocity[0].x > 9.9e3 && p.velocity[0].x <= 1e4);
        blow(&mut p, Vec3A::splat(f32::NAN), 1.0, 1.0, 1.0);
        assert!(p.is_finite());
    }

    /// A thin plate, slanted by 30° to the wind: the force is that of its shadow, along its normal; and in still air a kick only loses energy.
    #[test]
    fn a_slanted_plate_is_pushed_along_its_normal() {
        let mut p = line(1, 1.0, 0.1);
        p.radii[0] = Vec3A::new(0.1, 0.1, 1e-4);
        p.rotation[0] = quat_exp(Vec3A::Y * (PI / 6.0));
        let normal = p.rotation[0] * Vec3A::Z;
        let shadow = p.ellipsoid(0).projected_area(Vec3A::X);
        blow(&mut p, Vec3A::X * 10.0, 1.2, 1.0, 1e-4);
        let force = p.velocity[0] / 1e-4;
        assert!((force.length() / (0.5 * 1.2 * 100.0 * shadow) - 1.0).abs() < 1e-3, "{force}");
        assert!(force.normalize().dot(normal) > 0.9999 && force.x > 0.0 && (force.z / force.x - 3f32.sqrt()).abs() < 0.01, "{force}");
        p.velocity[0] = Vec3A::new(3.0, -2.0, 1.0);
        let mut energy = p.velocity[0].length();
        for _ in 0..100 {
            blow(&mut p, Vec3A::ZERO, 1000.0, 1.0, 1e-2);
            assert!(p.velocity[0].length() <= energy);
            energy = p.velocity[0].length();
        }
    }
}
