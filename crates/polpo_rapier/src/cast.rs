//! The first touch of something that moves on a straight line towards a convex shape.

use bevy::math::Vec3A;

use crate::nearest::Nearest;

/// When, as a share of the way, and where something on its way from `from` to `to` comes within `tolerance` \[m\] of a convex shape; `None` if it does not.
///
/// `look` gives, for a place of the moving thing, a plane with the shape behind it, and the gap between that plane and the thing; `first` is what it gives for `from`.
///
/// *Conservative advancement.* Nothing touches the shape before the thing crosses the plane (p, n): with gap g and approach −n·(to − from) it may go on by g/(−n·(to − from)) of the way. On a flat
/// face this arrives in one step, on a round one in a few. The step stops half a tolerance short of the plane, so that rounding never puts it on the other side, where a triangle would show its back.
/// A path that leaves, n·(to − from) ≥ 0, never touches.
///
/// A path that begins within the tolerance touches at 0. One that grazes the shape for more than 32 steps is taken to miss it.
pub(crate) fn cast(
    from: Vec3A,
    to: Vec3A,
    tolerance: f32,
    first: (f32, Nearest),
    look: impl Fn(Vec3A) -> (f32, Nearest),
) -> Option<(f32, Nearest)> {
    let motion = to - from;
    let mut time = 0.0;
    let (mut gap, mut here) = first;
    for _ in 0..32 {
        if gap <= tolerance {
            return here.is_finite().then_some((time, here));
        }
        let approach = -here.normal.dot(motion);
        if approach <= 0.0 {
            return None;
        }
        time += (gap - 0.5 * tolerance) / approach;
        if time > 1.0 || time.is_nan() {
            return None;
        }
        (gap, here) = look(from + motion * time);
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nearest::nearest;
    use bevy::math::Vec3;
    use rapier3d::geometry::{Ball, Cuboid, Cylinder, Shape, Triangle};

    const E: f32 = 1e-4;

    /// A sphere of `radius` on its way.
    fn sphere(shape: &dyn Shape, radius: f32, from: Vec3A, to: Vec3A) -> Option<(f32, Nearest)> {
        let look = |at| {
            let here = nearest(shape, at);
            (here.distance - radius, here)
        };
        cast(from, to, E, look(from), look)
    }

    #[test]
    fn a_point_meets_a_wall_where_it_stands() {
        let wall = Cuboid::new(Vec3::new(0.1, 5.0, 5.0));
        let (time, hit) = sphere(&wall, 0.0, Vec3A::new(-1.0, 0.2, 0.0), Vec3A::new(1.0, 0.4, 0.0)).unwrap();
        assert!((time - 0.45).abs() < E && (hit.normal - Vec3A::NEG_X).length() < 1e-5, "{time} {hit:?}");
    }

    #[test]
    fn a_sphere_meets_a_ball_when_the_radii_add_up() {
        let (time, hit) = sphere(&Ball::new(1.0), 0.5, Vec3A::new(-4.0, 0.5, 0.0), Vec3A::new(4.0, 0.5, 0.0)).unwrap();
        let x = -(1.5f32 * 1.5 - 0.25).sqrt();
        assert!((time - (x + 4.0) / 8.0).abs() < E, "{time}");
        assert!((hit.normal - Vec3A::new(x, 0.5, 0.0) / 1.5).length() < 1e-3, "{hit:?}");
    }

    #[test]
    fn a_near_miss_is_a_miss() {
        assert!(sphere(&Ball::new(1.0), 0.5, Vec3A::new(-4.0, 1.51, 0.0), Vec3A::new(4.0, 1.51, 0.0)).is_none());
        assert!(sphere(&Cylinder::new(1.0, 1.0), 0.5, Vec3A::new(0.0, 3.0, 0.0), Vec3A::new(0.0, 1.6, 0.0)).is_none());
    }

    #[test]
    fn a_triangle_is_met_on_the_side_one_comes_from() {
        let triangle = Triangle::new(Vec3::new(-100.0, 0.0, 100.0), Vec3::new(100.0, 0.0, 100.0), Vec3::new(0.0, 0.0, -100.0));
        for y in [0.5, -0.5] {
            let (_, hit) = sphere(&triangle, 0.0, Vec3A::new(30.0, y, 40.0), Vec3A::new(30.1, -y, 40.0)).unwrap();
            assert!(hit.normal.y * y > 0.4999, "{hit:?}");
        }
        assert!(sphere(&triangle, 0.0, Vec3A::new(30.0, f32::NAN, 40.0), Vec3A::ZERO).is_none());
    }
}
