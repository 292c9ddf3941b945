//! A particle's pose as the affine map that the skinning kernels apply.

use bytemuck::{Pod, Zeroable};
use glam::{Mat3, Quat, Vec3, Vec4};

/// The affine map M = [s·R | p − s·R·p̄] of one particle, as three rows of four: 48 bytes, the layout the shader reads (`array<vec4<f32>>`, three per particle).
///
/// It takes a rest position (relative to [`Binding::origin`](crate::Binding::origin)) to the current position in the body's space, as if the particle carried it rigidly.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct ParticleTransform {
    /// The rows of [s·R | t]: the first three of each row are the scaled rotation \[1\], the fourth is the translation \[m\].
    pub rows: [Vec4; 3],
}

impl ParticleTransform {
    /// The map that leaves every point where it is.
    pub const IDENTITY: Self = Self { rows: [Vec4::X, Vec4::Y, Vec4::Z] };

    /// The map of a particle.
    ///
    /// * `position` p: where the particle is now \[m\], in the space the vertices shall be in.
    /// * `rotation` R: its rotation since rest, a unit quaternion. A quaternion of length 1 + ε scales by 1 + 2ε.
    /// * `scale` s: the body's uniform scale \[1\], positive; 1e-3 to 1e3 keeps the normals well conditioned.
    /// * `rest` p̄: its rest position [m in the rest mesh], relative to the binding's origin: [`Binding::rest_particles`](crate::Binding::rest_particles).
    pub fn new(position: Vec3, rotation: Quat, scale: f32, rest: Vec3) -> Self {
        let linear = Mat3::from_quat(rotation) * scale;
        let translation = position - linear * rest;
        let rows = linear.transpose();
        Self { rows: [rows.x_axis.extend(translation.x), rows.y_axis.extend(translation.y), rows.z_axis.extend(translation.z)] }
    }

    /// M·(point, 1) \[m\].
    pub fn transform_point(&self, point: Vec3) -> Vec3 {
        let point = point.extend(1.0);
        Vec3::new(self.rows[0].dot(point), self.rows[1].dot(point), self.rows[2].dot(point))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn carries_points_rigidly() {
        let rotation = Quat::from_xyzw(0.1, -0.5, 0.7, 0.3).normalize();
        let (position, rest) = (Vec3::new(3.0, -1.0, 2.0), Vec3::new(0.5, 0.25, -0.75));
        let transform = ParticleTransform::new(position, rotation, 2.0, rest);
        let offset = Vec3::new(0.1, 0.2, 0.3);
        let expected = position + 2.0 * rotation.mul_vec3(offset);
        assert!(transform.transform_point(rest + offset).distance(expected) < 1e-6);
        assert!(transform.transform_point(rest).distance(position) < 1e-6);
    }

    #[test]
    fn rest_pose_is_the_identity() {
        let rest = Vec3::new(0.5, 0.25, -0.75);
        let transform = ParticleTransform::new(rest, Quat::IDENTITY, 1.0, rest);
        assert_eq!(transform, ParticleTransform::IDENTITY);
    }
}
