//! An oriented ellipsoid and its support.

use glam::{Quat, Vec3A};

/// An ellipsoid about the origin: half axes \[m\] along the axes of `orientation`.
///
/// Its shape matrix is Σ = Q diag(a², b², c²) Qᵀ.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ellipsoid {
    /// Half axes \[m\], all positive.
    pub radii: Vec3A,
    /// From principal axes to world.
    pub orientation: Quat,
}

impl Ellipsoid {
    /// How far the ellipsoid reaches along the unit vector `n`, h = √(nᵀΣn) \[m\], and Σn/h, the point where it does so, relative to the centre.
    ///
    /// The surface point with outward normal n maximises n·p under pᵀΣ⁻¹p = 1; by Lagrange p = Σn/√(nᵀΣn), and n·p = √(nᵀΣn). This is what a plane sees. The distance of the surface
    /// *in direction* n, 1/√(nᵀΣ⁻¹n), is smaller by up to (k + 1/k)/2 at aspect ratio k and must not be used for contacts.
    #[inline]
    pub fn support(&self, n: Vec3A) -> (f32, Vec3A) {
        let local = self.orientation.inverse() * n;
        let scaled = self.radii * local;
        let h = scaled.length();
        if h > 0.0 { (h, self.orientation * (self.radii * scaled / h)) } else { (0.0, Vec3A::ZERO) }
    }

    /// Radius of the enveloping sphere \[m\].
    #[inline]
    pub fn bound(&self) -> f32 {
        self.radii.max_element()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::quat_exp;

    #[test]
    fn support_is_the_farthest_surface_point() {
        let e = Ellipsoid { radii: Vec3A::new(4.0, 1.0, 0.5), orientation: quat_exp(Vec3A::new(0.4, -0.9, 1.3)) };
        let n = Vec3A::new(1.0, 2.0, -0.5).normalize();
        let (h, point) = e.support(n);
        assert!((point.dot(n) - h).abs() < 1e-5);
        // On the surface, and no other surface point reaches farther.
        let local = e.orientation.inverse() * point / e.radii;
        assert!((local.length() - 1.0).abs() < 1e-5);
        for i in 0..1000 {
            let a = i as f32 * 0.37;
            let z = 1.0 - 2.0 * (i as f32 + 0.5) / 1000.0;
            let r = (1.0 - z * z).sqrt();
            let sphere = Vec3A::new(r * libm::cosf(a), r * libm::sinf(a), z);
            assert!((e.orientation * (e.radii * sphere)).dot(n) <= h + 1e-5);
        }
    }

    #[test]
    fn a_sphere_reaches_its_radius_everywhere() {
        let e = Ellipsoid { radii: Vec3A::splat(0.3), orientation: Quat::IDENTITY };
        let n = Vec3A::new(0.6, 0.0, 0.8);
        let (h, p) = e.support(n);
        assert!((h - 0.3).abs() < 1e-7 && (p - 0.3 * n).length() < 1e-7);
    }
}
