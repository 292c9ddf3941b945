//! One particle against one convex part.

use polpo_solver::Ellipsoid;
use rapier3d::geometry::Shape;
use rapier3d::math::{Pose, Vector};

use crate::cast::cast;
use crate::nearest::{Nearest, nearest};
use crate::touch::nearest_to_ellipsoid;

/// A particle in the axes of a collider or of one of its parts, over one step.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Probe {
    /// Centre at the start of the step.
    pub(crate) now: Vector,
    /// Where the centre may be at the end: if nothing stops it, and if the fastest part of its body takes it along. `None` if that is hardly elsewhere.
    pub(crate) ends: [Option<Vector>; 2],
    /// The last place where the centre was known to be on the right side of everything.
    pub(crate) free: Option<Vector>,
    pub(crate) ellipsoid: Ellipsoid,
    /// Whether the ellipsoid is a sphere.
    pub(crate) round: bool,
    /// Largest and smallest half axis \[m\].
    pub(crate) bound: f32,
    pub(crate) least: f32,
    /// Gaps up to this count as near \[m\].
    pub(crate) slack: f32,
    /// Whether the particle is known to be on the wrong side of this collider, so that only crossings count.
    pub(crate) inside: bool,
}

/// What a probe found. The distances are those of the centre at the place where it was found.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Finding {
    /// The centre went through this place.
    Crossed(Nearest),
    /// This place is near.
    Near(Nearest),
    /// The particle touches this place after the given share of the step.
    Ahead(f32, Nearest),
}

impl Probe {
    /// The same particle in the axes of a part at `pose`.
    fn of_part(&self, pose: &Pose) -> Self {
        Self {
            now: pose.inverse_transform_point(self.now),
            ends: self.ends.map(|end| end.map(|at| pose.inverse_transform_point(at))),
            free: self.free.map(|at| pose.inverse_transform_point(at)),
            ellipsoid: Ellipsoid { orientation: pose.rotation.inverse() * self.ellipsoid.orientation, ..self.ellipsoid },
            ..*self
        }
    }

    pub(crate) fn support(&self, n: Vector) -> f32 {
        if self.round { self.bound } else { self.ellipsoid.support(n.into()).0 }
    }

    /// Smallest distance that can be told from none \[m\]: a share of the particle, and of what floats resolve so far from the shape's origin.
    fn tolerance(&self) -> f32 {
        (1e-3 * self.least).max(4e-7 * self.now.abs().max_element())
    }

    /// Asks the part `shape` at `pose` (`None`: at the collider's own) and reports what it finds, in the collider's axes.
    pub(crate) fn ask(&self, shape: &dyn Shape, pose: Option<&Pose>, mut report: impl FnMut(Finding)) {
        let (local, pose) = match pose {
            Some(pose) => (self.of_part(pose), *pose),
            None => (*self, Pose::IDENTITY),
        };
        let back = |found: Nearest| Nearest { point: pose.transform_point(found.point), normal: pose.rotation * found.normal, ..found };
        let here = nearest(shape, local.now);
        if !here.is_finite() {
            return;
        }
        if let Some(free) = local.free
            && here.distance < free.distance(local.now)
        {
            let look = |at| {
                let there = nearest(shape, at);
                (there.distance, there)
            };
            let first = look(free);
            // What was inside has not gone in, wherever it has come out.
            if first.0 >= 0.0
                && let Some((_, hit)) = cast(free, local.now, local.tolerance(), first, look)
                && hit.normal.dot(local.now - hit.point) < 0.0
            {
                report(Finding::Crossed(back(hit)));
            }
        }
        let motion = local.ends.iter().flatten().map(|end| end.distance(local.now)).fold(0.0, f32::max);
        if local.inside || here.distance > local.bound + local.slack + motion {
            return;
        }
        let (gap, near) = local.touch(shape, here);
        if gap <= local.slack {
            report(Finding::Near(back(near)));
        }
        for end in local.ends.into_iter().flatten() {
            let look = |at| Self { now: at, ..local }.touch(shape, nearest(shape, at));
            let hit = cast(local.now, end, local.tolerance(), (gap, near), look);
            if let Some((time, hit)) = hit.filter(|(time, _)| *time > 0.0) {
                report(Finding::Ahead(time, back(hit)));
            }
        }
    }

    /// The gap between the ellipsoid and the part, whose place nearest to the centre is `here`, and the plane that shows it.
    fn touch(&self, shape: &dyn Shape, here: Nearest) -> (f32, Nearest) {
        let gap = here.distance - self.support(here.normal);
        if self.round || gap > self.slack {
            return (gap, here);
        }
        let near = nearest_to_ellipsoid(&self.ellipsoid, self.now, shape, here);
        (near.distance - self.support(near.normal), near)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rapier3d::geometry::{Ball, Cuboid};
    use rapier3d::math::Rotation;

    fn probe(now: Vector, radii: Vector, orientation: Rotation) -> Probe {
        let (bound, least) = (radii.max_element(), radii.min_element());
        Probe {
            now,
            ends: [None; 2],
            free: None,
            ellipsoid: Ellipsoid { radii: radii.into(), orientation },
            round: bound == least,
            bound,
            least,
            slack: 0.5 * bound,
            inside: false,
        }
    }

    #[test]
    fn a_crossing_is_seen_only_if_the_way_crosses() {
        let plate = Cuboid::new(Vector::new(5.0, 0.025, 5.0));
        let mut p = probe(Vector::new(0.0, -0.2, 0.0), Vector::splat(0.1), Rotation::IDENTITY);
        let crossings = |p: &Probe| {
            let mut list = Vec::new();
            p.ask(&plate, None, |f| {
                if let Finding::Crossed(n) = f {
                    list.push(n.normal);
                }
            });
            list
        };
        assert!(crossings(&p).is_empty());
        p.free = Some(Vector::new(0.3, 0.2, 0.0));
        assert_eq!(crossings(&p), [Vector::Y]);
        p.free = Some(Vector::new(0.3, -0.4, 0.0));
        assert!(crossings(&p).is_empty());
    }

    #[test]
    fn a_fast_particle_sees_the_surface_on_its_way() {
        let mut p = probe(Vector::new(0.0, 3.0, 0.0), Vector::splat(0.1), Rotation::IDENTITY);
        p.ends[0] = Some(Vector::new(0.0, -3.0, 0.0));
        let mut hit = None;
        p.ask(&Ball::new(1.0), None, |f| {
            if let Finding::Ahead(time, n) = f {
                hit = Some((time, n));
            }
        });
        let (time, n) = hit.unwrap();
        assert!((time - 1.9 / 6.0).abs() < 1e-3 && (n.normal - Vector::Y).length() < 1e-5);
    }
}
