//! What a camera sees of a model, sample by sample: how near, facing where, of which colour.

use glam::{Mat3, Vec3};

use super::camera::Camera;
use super::model::{Ellipsoid, Model};

/// Depth, normal and colour of what is nearest to the eye, row by row.
///
/// The crates for two-dimensional drawing paint back to front, which is wrong where ellipsoids go through each other, as a rig's do; and none draws ellipsoids. So each has its depth here.
pub(crate) struct Canvas {
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// Towards the eye, in the camera's space \[px\]; minus infinity where there is nothing.
    pub(crate) depth: Vec<f32>,
    /// In the world, of what is seen of it.
    pub(crate) normal: Vec<Vec3>,
    /// Linear RGB.
    pub(crate) colour: Vec<Vec3>,
}

impl Canvas {
    /// `model` as `camera` sees it, in so many samples. What is not finite is left out.
    pub(crate) fn seen(model: &Model, camera: &Camera, width: usize, height: usize) -> Canvas {
        let count = width * height;
        let (depth, normal, colour) = (vec![f32::NEG_INFINITY; count], vec![Vec3::ZERO; count], vec![Vec3::ZERO; count]);
        let mut canvas = Canvas { width, height, depth, normal, colour };
        for &triangle in &model.triangles {
            canvas.draw_triangle(model, camera, triangle);
        }
        for ellipsoid in &model.ellipsoids {
            canvas.draw_ellipsoid(camera, ellipsoid);
        }
        canvas
    }

    /// The samples, from and up to, whose middles lie between two coordinates.
    fn span(low: f32, high: f32, size: usize) -> std::ops::Range<usize> {
        // A cast saturates, and makes 0 of NaN.
        (low - 0.5).ceil().max(0.0) as usize..((high + 0.5).floor().max(0.0) as usize).min(size)
    }

    /// With barycentric coordinates b of a sample: depth, normal and colour are Σ b·those of the corners. A triangle seen from its edge has no samples; the inside of one that is seen from behind is lit as if it were an outside.
    fn draw_triangle(&mut self, model: &Model, camera: &Camera, triangle: [u32; 3]) {
        let corners = triangle.map(|c| model.corners[c as usize]);
        let [a, b, c] = corners.map(|c| camera.place(c.position));
        let area = (b - a).truncate().perp_dot((c - a).truncate());
        if !(area.is_finite() && area != 0.0 && [a, b, c].iter().all(|p| p.is_finite())) {
            return;
        }
        let flat = (corners[1].position - corners[0].position).cross(corners[2].position - corners[0].position);
        let behind = corners.iter().map(|c| c.normal).sum::<Vec3>().dot(flat) * flat.dot(camera.eye) < 0.0;
        let normals = corners.map(|c| if behind { -c.normal } else { c.normal });
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        for y in Self::span(low.y, high.y, self.height) {
            for x in Self::span(low.x, high.x, self.width) {
                let p = Vec3::new(x as f32 + 0.5, y as f32 + 0.5, 0.0);
                let share = |from: Vec3, to: Vec3| (to - from).truncate().perp_dot((p - from).truncate()) / area;
                let shares = [share(b, c), share(c, a), share(a, b)];
                if shares.iter().any(|&s| s < 0.0) {
                    continue;
                }
                let mix = |values: [Vec3; 3]| values[0] * shares[0] + values[1] * shares[1] + values[2] * shares[2];
                let depth = a.z * shares[0] + b.z * shares[1] + c.z * shares[2];
                self.put(x, y, depth, camera.eye, mix(normals), mix(corners.map(|c| c.colour)));
            }
        }
    }

    /// With v the way from the centre and M = spread, the surface is v·M⁻¹·v = 1: a quadratic in the depth of every sample. The nearer root counts; its normal is M⁻¹·v.
    fn draw_ellipsoid(&mut self, camera: &Camera, ellipsoid: &Ellipsoid) {
        let axes = Vec3::AXES.map(|axis| camera.turn(axis));
        let to_camera = Mat3::from_cols(axes[0], axes[1], axes[2]) * camera.scale;
        let spread = to_camera * ellipsoid.spread() * to_camera.transpose();
        let (centre, inverse) = (camera.place(ellipsoid.centre), spread.inverse());
        if !(centre.is_finite() && inverse.is_finite()) {
            return;
        }
        let half = [spread.x_axis.x.max(0.0).sqrt(), spread.y_axis.y.max(0.0).sqrt()];
        for y in Self::span(centre.y - half[1], centre.y + half[1], self.height) {
            for x in Self::span(centre.x - half[0], centre.x + half[0], self.width) {
                let flat = Vec3::new(x as f32 + 0.5 - centre.x, y as f32 + 0.5 - centre.y, 0.0);
                let across = inverse * flat;
                let (a, b, c) = (inverse.z_axis.z, across.z, across.dot(flat) - 1.0);
                let root = b * b - a * c;
                if root < 0.0 || a <= 0.0 {
                    continue;
                }
                let v = flat + Vec3::Z * ((root.sqrt() - b) / a);
                // The inverse of a rotation is its transpose.
                let normal = (to_camera.transpose() * (inverse * v)).normalize_or(camera.eye);
                self.put(x, y, centre.z + v.z, camera.eye, normal, ellipsoid.colour);
            }
        }
    }

