//! A camera without perspective: what is as long in the picture is as long in the world.

use glam::Vec3;

/// Looks along a direction at what it was framed for. Its space is in pixels: x to the right, y down, z towards the eye, all to one scale.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Camera {
    right: Vec3,
    down: Vec3,
    /// Unit vector towards the eye.
    pub(crate) eye: Vec3,
    target: Vec3,
    middle: Vec3,
    /// Pixels a metre.
    pub(crate) scale: f32,
}

impl Camera {
    /// Looks down from `eye`, any direction but straight up or down, at all of `points`, and fills `width` by `height` pixels with them up to a `margin`, a share of either.
    pub(crate) fn framing(points: impl Iterator<Item = Vec3> + Clone, eye: Vec3, width: usize, height: usize, margin: f32) -> Camera {
        let eye = eye.normalize_or(Vec3::Z);
        let right = Vec3::Y.cross(eye).normalize_or(Vec3::X);
        let down = right.cross(eye);
        let bounds = |axis: Vec3| {
            points.clone().map(|p| p.dot(axis)).fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)))
        };
        let ([x0, x1], [y0, y1], [z0, z1]) = ([right, down, eye].map(bounds).map(|(low, high)| [low, high])).into();
        let (width, height) = (width as f32, height as f32);
        let room = (width * (1.0 - 2.0 * margin) / (x1 - x0)).min(height * (1.0 - 2.0 * margin) / (y1 - y0));
        let target = (right * (x0 + x1) + down * (y0 + y1) + eye * (z0 + z1)) * 0.5;
        let fits = room.is_finite() && target.is_finite();
        Camera {
            right,
            down,
            eye,
            target: if fits { target } else { Vec3::ZERO },
            middle: Vec3::new(0.5 * width, 0.5 * height, 0.0),
            scale: if fits { room } else { 1.0 },
        }
    }

    /// A place of the world in the camera's space \[px\].
    pub(crate) fn place(&self, point: Vec3) -> Vec3 {
        self.turn(point - self.target) * self.scale + self.middle
    }

    /// A direction of the world along the camera's axes.
    pub(crate) fn turn(&self, direction: Vec3) -> Vec3 {
        Vec3::new(direction.dot(self.right), direction.dot(self.down), direction.dot(self.eye))
    }

    /// The place of the world that a place of the camera's space is.
    pub(crate) fn world(&self, place: Vec3) -> Vec3 {
        let v = (place - self.middle) / self.scale;
        self.target + self.right * v.x + self.down * v.y + self.eye * v.z
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_that_it_was_framed_for_is_in_the_picture() {
        let corners = (0..8).map(|i| Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32 * 2.0, (i >> 2) as f32 * 0.5) * 40.0);
        let camera = Camera::framing(corners.clone(), Vec3::new(1.0, 0.4, 2.0), 400, 300, 0.1);
        let places: Vec<Vec3> = corners.clone().map(|p| camera.place(p)).collect();
        assert!(places.iter().all(|p| (39.9..360.1).contains(&p.x) && (29.9..270.1).contains(&p.y)), "{places:?}");
        assert!(places.iter().any(|p| p.y < 30.1) && places.iter().any(|p| p.y > 269.9), "it fills the height");
        for (corner, place) in corners.zip(places) {
            assert!(camera.world(place).distance(corner) < 1e-4);
        }
        // Up in the world is up in the picture, and what is nearer to the eye has the greater depth.
        assert!(camera.turn(Vec3::Y).y < 0.0 && camera.turn(camera.eye).z > 0.999);
    }

    #[test]
    fn a_point_and_nothing_are_no_trouble() {
        for points in [vec![], vec![Vec3::ONE]] {
            let camera = Camera::framing(points.into_iter(), Vec3::Z, 10, 10, 0.1);
            assert!(camera.place(Vec3::ONE).is_finite());
        }
    }
}
