//! The plane between an ellipsoid and a convex shape.
//!
//! The plane at the place nearest to the *centre* is the right one for a sphere only: a long ellipsoid that overhangs an edge would be thrown off it. The affine map that makes the ellipsoid a
//! unit sphere about the origin, y = diag(1/r)·Rᵀ(x − c), also maps planes to planes and sides to sides; the distance of the mapped plane from the origin is (n·(c − p))/h(n), with h the ellipsoid's
//! support. So the right plane is that of the mapped shape's place nearest to the origin, which is the one whose *nearness* (n·(c − p))/h(n) is largest. Nearness 1 is touch; below is overlap.

use polpo_solver::Ellipsoid;
use rapier3d::geometry::{Cuboid, Shape, Triangle, TypedShape};
use rapier3d::math::Vector;

use crate::nearest::{Nearest, nearest, nearest_on_triangle, visit_faces};

/// The plane between `shape` and the ellipsoid about `center`; `by_center` is the place of the shape nearest to the centre.
pub(crate) fn nearest_to_ellipsoid(ellipsoid: &Ellipsoid, center: Vector, shape: &dyn Shape, by_center: Nearest) -> Nearest {
    match shape.as_typed_shape() {
        TypedShape::Triangle(triangle) => return on_triangle(ellipsoid, center, triangle).1,
        // A triangle that has collapsed.
        TypedShape::Segment(segment) => return on_triangle(ellipsoid, center, &Triangle::new(segment.a, segment.b, segment.b)).1,
        TypedShape::Cuboid(cuboid) if by_center.distance > 0.0 => {
            if let Some(plane) = on_face(ellipsoid, center, cuboid, &by_center) {
                return plane;
            }
        }
        _ => {}
    }
    let mut inside = (f32::NEG_INFINITY, by_center);
    let mut outside = (f32::INFINITY, by_center);
    let flat = visit_faces(shape, &mut |face, normal| {
        let height = normal.dot(center - face.a);
        let nearness = height / support(ellipsoid, normal);
        if nearness > inside.0 {
            inside = (nearness, Nearest { point: center - normal * height, normal, distance: height });
        }
        if height > 0.0 && nearness < outside.0 {
            let here = on_triangle(ellipsoid, center, face);
            if here.0 < outside.0 {
                outside = here;
            }
        }
    });
    match flat {
        true if outside.0 < f32::INFINITY => outside.1,
        true => inside.1,
        false => search(ellipsoid, center, shape, by_center),
    }
}

fn support(ellipsoid: &Ellipsoid, n: Vector) -> f32 {
    ellipsoid.support(n.into()).0
}

/// The plane nearest to the centre, if it is the right one for the ellipsoid too: the mapped plane comes nearest to the origin at c − (Σn/h)·(n·(c − p))/h, and all of the box is behind the plane, so that it is if that place is the box's.
/// That spares most particles over a floor its twelve triangles.
fn on_face(ellipsoid: &Ellipsoid, center: Vector, cuboid: &Cuboid, by_center: &Nearest) -> Option<Nearest> {
    let (h, reach) = ellipsoid.support(by_center.normal.into());
    let point = center - Vector::from(reach) * (by_center.distance / h);
    // A place is on the face but for rounding.
    let slack = 4.0 * f32::EPSILON * (cuboid.half_extents.max_element() + center.abs().max_element());
    let there = (point.abs() - cuboid.half_extents).max_element() <= slack;
    there.then_some(Nearest { point, ..*by_center })
}

/// A triangle stays one under the map, so the answer is exact. Returns the nearness as well.
fn on_triangle(ellipsoid: &Ellipsoid, center: Vector, triangle: &Triangle) -> (f32, Nearest) {
    let radii = Vector::from(ellipsoid.radii);
    let back = ellipsoid.orientation.inverse();
    let map = |x: Vector| back * (x - center) / radii;
    let here = nearest_on_triangle(&Triangle::new(map(triangle.a), map(triangle.b), map(triangle.c)), Vector::ZERO);
    // Points go back by the map's inverse, normals by its transpose.
    let point = center + ellipsoid.orientation * (here.point * radii);
    let normal = (ellipsoid.orientation * (here.normal / radii)).normalize();
    (here.distance, Nearest { point, normal, distance: normal.dot(center - point) })
}

