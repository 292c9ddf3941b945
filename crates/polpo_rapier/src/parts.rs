//! What a shape is made of: its convex parts near a box, and on which side of a surface a point is.

use bevy::math::Vec3A;
use rapier3d::geometry::{Cuboid, HeightField, PointQueryWithLocation, Shape, TriMesh, TriMeshFlags, TypedShape};
use rapier3d::math::{Pose, Vector};
use rapier3d::parry::bounding_volume::Aabb;

use crate::nearest::Nearest;

/// Takes a part's number, its pose in the axes of the whole (`None`: the same), and the part.
pub(crate) type VisitPart<'a> = dyn FnMut(u32, Option<&Pose>, &dyn Shape) + 'a;

/// Calls `visit` with every convex part of `shape` whose bounds meet `bounds`. A shape that is convex has one part, itself.
///
/// The order depends on the shape alone.
pub(crate) fn visit_parts(shape: &dyn Shape, bounds: &Aabb, visit: &mut VisitPart) {
    match shape.as_typed_shape() {
        TypedShape::HeightField(field) => {
            field.map_elements_in_local_aabb(bounds, &mut |part, triangle| visit(part, None, triangle));
        }
        TypedShape::Voxels(voxels) => {
            let cube = Cuboid::new(voxels.voxel_size() * 0.5);
            for voxel in voxels.voxels_intersecting_local_aabb(bounds) {
                if !voxel.state.is_empty() {
                    visit(voxel.linear_id.flat_id() as u32, Some(&Pose::from_translation(voxel.center)), &cube);
                }
            }
        }
        // The commonest composite, without the detour over trait objects.
        TypedShape::TriMesh(mesh) => {
            for part in mesh.bvh().intersect_aabb(bounds) {
                visit(part, None, &mesh.triangle(part));
            }
        }
        _ => match shape.as_composite_shape() {
            Some(composite) => {
                for part in composite.bvh().intersect_aabb(bounds) {
                    composite.map_part_at(part, &mut |pose, shape, _| visit(part, pose, shape));
                }
            }
            None => visit(0, None, shape),
        },
    }
}

/// Whether `shape` is a surface of triangles of which only the side that their normals point to is a good one.
pub(crate) fn is_one_sided(shape: &dyn Shape) -> bool {
    match shape.as_typed_shape() {
        TypedShape::HeightField(_) => true,
        TypedShape::TriMesh(mesh) => mesh.flags().contains(TriMeshFlags::ORIENTED),
        _ => false,
    }
}

/// If `at` is on the wrong side of a surface that has only one good side, the plane through which it gets out.
///
/// A height field is solid below, but not all the way down: a point more than `depth` \[m\] below it is taken to be in a cave, under a bridge, on a lower floor. A triangle mesh with
/// [`TriMeshFlags::ORIENTED`] is solid inside. All other surfaces are the same from both sides.
pub(crate) fn way_out(shape: &dyn Shape, at: Vec3A, depth: f32) -> Option<Nearest> {
    match shape.as_typed_shape() {
        TypedShape::HeightField(field) => out_of_ground(field, at.into(), depth),
        TypedShape::TriMesh(mesh) if mesh.flags().contains(TriMeshFlags::ORIENTED) => out_of_mesh(mesh, at.into()),
        _ => None,
    }
}

fn out_of_ground(field: &HeightField, at: Vector, depth: f32) -> Option<Nearest> {
    let (row, column) = field.cell_at_point(at)?;
    let (left, right) = field.triangles_at(row, column);
    [left, right].into_iter().flatten().find_map(|triangle| {
        let over = Vector::new(at.x, 0.0, at.z);
        let edges = [(triangle.a, triangle.b), (triangle.b, triangle.c), (triangle.c, triangle.a)];
        let turns = edges.map(|(a, b)| (b - a).cross(over - a).y);
        if !(turns.iter().all(|t| *t >= 0.0) || turns.iter().all(|t| *t <= 0.0)) {
            return None;
        }
        let normal = triangle.normal()?;
        let normal = if normal.y < 0.0 { -normal } else { normal };
        let distance = normal.dot(at - triangle.a);
        (distance < 0.0 && distance >= -depth).then(|| Nearest { point: (at - normal * distance).into(), normal: normal.into(), distance })
    })
}

