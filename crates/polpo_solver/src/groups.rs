//! Implicit shape-matching groups: every particle with the neighbours its edges lead to.

use glam::{Mat3A, Quat, Vec3A};

use crate::coloring::{color_rows, rank};
use crate::{Edges, ExplicitGroups, Particles, RestPose};

/// One group a particle: itself and its one ring. Groups are sorted by colour, and by where they are at rest, and stored as compressed rows; groups of one colour share no particle.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ImplicitGroups {
    /// Where each group's members start in `members` and `rest`, and the end of the last.
    pub rows: Vec<u32>,
    /// Members, row after row; the first of a row is the particle the group belongs to.
    pub members: Vec<u32>,
    /// x̄_i − c̄, where each member is at rest, relative to its group's centre of mass \[m\].
    pub rest: Vec<Vec3A>,
    /// The rotation found last, the warm start of the next search; see [`forget_rotations`](Self::forget_rotations).
    pub rotation: Vec<Quat>,
    /// Where each colour starts among the groups, and the end of the last.
    pub colors: Vec<u32>,
    /// Which share each *group* has, as an index into the shares; empty: that of its first member.
    pub(crate) keys: Vec<u32>,
    /// Per *particle*, whether its group rests because an explicit group holds it; empty if none ever does.
    pub(crate) held: Vec<bool>,
    /// Per *particle*, whether groups see only its position, see [`ExplicitGroups`]; empty if none is so.
    pub(crate) unoriented: Vec<bool>,
    /// How each *particle* is turned in the rest pose, relative to the one the rig was made in; empty while they are the same.
    pub(crate) rest_rotation: Vec<Quat>,
    /// What plastic flow has added to each member's place in the rest pose \[m\], in the axes that the group's main particle has there; empty while nothing has flowed.
    pub(crate) flow: Vec<Vec3A>,
    /// By how much each member has been moved \[m\] and turned \[rad\] in this substep; empty with one sweep a substep.
    pub(crate) pulled: Vec<(Vec3A, Vec3A)>,
    /// Scratch: the ways of one group's members \[m\]. As long as the longest row.
    pub(crate) ways: Vec<Vec3A>,
    /// Per *particle*, B_i = (m_i/5)·Q_i·diag(a², b², c²)·Q_iᵀ \[kg·m²\], its own second moment at rest.
    ///
    /// An ellipsoid turned by R_i contributes A_i = ∫ (R_i·ȳ)·ȳᵀ dm = R_i·B_i to a group. (m/5·diag(a², b², c²)·R_i, as often printed, depends on the frame of reference.)
    pub moment: Vec<Mat3A>,
}

impl ImplicitGroups {
    /// The groups that `edges` imply. A particle without edges has none: alone, it is always in shape.
    pub fn new(particles: &Particles, edges: &Edges) -> Self {
        Self::beside(particles, edges, &ExplicitGroups::default())
    }

    /// The groups that `edges` imply in a body with explicit groups: a member of one has no group of its own, unless all that it is a member of can open; then it has one that rests while any of
    /// them is closed, see [`rest_where_held`](Self::rest_where_held). Members may be in a neighbour's group all the same.
    pub fn beside(particles: &Particles, edges: &Edges, explicit: &ExplicitGroups) -> Self {
        let n = particles.len();
        let mut neighbours: Vec<Vec<u32>> = vec![Vec::new(); n];
        for &[i, j] in &edges.pairs {
            neighbours[i as usize].push(j);
            neighbours[j as usize].push(i);
        }
        let rank = rank(&particles.rest_position);
        let mut rings: Vec<Vec<u32>> = neighbours
            .into_iter()
            .enumerate()
            .filter(|(i, ring)| !ring.is_empty() && explicit.leaves_group_to(*i))
            .map(|(i, mut ring)| {
                ring.sort_unstable_by_key(|&j| rank[j as usize]);
                ring.insert(0, i as u32);
                ring
            })
            .collect();
        rings.sort_unstable_by_key(|ring| rank[ring[0] as usize]);
        let (order, colors) = color_rows(n, rings.iter().map(|r| r.as_slice()));
        let mut groups = Self { rows: vec![0], colors, ..Self::default() };
        for &g in &order {
            let ring = &rings[g as usize];
            groups.members.extend_from_slice(ring);
            groups.rows.push(groups.members.len() as u32);
            groups.rotation.push(particles.rotation[ring[0] as usize]);
        }
        groups.pose(particles, &RestPose::default());
        groups.ways = vec![Vec3A::ZERO; rings.iter().map(Vec::len).max().unwrap_or(0)];
        groups.moment = (0..n).map(|i| second_moment(particles, i)).collect();
        groups.rest_where_held(explicit);
        groups
    }

