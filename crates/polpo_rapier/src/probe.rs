//! One particle against one convex part.

use bevy::math::Vec3A;
use polpo_solver::Ellipsoid;
use rapier3d::math::Pose;

use crate::cast::cast;
use crate::convex::Convex;
use crate::nearest::Nearest;

/// A particle in the axes of a collider or of one of its parts, over one step.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Probe {
    /// Centre at the start of the step.
    pub(crate) now: Vec3A,
    /// Where the centre may be at the end: if nothing stops it, and if the fastest part of its body takes it along. `None` if that is hardly elsewhere.
    pub(crate) ends: [Option<Vec3A>; 2],
    /// The last place where the centre was known to be on the right side of everything.
    pub(crate) free: Option<Vec3A>,
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
            now: into_part(pose, self.now),
            ends: self.ends.map(|end| end.map(|at| into_part(pose, at))),
            free: self.free.map(|at| into_part(pose, at)),
            ellipsoid: Ellipsoid { orientation: pose.rotation.inverse() * self.ellipsoid.orientation, ..self.ellipsoid },
            ..*self
        }
    }

    pub(crate) fn support(&self, n: Vec3A) -> f32 {
        if self.round { self.bound } else { self.ellipsoid.support(n).0 }
    }

    /// Smallest distance that can be told from none \[m\]: a share of the particle, and of what floats resolve so far from the shape's origin.
    fn tolerance(&self) -> f32 {
        (1e-3 * self.least).max(4e-7 * self.now.abs().max_element())
    }

    /// Asks the part `shape` at `pose` (`None`: at the collider's own) and reports what it finds, in the collider's axes.
    pub(crate) fn ask<S: Convex + ?Sized>(&self, shape: &S, pose: Option<&Pose>, mut report: impl FnMut(Finding)) {
        let Some(pose) = pose else { return self.ask_here(shape, report) };
        let back = |found: Nearest| Nearest {
            point: pose.transform_point(found.point.into()).into(),
            normal: pose.rotation * found.normal,
            ..found
        };
        self.of_part(pose).ask_here(shape, |found| {
            report(match found {
                Finding::Crossed(plane) => Finding::Crossed(back(plane)),
                Finding::Near(plane) => Finding::Near(back(plane)),
                Finding::Ahead(time, plane) => Finding::Ahead(time, back(plane)),
            });
        });
    }

    #[inline]
    fn ask_here<S: Convex + ?Sized>(&self, shape: &S, mut report: impl FnMut(Finding)) {
        let here = shape.nearest(self.now);
        if !here.is_finite() {
            return;
        }
        if let Some(free) = self.free
            && here.distance < free.distance(self.now)
            && let Some(hit) = self.crossing(shape, free)
        {
            report(Finding::Crossed(hit));
        }
        let motion = self.ends.iter().flatten().map(|end| end.distance(self.now)).fold(0.0, f32::max);
        if self.inside || here.distance > self.bound + self.slack + motion {
            return;
        }
        let (gap, near) = self.touch(self.now, shape, here);
        if gap <= self.slack {
            report(Finding::Near(near));
        }
        for end in self.ends.into_iter().flatten() {
            let look = |at| self.touch(at, shape, shape.nearest(at));
            let hit = cast(self.now, end, self.tolerance(), (gap, near), look);
            if let Some((time, hit)) = hit.filter(|(time, _)| *time > 0.0) {
                report(Finding::Ahead(time, hit));
            }
        }
    }

    /// Where the centre went in on its way from `free`.
    fn crossing<S: Convex + ?Sized>(&self, shape: &S, free: Vec3A) -> Option<Nearest> {
        let look = |at| {
            let there = shape.nearest(at);
            (there.distance, there)
        };
        let first = look(free);
        // What was inside has not gone in, wherever it has come out.
        let (_, hit) = Some(first).filter(|first| first.0 >= 0.0).and_then(|first| cast(free, self.now, self.tolerance(), first, look))?;
        (hit.normal.dot(self.now - hit.point) < 0.0).then_some(hit)
    }

    /// The gap between the ellipsoid about `center` and the part, whose place nearest to that is `here`, and the plane that shows it.
    #[inline]
    fn touch<S: Convex + ?Sized>(&self, center: Vec3A, shape: &S, here: Nearest) -> (f32, Nearest) {
        let reach = self.support(here.normal);
        let gap = here.distance - reach;
        if self.round || gap > self.slack {
            return (gap, here);
        }
        let near = shape.nearest_to(&self.ellipsoid, center, here);
        let reach = if near.normal == here.normal { reach } else { self.support(near.normal) };
        (near.distance - reach, near)
    }
}

/// A place in the axes of a part at `pose`.
pub(crate) fn into_part(pose: &Pose, at: Vec3A) -> Vec3A {
    pose.inverse_transform_point(at.into()).into()
}

#[cfg(test)]
mod tests {
    use super::*;
    use bevy::math::Vec3;
    use rapier3d::geometry::{Ball, Cuboid};
    use rapier3d::math::Rotation;

    fn probe(now: Vec3A, radii: Vec3A, orientation: Rotation) -> Probe {
        let (bound, least) = (radii.max_element(), radii.min_element());
        Probe {
            now,
            ends: [None; 2],
            free: None,
            ellipsoid: Ellipsoid { radii, orientation },
            round: bound == least,
            bound,
            least,
            slack: 0.5 * bound,
            inside: false,
        }
    }

    #[test]
    fn a_crossing_is_seen_only_if_the_way_crosses() {
        let plate = Cuboid::new(Vec3::new(5.0, 0.025, 5.0));
        let mut p = probe(Vec3A::new(0.0, -0.2, 0.0), Vec3A::splat(0.1), Rotation::IDENTITY);
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
        p.free = Some(Vec3A::new(0.3, 0.2, 0.0));
        assert_eq!(crossings(&p), [Vec3A::Y]);
        p.free = Some(Vec3A::new(0.3, -0.4, 0.0));
        assert!(crossings(&p).is_empty());
    }

    #[test]
    fn a_fast_particle_sees_the_surface_on_its_way() {
        let mut p = probe(Vec3A::new(0.0, 3.0, 0.0), Vec3A::splat(0.1), Rotation::IDENTITY);
        p.ends[0] = Some(Vec3A::new(0.0, -3.0, 0.0));
        let mut hit = None;
        p.ask(&Ball::new(1.0), None, |f| {
            if let Finding::Ahead(time, n) = f {
                hit = Some((time, n));
            }
        });
        let (time, n) = hit.unwrap();
        assert!((time - 1.9 / 6.0).abs() < 1e-3 && (n.normal - Vec3A::Y).length() < 1e-5);
    }
}
