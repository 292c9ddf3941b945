//! The point of a convex shape that is nearest to a point.

use bevy::math::{Vec3, Vec3A};
use rapier3d::geometry::{Ball, Cuboid, HalfSpace, PointQuery, PointQueryWithLocation, Shape, Triangle, TrianglePointLocation, TypedShape};

/// The place of a convex shape that is nearest to a point, as a plane: the shape lies behind it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Nearest {
    /// On the surface.
    pub(crate) point: Vec3A,
    /// Out of the shape, unit length.
    pub(crate) normal: Vec3A,
    /// How far the asking point is above the plane \[m\]; negative inside a solid.
    pub(crate) distance: f32,
}

impl Nearest {
    /// The same for the shape grown by `radius`: for a convex shape the offset of the nearest point is the nearest point of the offset, inside and out.
    fn grown(self, radius: f32) -> Self {
        Self { point: self.point + self.normal * radius, normal: self.normal, distance: self.distance - radius }
    }

    pub(crate) fn is_finite(&self) -> bool {
        self.point.is_finite() && self.normal.is_finite() && self.distance.is_finite()
    }
}

/// The place of `shape` nearest to `at`, both in the shape's own axes.
///
/// Parry's projection answers for most shapes. Written out are those where it divides by zero (a ball about its own centre), has no inside to speak of (half-space, triangle), or searches by an
/// iteration that may give up with a panic (everything it treats as a bare support map: convex polyhedra and round shapes).
///
/// Degenerate: a point exactly on the surface gets the normal of the face it is on. A non-finite point or shape gives a non-finite answer, which the caller drops.
pub(crate) fn nearest(shape: &dyn Shape, at: Vec3A) -> Nearest {
    match shape.as_typed_shape() {
        TypedShape::Ball(ball) => nearest_on_ball(ball, at),
        TypedShape::HalfSpace(half) => nearest_on_half_space(half, at),
        TypedShape::Cuboid(cuboid) => nearest_on_cuboid(cuboid, at),
        TypedShape::Triangle(triangle) => nearest_on_triangle(triangle, at),
        TypedShape::ConvexPolyhedron(_) => nearest_on_faces(shape, at),
        TypedShape::RoundCuboid(round) => nearest(&round.inner_shape, at).grown(round.border_radius),
        TypedShape::RoundTriangle(round) => nearest(&round.inner_shape, at).grown(round.border_radius),
        TypedShape::RoundCylinder(round) => nearest(&round.inner_shape, at).grown(round.border_radius),
        TypedShape::RoundCone(round) => nearest(&round.inner_shape, at).grown(round.border_radius),
        TypedShape::RoundConvexPolyhedron(round) => nearest(&round.inner_shape, at).grown(round.border_radius),
        _ => nearest_by_projection(shape, at),
    }
}

/// Below this the direction from the surface to `at` is rounding noise \[m\].
fn noise(at: Vec3A) -> f32 {
    1e-5 * at.abs().max_element()
}

pub(crate) fn nearest_on_ball(ball: &Ball, at: Vec3A) -> Nearest {
    let length = at.length();
    let normal = if length > 0.0 { at / length } else { Vec3A::Y };
    Nearest { point: normal * ball.radius, normal, distance: length - ball.radius }
}

#[inline]
pub(crate) fn nearest_on_half_space(half: &HalfSpace, at: Vec3A) -> Nearest {
    let normal = Vec3A::from(half.normal);
    let distance = normal.dot(at);
    Nearest { point: at - normal * distance, normal, distance }
}

#[inline]
pub(crate) fn nearest_by_projection<S: PointQuery + ?Sized>(shape: &S, at: Vec3A) -> Nearest {
    let projection = shape.project_local_point(at.into(), false);
    by_projection(shape, at, projection.point.into(), projection.is_inside)
}

/// Outside, what Parry's projection answers, with its bits and without the way there.
#[inline]
pub(crate) fn nearest_on_cuboid(cuboid: &Cuboid, at: Vec3A) -> Nearest {
    let half = Vec3A::from(cuboid.half_extents);
    let shift = (-half - at).max(Vec3A::ZERO) - (at - half).max(Vec3A::ZERO);
    if shift == Vec3A::ZERO { nearest_by_projection(cuboid, at) } else { by_projection(cuboid, at, at + shift, false) }
}

/// The place of `shape` nearest to `at` is `point`.
#[inline]
fn by_projection<S: PointQuery + ?Sized>(shape: &S, at: Vec3A, point: Vec3A, is_inside: bool) -> Nearest {
    let way = at - point;
    let length = way.length();
    if length > noise(at) {
        let distance = if is_inside { -length } else { length };
        return Nearest { point, normal: way / distance, distance };
    }
    beside_surface(shape, at, point)
}

