//! What is asked of a convex shape.

use bevy::math::Vec3A;
use polpo_solver::Ellipsoid;
use rapier3d::geometry::{Ball, Capsule, Cuboid, HalfSpace, Shape, Triangle, TypedShape};

use crate::nearest::{
    Nearest, nearest, nearest_by_projection, nearest_on_ball, nearest_on_cuboid, nearest_on_half_space, nearest_on_triangle,
};
use crate::touch::{nearest_on_cuboid_to, nearest_on_triangle_to, nearest_to_ellipsoid, search};

/// A convex shape in its own axes.
///
/// Written once for each of the shapes that are asked most, and once for any: hundreds of particles ask one floor, and finding out what it is takes longer than the answer. All forms give the same bits.
pub(crate) trait Convex {
    /// The place nearest to `at`; see [`nearest`].
    fn nearest(&self, at: Vec3A) -> Nearest;

    /// The plane between it and the ellipsoid about `center`, where `by_center` is the place nearest to the centre; see [`nearest_to_ellipsoid`].
    fn nearest_to(&self, ellipsoid: &Ellipsoid, center: Vec3A, by_center: Nearest) -> Nearest;

    /// Where a triangle's front looks, of any length. `None` for what is the same from all sides.
    fn front(&self) -> Option<Vec3A> {
        None
    }
}

impl Convex for Ball {
    fn nearest(&self, at: Vec3A) -> Nearest {
        nearest_on_ball(self, at)
    }

    fn nearest_to(&self, ellipsoid: &Ellipsoid, center: Vec3A, by_center: Nearest) -> Nearest {
        search(ellipsoid, center, self, by_center)
    }
}

impl Convex for HalfSpace {
    #[inline]
    fn nearest(&self, at: Vec3A) -> Nearest {
        nearest_on_half_space(self, at)
    }

    fn nearest_to(&self, _: &Ellipsoid, center: Vec3A, by_center: Nearest) -> Nearest {
        // Its plane is the same wherever it is asked from.
        Nearest { distance: by_center.normal.dot(center - by_center.point), ..by_center }
    }
}

impl Convex for Capsule {
    fn nearest(&self, at: Vec3A) -> Nearest {
        nearest_by_projection(self, at)
    }

    fn nearest_to(&self, ellipsoid: &Ellipsoid, center: Vec3A, by_center: Nearest) -> Nearest {
        search(ellipsoid, center, self, by_center)
    }
}

impl Convex for Cuboid {
    #[inline]
    fn nearest(&self, at: Vec3A) -> Nearest {
        nearest_on_cuboid(self, at)
    }

    #[inline]
    fn nearest_to(&self, ellipsoid: &Ellipsoid, center: Vec3A, by_center: Nearest) -> Nearest {
        nearest_on_cuboid_to(ellipsoid, center, self, by_center)
    }
}

impl Convex for Triangle {
    fn nearest(&self, at: Vec3A) -> Nearest {
        nearest_on_triangle(self, at)
    }

    fn nearest_to(&self, ellipsoid: &Ellipsoid, center: Vec3A, _: Nearest) -> Nearest {
        nearest_on_triangle_to(ellipsoid, center, self).1
    }

    fn front(&self) -> Option<Vec3A> {
        Some(self.scaled_normal().into())
    }
}

impl Convex for dyn Shape + '_ {
    fn nearest(&self, at: Vec3A) -> Nearest {
        nearest(self, at)
    }

    fn nearest_to(&self, ellipsoid: &Ellipsoid, center: Vec3A, by_center: Nearest) -> Nearest {
        nearest_to_ellipsoid(ellipsoid, center, self, by_center)
    }

    fn front(&self) -> Option<Vec3A> {
        match self.as_typed_shape() {
            TypedShape::Triangle(triangle) => triangle.front(),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bevy::math::Vec3;
    use polpo_solver::quat_exp;

    /// In and around a box of half a metre, some in the planes of its faces.
    fn places() -> impl Iterator<Item = Vec3A> {
        (0..2000).map(|i| {
            let f = i as f32;
            let at = Vec3A::new(libm::sinf(f), libm::cosf(1.7 * f), libm::sinf(2.9 * f)) * 0.8;
            if i % 7 == 0 { (at * 8.0).round() / 8.0 } else { at }
        })
    }

    fn bits(plane: Nearest) -> [u32; 7] {
        let Nearest { point: p, normal: n, distance } = plane;
        [p.x, p.y, p.z, n.x, n.y, n.z, distance].map(f32::to_bits)
    }

    /// `written` is what a shape's own form should answer to the bit.
    fn agree<S: Shape + Convex>(shape: &S, written: impl Fn(Vec3A) -> Nearest) {
        let any: &dyn Shape = shape;
        for (i, at) in places().enumerate() {
            let by_center = shape.nearest(at);
            assert_eq!(bits(by_center), bits(written(at)), "at {at}");
            assert_eq!(bits(by_center), bits(any.nearest(at)), "at {at}");
            let turn = quat_exp(Vec3A::new(libm::sinf(i as f32), 0.3, 0.1 * i as f32));
            let ellipsoid = Ellipsoid { radii: Vec3A::new(0.3, 0.1, 0.2), orientation: turn };
            let [own, of_any] = [shape.nearest_to(&ellipsoid, at, by_center), any.nearest_to(&ellipsoid, at, by_center)];
            assert_eq!(bits(own), bits(of_any), "at {at}");
        }
        assert_eq!(shape.front(), any.front());
    }

    #[test]
    fn all_forms_of_a_shape_give_the_same_bits() {
        let cuboid = Cuboid::new(Vec3::new(0.5, 0.3, 0.7));
        agree(&cuboid, |at| nearest_by_projection(&cuboid as &dyn Shape, at));
        let capsule = Capsule::new(Vec3::new(-0.2, 0.0, 0.1), Vec3::new(0.4, 0.3, 0.0), 0.3);
        agree(&capsule, |at| nearest_by_projection(&capsule as &dyn Shape, at));
        agree(&Ball::new(0.5), |at| nearest_on_ball(&Ball::new(0.5), at));
        let half = HalfSpace::new(Vec3::new(0.6, 0.8, 0.0));
        agree(&half, |at| nearest_on_half_space(&half, at));
        let triangle = Triangle::new(Vec3::new(-0.5, 0.1, 0.0), Vec3::new(0.5, 0.0, 0.2), Vec3::new(0.0, -0.1, 0.6));
        agree(&triangle, |at| nearest_on_triangle(&triangle, at));
    }

    /// What a search would find of a half-space is the plane that it has already.
    #[test]
    fn a_half_space_needs_no_search() {
        let half = HalfSpace::new(Vec3::new(0.6, 0.8, 0.0));
        let ellipsoid = Ellipsoid { radii: Vec3A::new(0.3, 0.1, 0.2), orientation: quat_exp(Vec3A::new(0.4, 0.3, 0.1)) };
        for at in places() {
            let by_center = half.nearest(at);
            assert_eq!(bits(half.nearest_to(&ellipsoid, at, by_center)), bits(search(&ellipsoid, at, &half, by_center)), "at {at}");
        }
    }
}