fn out_of_mesh(mesh: &TriMesh, at: Vector) -> Option<Nearest> {
    let (projection, (triangle, _)) = mesh.project_local_point_and_get_location(at, false);
    if !projection.is_inside {
        return None;
    }
    let way = projection.point - at;
    let length = way.length();
    let normal =
        if length > 1e-5 * at.abs().max_element() { way / length } else { mesh.triangle(triangle).scaled_normal().normalize_or(Vector::Y) };
    Some(Nearest { point: projection.point.into(), normal: normal.into(), distance: -length })
}

#[cfg(test)]
mod tests {
    use super::*;
    use rapier3d::geometry::{Array2, SharedShape};

    fn parts(shape: &dyn Shape, bounds: &Aabb) -> Vec<u32> {
        let mut list = Vec::new();
        visit_parts(shape, bounds, &mut |part, _, _| list.push(part));
        list.sort_unstable();
        list
    }

    #[test]
    fn only_parts_near_the_box_are_visited() {
        let balls = (0..5).map(|i| (Pose::translation(i as f32, 0.0, 0.0), SharedShape::ball(0.2))).collect();
        let row = SharedShape::compound(balls);
        let bounds = Aabb::new(Vector::new(0.9, -0.1, -0.1), Vector::new(2.1, 0.1, 0.1));
        assert_eq!(parts(&*row, &bounds), [1, 2]);
        assert_eq!(parts(&*SharedShape::ball(1.0), &bounds), [0]);
    }

    #[test]
    fn ground_is_solid_below_and_hollow_deep_down() {
        // Rows go along z, columns along x: a plane that rises by 0.5 a metre along x.
        let heights = Array2::new(3, 3, vec![0.0, 0.0, 0.0, 0.5, 0.5, 0.5, 1.0, 1.0, 1.0]);
        let field = SharedShape::heightfield(heights, Vector::new(2.0, 1.0, 2.0));
        let surface = |x: f32| 0.5 + 0.5 * x;
        for (x, z) in [(0.3, 0.2), (-0.6, 0.9), (0.7, -0.4), (-0.2, -0.9)] {
            let out = way_out(&*field, Vec3A::new(x, surface(x) - 0.1, z), 1.0).unwrap();
            assert!((out.normal - Vec3A::new(-0.5, 1.0, 0.0).normalize()).length() < 1e-4, "{out:?}");
            assert!((out.distance + 0.1 * out.normal.y).abs() < 1e-4, "{out:?}");
            assert!(way_out(&*field, Vec3A::new(x, surface(x) + 0.1, z), 1.0).is_none());
            assert!(way_out(&*field, Vec3A::new(x, surface(x) - 3.0, z), 1.0).is_none());
        }
        assert!(way_out(&*field, Vec3A::new(1.2, 0.0, 0.0), 1.0).is_none());
    }

    #[test]
    fn an_oriented_mesh_is_solid() {
        let (points, triangles) = Cuboid::new(Vector::new(0.5, 0.3, 0.7)).to_trimesh();
        let bare = SharedShape::trimesh(points.clone(), triangles.clone()).unwrap();
        let solid = SharedShape::trimesh_with_flags(points, triangles, TriMeshFlags::ORIENTED).unwrap();
        let inside = Vec3A::new(0.1, 0.2, 0.0);
        let out = way_out(&*solid, inside, 1.0).unwrap();
        assert!((out.normal - Vec3A::Y).length() < 1e-4 && (out.distance + 0.1).abs() < 1e-5, "{out:?}");
        assert!(way_out(&*solid, Vec3A::new(0.1, 0.4, 0.0), 1.0).is_none());
        assert!(way_out(&*bare, inside, 1.0).is_none());
    }
}