/// Of what is on the surface, at `point`: asked from a little beside it. An offset o off a plane with normal n is o·n above it and sees exactly n; the best of six sees the face best.
#[cold]
fn beside_surface<S: PointQuery + ?Sized>(shape: &S, at: Vec3A, point: Vec3A) -> Nearest {
    let step = (1e-3 * at.abs().max_element()).max(1e-4);
    let mut best = (0.0, Vec3A::Y);
    for offset in [Vec3A::Y, Vec3A::NEG_Y, Vec3A::X, Vec3A::NEG_X, Vec3A::Z, Vec3A::NEG_Z] {
        let beside = at + offset * step;
        let projection = shape.project_local_point(beside.into(), false);
        let way = beside - Vec3A::from(projection.point);
        let length = way.length();
        if !projection.is_inside && length > best.0 {
            best = (length, way / length);
        }
    }
    Nearest { point, normal: best.1, distance: 0.0 }
}

/// A triangle has no inside: the normal points to the side on which `at` is.
pub(crate) fn nearest_on_triangle(triangle: &Triangle, at: Vec3A) -> Nearest {
    let (projection, location) = triangle.project_local_point_and_get_location(at.into(), false);
    let (way, place) = (at - Vec3A::from(projection.point), projection.point.into());
    let length = way.length();
    let on_face = matches!(location, TrianglePointLocation::OnFace(..));
    if !on_face && length > noise(at) {
        return Nearest { point: place, normal: way / length, distance: length };
    }
    // Above the face the triangle's own normal has no noise; a resting particle would otherwise lie on a surface that trembles by 1e-4 rad.
    let normal = Vec3A::from(triangle.scaled_normal().normalize_or(Vec3::Y));
    let distance = normal.dot(at - Vec3A::from(triangle.a));
    let side = if distance < 0.0 { -1.0 } else { 1.0 };
    let point = if on_face { at - normal * distance } else { place };
    Nearest { point, normal: normal * side, distance: if on_face { distance * side } else { length } }
}

/// Inside, the face that is nearest; outside, the nearest point of all faces that see `at`.
fn nearest_on_faces(shape: &dyn Shape, at: Vec3A) -> Nearest {
    let mut inside = Nearest { point: at, normal: Vec3A::Y, distance: f32::NEG_INFINITY };
    let mut outside = Nearest { point: at, normal: Vec3A::Y, distance: f32::INFINITY };
    visit_faces(shape, |face, normal| {
        let height = normal.dot(at - Vec3A::from(face.a));
        if height > inside.distance {
            inside = Nearest { point: at - normal * height, normal, distance: height };
        }
        if height > 0.0 && height < outside.distance {
            let here = nearest_on_triangle(face, at);
            if here.distance < outside.distance {
                outside = here;
            }
        }
    });
    if inside.distance > 0.0 { outside } else { inside }
}

