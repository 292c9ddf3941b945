//! Of the planes found for one particle, those that matter.

use bevy::math::Vec3A;

/// A plane that one particle may have to stay above, relative to the body's origin, as of the start of the step.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Candidate {
    /// When it matters.
    pub(crate) when: When,
    /// How far the particle's centre is above the plane now \[m\].
    pub(crate) distance: f32,
    /// The same as a share of how far the particle reaches towards it: 1 is touch.
    pub(crate) nearness: f32,
    pub(crate) point: Vec3A,
    pub(crate) normal: Vec3A,
    /// How fast the plane turns \[rad/s\].
    pub(crate) turn: Vec3A,
    /// Which of the obstacles near the body, and which of its parts.
    pub(crate) obstacle: u32,
    pub(crate) part: u32,
}

/// When a plane matters, in the order of urgency.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum When {
    /// The centre went through it: it is on the wrong side now.
    Crossed,
    /// It is near.
    Now,
    /// The particle will touch it after this share of the step.
    Later(f32),
}

impl When {
    fn order(self) -> f32 {
        match self {
            Self::Crossed => -1.0,
            Self::Now => 0.0,
            Self::Later(time) => time,
        }
    }
}

/// How many planes a particle keeps at most: three hold it in a corner, one is to spare.
pub(crate) const MOST: usize = 4;

/// Sorts `candidates`, all of one particle, by urgency, and drops those hidden behind others.
///
/// A plane is the tangent plane of a convex part, so a part whose own point of contact is not above another part's plane, by more than `step` \[m\], cannot be touched before that plane is: it is
/// hidden. That drops the other triangles of a flat floor, whose points of contact are their edges; the neighbours in a row of boxes; the far side of a thin wall; duplicates. Without it
/// every inner edge would be a bump. A real corner stays: the wall's point of contact is above the floor.
///
/// A part is also dropped for a *less* urgent one that hides it. For exact planes that cannot happen, but that of a long ellipsoid at a round shape is found by a search and may be a little too urgent.
///
/// What rises above a plane by less than `step` is taken for a part of it: over an edge that small it is gentler to lift the particle when it is past it.
pub(crate) fn reduce(candidates: &mut Vec<Candidate>, step: f32) {
    let hides = |plane: &Candidate, other: &Candidate| plane.normal.dot(other.point - plane.point) <= step;
    candidates.sort_unstable_by(|a, b| {
        (a.when.order().total_cmp(&b.when.order()))
            .then(a.nearness.total_cmp(&b.nearness))
            .then((a.obstacle, a.part).cmp(&(b.obstacle, b.part)))
    });
    let mut kept = 0;
    for i in 0..candidates.len() {
        let candidate = candidates[i];
        if candidates[..kept].iter().any(|plane| hides(plane, &candidate)) {
            continue;
        }
        if candidate.when == When::Now {
            let mut left = 0;
            for k in 0..kept {
                if candidates[k].when != When::Now || !hides(&candidate, &candidates[k]) {
                    candidates[left] = candidates[k];
                    left += 1;
                }
            }
            kept = left;
        }
        if kept < MOST {
            candidates[kept] = candidate;
            kept += 1;
        }
    }
    candidates.truncate(kept);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plane(point: Vec3A, normal: Vec3A) -> Candidate {
        let center = Vec3A::Y;
        Candidate {
            when: When::Now,
            distance: normal.dot(center - point),
            nearness: 2.0 * normal.dot(center - point),
            point,
            normal,
            turn: Vec3A::ZERO,
            obstacle: 0,
            part: 0,
        }
    }

    /// The plane by which a particle at (0, 1, 0) sees a point.
    fn edge(point: Vec3A) -> Candidate {
        plane(point, (Vec3A::Y - point).normalize())
    }

    #[test]
    fn inner_edges_of_a_flat_floor_go() {
        let mut list = vec![edge(Vec3A::new(0.4, 0.0, 0.0)), edge(Vec3A::new(-0.1, 1e-6, 0.3)), plane(Vec3A::ZERO, Vec3A::Y)];
        reduce(&mut list, 1e-3);
        assert_eq!(list.len(), 1);
        assert_eq!(list[0].normal, Vec3A::Y);
    }

    #[test]
    fn a_corner_keeps_both_its_sides() {
        let wall = plane(Vec3A::new(0.9, 1.0, 0.0), Vec3A::NEG_X);
        let mut list = vec![plane(Vec3A::ZERO, Vec3A::Y), wall, plane(Vec3A::new(0.9, 0.0, 0.0), Vec3A::NEG_X)];
        reduce(&mut list, 1e-3);
        assert_eq!(list.iter().map(|c| c.normal).collect::<Vec<_>>(), [Vec3A::NEG_X, Vec3A::Y]);
    }

    #[test]
    fn a_crossed_plane_hides_what_is_behind_it() {
        let mut crossed = plane(Vec3A::Y * 1.2, Vec3A::Y);
        crossed.when = When::Crossed;
        // The same thin floor as seen from below, and its underside.
        let mut list = vec![plane(Vec3A::Y * 1.2, Vec3A::NEG_Y), plane(Vec3A::Y * 1.1, Vec3A::NEG_Y), crossed];
        reduce(&mut list, 1e-3);
        assert_eq!(list.len(), 1);
        assert_eq!(list[0].normal, Vec3A::Y);
    }

    /// A neighbour's edge that claims to be deeper than the floor it belongs to.
    #[test]
    fn a_false_edge_goes_although_it_is_more_urgent() {
        let mut false_edge = edge(Vec3A::new(0.4, 0.0, 0.0));
        false_edge.nearness = 0.2;
        let mut list = vec![false_edge, plane(Vec3A::ZERO, Vec3A::Y)];
        reduce(&mut list, 1e-3);
        assert_eq!(list.len(), 1);
        assert_eq!(list[0].normal, Vec3A::Y);
    }

    #[test]
    fn at_most_four_are_kept_and_the_order_does_not_matter() {
        let mut list: Vec<Candidate> = (0..9)
            .map(|i| {
                let a = i as f32 * 0.7;
                let out = Vec3A::new(libm::cosf(a), 0.3 * libm::sinf(3.0 * a), libm::sinf(a));
                plane(Vec3A::Y + out, -out.normalize())
            })
            .collect();
        let mut turned = list.clone();
        turned.reverse();
        reduce(&mut list, 1e-3);
        reduce(&mut turned, 1e-3);
        assert_eq!(list.len(), MOST);
        assert!(list.iter().zip(&turned).all(|(a, b)| a.point == b.point));
    }
}