    /// A smoothed normal that leans away from the eye is bent until it does not.
    fn put(&mut self, x: usize, y: usize, depth: f32, eye: Vec3, normal: Vec3, colour: Vec3) {
        let at = y * self.width + x;
        if depth > self.depth[at] {
            let normal = normal.normalize_or(eye);
            self.depth[at] = depth;
            self.normal[at] = (normal - eye * normal.dot(eye).min(0.0)).normalize_or(eye);
            self.colour[at] = colour;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::draw::model::Corner;
    use glam::Quat;

    fn camera() -> Camera {
        Camera::framing([Vec3::splat(-1.0), Vec3::ONE].into_iter(), Vec3::Z, 200, 200, 0.0)
    }

    #[test]
    fn an_ellipsoid_covers_its_ellipse() {
        let turn = Quat::from_xyzw(0.1, 0.2, 0.5, 0.8).normalize();
        let ellipsoid = Ellipsoid { centre: Vec3::new(0.1, 0.0, 0.3), frame: turn, radii: Vec3::new(0.7, 0.3, 0.2), colour: Vec3::ONE };
        let model = Model { ellipsoids: vec![ellipsoid], ..Model::default() };
        let canvas = Canvas::seen(&model, &camera(), 200, 200);
        let covered = canvas.depth.iter().filter(|d| d.is_finite()).count() as f32;
        // The ellipse under a parallel projection has the area π·√det of the spread's part across.
        let m = ellipsoid.spread();
        let area = core::f32::consts::PI * (m.x_axis.x * m.y_axis.y - m.x_axis.y * m.y_axis.x).sqrt() * 100.0 * 100.0;
        assert!((covered / area - 1.0).abs() < 0.01, "{covered} of {area}");
        let nearest = canvas.depth.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        assert!((nearest - 100.0 * (0.3 + ellipsoid.reach(Vec3::Z))).abs() < 0.1, "{nearest}");
        assert!(canvas.depth.iter().zip(&canvas.normal).all(|(d, n)| !d.is_finite() || (n.is_normalized() && n.z >= 0.0)));
    }

    #[test]
    fn what_is_nearer_hides_what_is_farther() {
        let corner = |x: f32, y: f32, z: f32, colour: Vec3| Corner { position: Vec3::new(x, y, z), normal: Vec3::NEG_Z, colour };
        let mut model = Model::default();
        for (z, colour) in [(0.5, Vec3::X), (-0.5, Vec3::Y)] {
            model.add(Model {
                corners: vec![corner(-1.0, -1.0, z, colour), corner(1.0, -1.0, z, colour), corner(0.0, 1.0, z, colour)],
                triangles: vec![[0, 1, 2]],
                ..Model::default()
            });
        }
        let canvas = Canvas::seen(&model, &camera(), 200, 200);
        let middle = 100 * 200 + 100;
        assert_eq!((canvas.colour[middle], canvas.normal[middle]), (Vec3::X, Vec3::Z), "the normal is turned to the eye");
        let covered = canvas.depth.iter().filter(|d| d.is_finite()).count();
        assert!(covered.abs_diff(20_000) < 200, "half of the picture: {covered}");
    }

    #[test]
    fn what_faces_the_eye_stays_lit_where_its_normals_lean_away() {
        let corner =
            |x: f32, y: f32, normal: Vec3| Corner { position: Vec3::new(x, y, 0.0), normal: normal.normalize(), colour: Vec3::ONE };
        let away = Vec3::new(1.0, 0.0, -0.3);
        let corners = vec![corner(-1.0, -1.0, Vec3::Z), corner(1.0, -1.0, away), corner(1.0, 1.0, away)];
        let canvas = Canvas::seen(&Model { corners, triangles: vec![[0, 1, 2]], ellipsoids: vec![] }, &camera(), 200, 200);
        let seen = canvas.depth.iter().zip(&canvas.normal).filter(|(d, _)| d.is_finite());
        assert!(seen.clone().count() > 19_000);
        assert!(seen.clone().all(|(_, n)| n.is_normalized() && n.z > -1e-6 && n.x > -1e-6));
    }

    #[test]
    fn what_is_not_finite_is_left_out() {
        let broken = Ellipsoid { centre: Vec3::ZERO, frame: Quat::IDENTITY, radii: Vec3::new(1.0, f32::NAN, 1.0), colour: Vec3::ONE };
        let model = Model {
            corners: vec![Corner { position: Vec3::NAN, normal: Vec3::Y, colour: Vec3::ONE }; 3],
            triangles: vec![[0, 1, 2]],
            ellipsoids: vec![broken],
        };
        let canvas = Canvas::seen(&model, &camera(), 20, 20);
        assert!(canvas.depth.iter().all(|&d| d == f32::NEG_INFINITY));
    }
}
