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