/// Calls `visit` with triangles that make up the surface of a shape with flat faces, and their outward normals. Returns `false` for other shapes.
pub(crate) fn visit_faces(shape: &dyn Shape, mut visit: impl FnMut(&Triangle, Vec3A)) -> bool {
    match shape.as_typed_shape() {
        TypedShape::Cuboid(cuboid) => {
            let half = cuboid.half_extents;
            for axis in 0..3 {
                for sign in [1.0, -1.0] {
                    let mut normal = Vec3::ZERO;
                    normal[axis] = sign;
                    let (mut u, mut v) = (Vec3::ZERO, Vec3::ZERO);
                    u[(axis + 1) % 3] = half[(axis + 1) % 3];
                    v[(axis + 2) % 3] = half[(axis + 2) % 3];
                    let center = normal * half;
                    visit(&Triangle::new(center - u - v, center + u - v, center + u + v), normal.into());
                    visit(&Triangle::new(center - u - v, center + u + v, center - u + v), normal.into());
                }
            }
            true
        }
        TypedShape::ConvexPolyhedron(polyhedron) => {
            let points = polyhedron.points();
            for face in polyhedron.faces() {
                let (normal, first) = (face.normal.into(), face.first_vertex_or_edge as usize);
                let ring = &polyhedron.vertices_adj_to_face()[first..first + face.num_vertices_or_edges as usize];
                for two in ring[1..].windows(2) {
                    visit(&Triangle::new(points[ring[0] as usize], points[two[0] as usize], points[two[1] as usize]), normal);
                }
            }
            true
        }
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rapier3d::geometry::{Capsule, Cone, Cylinder, RoundShape, Segment, SharedShape};

    fn hull() -> SharedShape {
        let points: Vec<Vec3> = (0..8)
            .map(|i| {
                let sign = |bit: i32| if i & bit == 0 { -1.0 } else { 1.0 };
                Vec3::new(0.5 * sign(1), 0.3 * sign(2), 0.7 * sign(4))
            })
            .collect();
        SharedShape::convex_hull(&points).unwrap()
    }

    fn solids() -> Vec<(&'static str, SharedShape)> {
        let cuboid = Cuboid::new(Vec3::new(0.5, 0.3, 0.7));
        vec![
            ("ball", SharedShape::new(Ball::new(0.6))),
            ("cuboid", SharedShape::new(cuboid)),
            ("capsule", SharedShape::new(Capsule::new(Vec3::new(-0.2, 0.0, 0.1), Vec3::new(0.4, 0.3, 0.0), 0.3))),
            ("cylinder", SharedShape::new(Cylinder::new(0.4, 0.3))),
            ("cone", SharedShape::new(Cone::new(0.4, 0.5))),
            ("half-space", SharedShape::new(HalfSpace::new(Vec3::new(0.6, 0.8, 0.0)))),
            ("polyhedron", hull()),
            ("round cuboid", SharedShape::new(RoundShape { inner_shape: cuboid, border_radius: 0.1 })),
            ("round cylinder", SharedShape::new(RoundShape { inner_shape: Cylinder::new(0.4, 0.3), border_radius: 0.1 })),
            ("round cone", SharedShape::new(RoundShape { inner_shape: Cone::new(0.4, 0.5), border_radius: 0.1 })),
        ]
    }

    fn grid() -> impl Iterator<Item = Vec3A> {
        (0..9 * 9 * 9).map(|i| Vec3A::new((i % 9) as f32, (i / 9 % 9) as f32, (i / 81) as f32) * 0.27 - Vec3A::splat(1.07))
    }

    /// Where the distance is smooth, its gradient is the normal, and going back by it leads to the surface. At a solid's medial axis and near corners finite differences do not apply.
    #[test]
    fn normal_is_the_gradient_of_the_distance() {
        for (name, shape) in solids() {
            let mut smooth = 0;
            for at in grid() {
                let here = nearest(&*shape, at);
                assert!((here.normal.length() - 1.0).abs() < 1e-5, "{name} at {at}");
                assert!((at - here.normal * here.distance - here.point).length() < 1e-5, "{name} at {at}: {here:?}");
                assert!(nearest(&*shape, here.point).distance.abs() < 1e-5, "{name} at {at}: not on the surface");
                let e = 2e-3;
                let slope = |o: Vec3A| (nearest(&*shape, at + o * e).distance - nearest(&*shape, at - o * e).distance) / (2.0 * e);
                let gradient = Vec3A::new(slope(Vec3A::X), slope(Vec3A::Y), slope(Vec3A::Z));
                if (gradient.length() - 1.0).abs() < 1e-3 {
                    smooth += 1;
                    assert!((gradient - here.normal).length() < 1e-2, "{name} at {at}: {gradient} against {}", here.normal);
                }
            }
            assert!(smooth > 600, "{name}: only {smooth} of 729 places were smooth");
        }
    }

    #[test]
    fn a_hull_agrees_with_the_cuboid_it_is() {
        let (hull, cuboid) = (hull(), Cuboid::new(Vec3::new(0.5, 0.3, 0.7)));
        for at in grid() {
            let (a, b) = (nearest(&*hull, at), nearest(&cuboid, at));
            assert!((a.distance - b.distance).abs() < 1e-5, "{at}: {a:?} against {b:?}");
        }
    }

    #[test]
    fn a_point_on_the_surface_gets_the_normal_of_its_face() {
        let cuboid = Cuboid::new(Vec3::new(0.5, 0.3, 0.7));
        let here = nearest(&cuboid, Vec3A::new(0.1, 0.3, -0.2));
        assert!((here.normal - Vec3A::Y).length() < 1e-5 && here.distance == 0.0, "{here:?}");
        let triangle = Triangle::new(Vec3::ZERO, Vec3::X, Vec3::NEG_Z);
        let here = nearest(&triangle, Vec3A::new(0.2, 0.0, -0.2));
        assert!((here.normal - Vec3A::Y).length() < 1e-5 && here.distance == 0.0, "{here:?}");
        let segment = Segment::new(Vec3::ZERO, Vec3::X);
        let here = nearest(&segment, Vec3A::new(0.5, 0.0, 0.0));
        assert!((here.normal - Vec3A::Y).length() < 1e-3, "{here:?}");
        assert!(nearest(&Ball::new(0.5), Vec3A::ZERO).is_finite());
    }

    #[test]
    fn a_triangle_is_the_same_from_both_sides() {
        let triangle = Triangle::new(Vec3::ZERO, Vec3::X, Vec3::NEG_Z);
        for y in [0.3, -0.3] {
            let here = nearest(&triangle, Vec3A::new(0.2, y, -0.2));
            assert!((here.distance - 0.3).abs() < 1e-6 && here.normal.y * y > 0.299, "{here:?}");
        }
    }
}