    /// Lets the groups rest whose particles a closed explicit group holds, and wakes the others. To be called when [`ExplicitGroups::revision`] has changed; does nothing without explicit groups.
    pub fn rest_where_held(&mut self, explicit: &ExplicitGroups) {
        self.held.clear();
        if !explicit.is_empty() {
            self.held.extend((0..self.moment.len()).map(|i| explicit.holds(i)));
        }
    }

    /// Starts the search for every group's rotation from that of its main particle. To be called once a step.
    ///
    /// So what a step comes to follows from the particles alone: nothing about rotations has to be saved with them. In an octopus of 300 particles that comes down on a floor a search takes 1.72 Newton steps
    /// instead of 1.66 at 25 Hz, 2.26 instead of 2.05 at 2 Hz, the same at 200 Hz. (Once a substep, it would be 1.98 and 3.07.)
    pub fn forget_rotations(&mut self, particles: &Particles) {
        for (g, rotation) in self.rotation.iter_mut().enumerate() {
            let main = self.members[self.rows[g] as usize] as usize;
            let Some(&q) = particles.rotation.get(main) else { continue };
            *rotation = match self.rest_rotation.get(main) {
                Some(bar) => q * bar.inverse(),
                None => q,
            };
        }
    }

    /// Number of groups.
    #[inline]
    pub fn len(&self) -> usize {
        self.rotation.len()
    }

    /// Whether there are none.
    #[inline]
    pub fn is_empty(&self) -> bool {
        self.rotation.is_empty()
    }
}

/// B_i of particle `i`, see [`ImplicitGroups::moment`].
pub(crate) fn second_moment(particles: &Particles, i: usize) -> Mat3A {
    let q = Mat3A::from_quat(particles.frame[i]);
    let r = particles.radii[i];
    let d = r * r * (particles.mass[i] / 5.0);
    Mat3A::from_cols(q.x_axis * d.x, q.y_axis * d.y, q.z_axis * d.z) * q.transpose()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{blob, line, scramble};
    use crate::{Stiffness, Sweep, Turning, match_shapes, quat_exp};

    #[test]
    fn a_chain_has_groups_of_three_and_two() {
        let p = line(4, 1.0, 0.1);
        let edges = Edges::new(&p, &[[0, 1], [1, 2], [2, 3]]).unwrap();
        let groups = ImplicitGroups::new(&p, &edges);
        let mut rows: Vec<Vec<u32>> = groups.rows.windows(2).map(|r| groups.members[r[0] as usize..r[1] as usize].to_vec()).collect();
        rows.sort();
        assert_eq!(rows, [vec![0, 1], vec![1, 0, 2], vec![2, 1, 3], vec![3, 2]]);
    }

    #[test]
    fn a_step_depends_on_the_particles_alone() {
        let (mut a, pairs) = blob();
        scramble(&mut a, 4);
        let mut b = a.clone();
        let fresh = ImplicitGroups::new(&a, &Edges::new(&a, &pairs).unwrap());
        let mut used = fresh.clone();
        for q in &mut used.rotation {
            *q = quat_exp(Vec3A::new(0.1, -0.2, 0.1)) * *q;
        }
        let warm = used.clone();
        for (p, mut groups) in [(&mut a, fresh), (&mut b, used)] {
            groups.forget_rotations(p);
            match_shapes(&mut groups, p, Stiffness::Fraction(0.5).share(0.01).into(), Turning::AllMembers, Sweep::only(0.01));
        }
        assert_eq!(a, b);
        // Not forgotten, the rotations would be told from each other, if only in their last bits.
        let mut c = blob().0;
        scramble(&mut c, 4);
        match_shapes(&mut warm.clone(), &mut c, Stiffness::Fraction(0.5).share(0.01).into(), Turning::AllMembers, Sweep::only(0.01));
        assert_ne!(a, c);
        assert!(a.position.iter().zip(&c.position).all(|(a, c)| a.distance(*c) < 1e-5));
    }

    #[test]
    fn moment_is_that_of_the_ellipsoid() {
        let mut p = line(2, 1.0, 0.1);
        p.radii[0] = Vec3A::new(0.3, 0.2, 0.1);
        p.frame[0] = Quat::from_xyzw(0.0, 0.0, 0.5f32.sqrt(), 0.5f32.sqrt()); // x → y
        let edges = Edges::new(&p, &[[0, 1]]).unwrap();
        let b = ImplicitGroups::new(&p, &edges).moment[0];
        let m = p.mass[0] / 5.0;
        assert!((b.x_axis - Vec3A::X * (0.04 * m)).length() < 1e-7);
        assert!((b.y_axis - Vec3A::Y * (0.09 * m)).length() < 1e-7);
        assert!((b.z_axis - Vec3A::Z * (0.01 * m)).length() < 1e-7);
    }
}