/// For round shapes, which do not stay what they are: the ellipsoid touches a plane with normal n at s = c − Σn/h, and near s it is like a sphere with one of its radii of curvature ρ, about
/// c' = s + ρn. The shape's place nearest to c' gives the next n, and at the solution the same n again. Every plane so found has the shape behind it, so that the nearest found is kept and the search never
/// ends worse than it began. ρ is tried where the ellipsoid is sharpest (min²/max, fast), then where it is flattest (max²/min, safe).
fn search(ellipsoid: &Ellipsoid, center: Vector, shape: &dyn Shape, first: Nearest) -> Nearest {
    let (least, most) = (ellipsoid.radii.min_element(), ellipsoid.radii.max_element());
    let nearness = |plane: &Nearest| plane.normal.dot(center - plane.point) / support(ellipsoid, plane.normal);
    let mut best = (nearness(&first), first);
    for _ in 0..8 {
        let surface = center - Vector::from(ellipsoid.support(best.1.normal.into()).1);
        let mut better = false;
        for radius in [least * least / most, most * most / least] {
            let there = nearest(shape, surface + best.1.normal * radius);
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
    use polpo_solver::quat_exp;
    use rapier3d::geometry::{Capsule, Cylinder, SharedShape, SupportMap};
    use rapier3d::math::Rotation;

    fn plane(ellipsoid: &Ellipsoid, center: Vector, shape: &dyn Shape) -> Nearest {
        nearest_to_ellipsoid(ellipsoid, center, shape, nearest(shape, center))
    }

    /// A flat ellipsoid lies across the edge of a table with its centre beyond the edge. The plane nearest to the centre would claim an overlap of 0.35 and throw it off; the ellipse
    /// x²+16y² = 1 about (0.5, 0.25) passes the corner at (0, 0) at a height of 0.0335.
    #[test]
    fn an_overhanging_ellipsoid_is_not_thrown_off_the_edge() {
        let table = Cuboid::new(Vector::splat(5.0));
        let flat = Ellipsoid { radii: Vector::new(1.0, 0.25, 1.0).into(), orientation: Rotation::IDENTITY };
        let center = Vector::new(5.5, 5.25, 0.0);
        let by_center = nearest(&table, center);
        assert!(by_center.distance - support(&flat, by_center.normal) < -0.3);
        let found = plane(&flat, center, &table);
        let gap = found.distance - support(&flat, found.normal);
        assert!((0.02..0.034).contains(&gap), "{gap} {found:?}");
    }

    /// Near touch: the whole shape is behind the plane, and of 20,000 sampled directions none is nearer by much; for flat shapes none at all.
    #[test]
    fn the_nearest_plane_is_found() {
        let points: Vec<Vector> =
            (0..12).map(|i| Vector::new(libm::sinf(i as f32), libm::cosf(1.7 * i as f32), libm::sinf(2.9 * i as f32)) * 0.6).collect();
        let hull = SharedShape::convex_hull(&points).unwrap();
        let (cuboid, cylinder) = (Cuboid::new(Vector::new(0.5, 0.4, 0.6)), Cylinder::new(0.4, 0.5));
        let capsule = Capsule::new(Vector::NEG_X * 0.3, Vector::X * 0.4, 0.2);
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
                let out = Vector::new(libm::sinf(f * 1.3), libm::cosf(f * 2.1), libm::sinf(f * 0.7 + 1.0)).normalize();
                let out = out * (0.5 + 0.1 * (i % 5) as f32);
                let turn = quat_exp(Vector::new(libm::sinf(f), libm::cosf(f * 1.7), libm::sinf(f * 2.3)).into());
                let ellipsoid = Ellipsoid { radii: Vector::new(0.4, 0.1, 0.2).into(), orientation: turn };
                let found = plane(&ellipsoid, out, shape);
                let nearness = found.distance / support(&ellipsoid, found.normal);
                let mut largest = f32::NEG_INFINITY;
                for k in 0..20_000 {
                    let z = 1.0 - 2.0 * (k as f32 + 0.5) / 20_000.0;
                    let (r, a) = ((1.0 - z * z).sqrt(), k as f32 * 2.399_963);
                    let n = Vector::new(r * libm::cosf(a), r * libm::sinf(a), z);
                    largest = largest.max((n.dot(out) - n.dot(map.local_support_point(n))) / support(&ellipsoid, n));
                }
                // Far away and deep inside the plane is not asked for, or does not matter so much.
                if (0.8..1.3).contains(&largest) {
                    let behind = found.normal.dot(map.local_support_point(found.normal) - found.point);
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
