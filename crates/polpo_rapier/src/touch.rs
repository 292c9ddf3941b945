//! The plane between an ellipsoid and a convex shape.
//!
//! The plane at the place nearest to the *centre* is the right one for a sphere only: a long ellipsoid that overhangs an edge would be thrown off it. The affine map that makes the ellipsoid a
//! unit sphere about the origin, y = diag(1/r)·Rᵀ(x − c), also maps planes to planes and sides to sides; the distance of the mapped plane from the origin is (n·(c − p))/h(n), with h the ellipsoid's
//! support. So the right plane is that of the mapped shape's place nearest to the origin, which is the one whose *nearness* (n·(c − p))/h(n) is largest. Nearness 1 is touch; below is overlap.

use bevy::math::{Vec3, Vec3A};
use polpo_solver::Ellipsoid;
use rapier3d::geometry::{Cuboid, Shape, Triangle, TypedShape};

use crate::convex::Convex;
use crate::nearest::{Nearest, nearest_on_triangle, visit_faces};

/// The plane between `shape` and the ellipsoid about `center`; `by_center` is the place of the shape nearest to the centre.
pub(crate) fn nearest_to_ellipsoid(ellipsoid: &Ellipsoid, center: Vec3A, shape: &dyn Shape, by_center: Nearest) -> Nearest {
    match shape.as_typed_shape() {
        TypedShape::Triangle(triangle) => nearest_on_triangle_to(ellipsoid, center, triangle).1,
        // A triangle that has collapsed.
        TypedShape::Segment(segment) => nearest_on_triangle_to(ellipsoid, center, &Triangle::new(segment.a, segment.b, segment.b)).1,
        TypedShape::Cuboid(cuboid) => nearest_on_cuboid_to(ellipsoid, center, cuboid, by_center),
        TypedShape::ConvexPolyhedron(_) => nearest_on_faces_to(ellipsoid, center, shape, by_center),
        TypedShape::HalfSpace(half) => half.nearest_to(ellipsoid, center, by_center),
        _ => search(ellipsoid, center, shape, by_center),
    }
}

#[inline]
pub(crate) fn nearest_on_cuboid_to(ellipsoid: &Ellipsoid, center: Vec3A, cuboid: &Cuboid, by_center: Nearest) -> Nearest {
    if by_center.distance > 0.0
        && let Some(plane) = on_face(ellipsoid, center, cuboid, &by_center)
    {
        return plane;
    }
    nearest_on_faces_to(ellipsoid, center, cuboid, by_center)
}

/// Of a shape with flat faces.
fn nearest_on_faces_to(ellipsoid: &Ellipsoid, center: Vec3A, shape: &dyn Shape, by_center: Nearest) -> Nearest {
    let mut inside = (f32::NEG_INFINITY, by_center);
    let mut outside = (f32::INFINITY, by_center);
    visit_faces(shape, |face, normal| {
        let height = normal.dot(center - Vec3A::from(face.a));
        let nearness = height / support(ellipsoid, normal);
        if nearness > inside.0 {
            inside = (nearness, Nearest { point: center - normal * height, normal, distance: height });
        }
        if height > 0.0 && nearness < outside.0 {
            let here = nearest_on_triangle_to(ellipsoid, center, face);
            if here.0 < outside.0 {
                outside = here;
            }
        }
    });
    if outside.0 < f32::INFINITY { outside.1 } else { inside.1 }
}

fn support(ellipsoid: &Ellipsoid, n: Vec3A) -> f32 {
    ellipsoid.support(n).0
}

/// The plane nearest to the centre, if it is the right one for the ellipsoid too: the mapped plane comes nearest to the origin at c − (Σn/h)·(n·(c − p))/h, and all of the box is behind the plane, so that it is if that place is the box's.
/// That spares most particles over a floor its twelve triangles.
fn on_face(ellipsoid: &Ellipsoid, center: Vec3A, cuboid: &Cuboid, by_center: &Nearest) -> Option<Nearest> {
    let (h, reach) = ellipsoid.support(by_center.normal);
    let point = center - reach * (by_center.distance / h);
    // A place is on the face but for rounding.
    let slack = 4.0 * f32::EPSILON * (cuboid.half_extents.max_element() + center.abs().max_element());
    let there = (point.abs() - Vec3A::from(cuboid.half_extents)).max_element() <= slack;
    there.then_some(Nearest { point, ..*by_center })
}

/// A triangle stays one under the map, so the answer is exact. Returns the nearness as well.
pub(crate) fn nearest_on_triangle_to(ellipsoid: &Ellipsoid, center: Vec3A, triangle: &Triangle) -> (f32, Nearest) {
    let radii = ellipsoid.radii;
    let back = ellipsoid.orientation.inverse();
    let map = |x: Vec3| (back * (Vec3A::from(x) - center) / radii).into();
    let here = nearest_on_triangle(&Triangle::new(map(triangle.a), map(triangle.b), map(triangle.c)), Vec3A::ZERO);
    // Points go back by the map's inverse, normals by its transpose.
    let point = center + ellipsoid.orientation * (here.point * radii);
    let normal = ellipsoid.orientation * (here.normal / radii);
    let normal = normal * normal.length_recip();
    (here.distance, Nearest { point, normal, distance: normal.dot(center - point) })
}

/// For round shapes, which do not stay what they are: the ellipsoid touches a plane with normal n at s = c − Σn/h, and near s it is like a sphere with one of its radii of curvature ρ, about
/// c' = s + ρn. The shape's place nearest to c' gives the next n, and at the solution the same n again. Every plane so found has the shape behind it, so that the nearest found is kept and the search never
/// ends worse than it began. ρ is tried where the ellipsoid is sharpest (min²/max, fast), then where it is flattest (max²/min, safe).
pub(crate) fn search<S: Convex + ?Sized>(ellipsoid: &Ellipsoid, center: Vec3A, shape: &S, first: Nearest) -> Nearest {
    let (least, most) = (ellipsoid.radii.min_element(), ellipsoid.radii.max_element());
    let nearness = |plane: &Nearest| plane.normal.dot(center - plane.point) / support(ellipsoid, plane.normal);
    let mut best = (nearness(&first), first);
    for _ in 0..8 {
        let surface = center - ellipsoid.support(best.1.normal).1;
        let mut better = false;
        for radius in [least * least / most, most * most / least] {
            let there = shape.nearest(surface + best.1.normal * radius);
            let found = nearness(&there);
            if there.is_finite() && found > best.0 + 1e-3 {
                best = (found, there);
                better = true;
                break;
            }
        }
        if !better {
            break;
        }
    }
    Nearest { distance: best.1.normal.dot(center - best.1.point), ..best.1 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nearest::nearest;
    use polpo_solver::quat_exp;
    use rapier3d::geometry::{Capsule, Cylinder, SharedShape, SupportMap};
    use rapier3d::math::Rotation;

    fn plane(ellipsoid: &Ellipsoid, center: Vec3A, shape: &dyn Shape) -> Nearest {
        nearest_to_ellipsoid(ellipsoid, center, shape, nearest(shape, center))
    }

    /// A flat ellipsoid lies across the edge of a table with its centre beyond the edge. The plane nearest to the centre would claim an overlap of 0.35 and throw it off; the ellipse
    /// x²+16y² = 1 about (0.5, 0.25) passes the corner at (0, 0) at a height of 0.0335.
    #[test]
    fn an_overhanging_ellipsoid_is_not_thrown_off_the_edge() {
        let table = Cuboid::new(Vec3::splat(5.0));
        let flat = Ellipsoid { radii: Vec3A::new(1.0, 0.25, 1.0), orientation: Rotation::IDENTITY };
        let center = Vec3A::new(5.5, 5.25, 0.0);
        let by_center = nearest(&table, center);
        assert!(by_center.distance - support(&flat, by_center.normal) < -0.3);
        let found = plane(&flat, center, &table);
        let gap = found.distance - support(&flat, found.normal);
        assert!((0.02..0.034).contains(&gap), "{gap} {found:?}");
    }

    /// Near touch: the whole shape is behind the plane, and of 20,000 sampled directions none is nearer by much; for flat shapes none at all.
    #[test]
    fn the_nearest_plane_is_found() {
        let points: Vec<Vec3> =
            (0..12).map(|i| Vec3::new(libm::sinf(i as f32), libm::cosf(1.7 * i as f32), libm::sinf(2.9 * i as f32)) * 0.6).collect();
        let hull = SharedShape::convex_hull(&points).unwrap();
        let (cuboid, cylinder) = (Cuboid::new(Vec3::new(0.5, 0.4, 0.6)), Cylinder::new(0.4, 0.5));
        let capsule = Capsule::new(Vec3::NEG_X * 0.3, Vec3::X * 0.4, 0.2);
        let shapes: [(&str, &dyn Shape, &dyn SupportMap, f32); 4] = [
            ("cuboid", &cuboid, &cuboid, 0.01),
            ("hull", &*hull, hull.as_support_map().unwrap(), 0.01),
            ("cylinder", &cylinder, &cylinder, 0.15),
            ("capsule", &capsule, &capsule, 0.15),
        ];
        for (name, shape, map, allowed) in shapes {
            let mut worst = 0.0f32;
            let mut tried = 0;
            for i in 0..300 {
                let f = i as f32;
                let out = Vec3A::new(libm::sinf(f * 1.3), libm::cosf(f * 2.1), libm::sinf(f * 0.7 + 1.0)).normalize();
                let out = out * (0.5 + 0.1 * (i % 5) as f32);
                let turn = quat_exp(Vec3A::new(libm::sinf(f), libm::cosf(f * 1.7), libm::sinf(f * 2.3)));
                let ellipsoid = Ellipsoid { radii: Vec3A::new(0.4, 0.1, 0.2), orientation: turn };
                let found = plane(&ellipsoid, out, shape);
                let nearness = found.distance / support(&ellipsoid, found.normal);
                let mut largest = f32::NEG_INFINITY;
                for k in 0..20_000 {
                    let z = 1.0 - 2.0 * (k as f32 + 0.5) / 20_000.0;
                    let (r, a) = ((1.0 - z * z).sqrt(), k as f32 * 2.399_963);
                    let n = Vec3A::new(r * libm::cosf(a), r * libm::sinf(a), z);
                    largest = largest.max((n.dot(out) - n.dot(map.local_support_point(n.into()).into())) / support(&ellipsoid, n));
                }
                // Far away and deep inside the plane is not asked for, or does not matter so much.
                if (0.8..1.3).contains(&largest) {
                    let behind = found.normal.dot(Vec3A::from(map.local_support_point(found.normal.into())) - found.point);
                    assert!(behind < 1e-4, "{name} {i}: {behind} m of it are before the plane");
                    worst = worst.max(largest - nearness);
                    tried += 1;
                }
            }
            assert!(tried > 20, "{name}: {tried}");
            assert!(worst < allowed, "{name}: falls short by {worst}");
        }
    }
}
