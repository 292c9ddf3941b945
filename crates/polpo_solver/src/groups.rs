//! Implicit shape-matching groups: every particle with the neighbours its edges lead to.

use std::cmp::Reverse;
use std::ops::Range;
use std::sync::Arc;

use glam::{Mat3A, Quat, Vec3A};

use crate::batches::Batches;
use crate::coloring::{batch_rows, rank};
use crate::lanes::LANES;
use crate::match_batch::Gathered;
use crate::{Edges, ExplicitGroups, GroupError, Particles, RestPose};

/// One group a particle: itself and its one ring, stored as compressed rows. What does not change is shared by clones, until rest shapes or masses become a clone's own. Groups stand in batches of up to eight that share no particle, which are solved side by side; what goes into a batch goes by the groups' length and
/// by where they are at rest.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ImplicitGroups {
    /// Where each group's members start in `members` and `rest`, and the end of the last.
    pub(crate) rows: Arc<[u32]>,
    /// Members, row after row; the first of a row is the particle the group belongs to.
    pub(crate) members: Arc<[u32]>,
    /// x̄_i − c̄, where each member is at rest, relative to its group's centre of mass \[m\].
    pub(crate) rest: Arc<Vec<Vec3A>>,
    /// The rotation found last, the warm start of the next search; see [`forget_rotations`](Self::forget_rotations).
    pub rotation: Vec<Quat>,
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
    /// The groups as the vector kernel reads them; none if it is not used for them.
    pub(crate) batches: Arc<Batches>,
    /// Scratch of that kernel. As long as the longest row.
    pub(crate) gathered: Vec<Gathered>,
    /// Scratch: the ways of one group's members \[m\]. As long as the longest row.
    pub(crate) ways: Vec<Vec3A>,
    /// Per *particle*, see [`moment`](Self::moment).
    pub(crate) moment: Arc<[Mat3A]>,
}

impl ImplicitGroups {
    /// The groups that `edges` imply. A particle without edges has none: alone, it is always in shape.
    pub fn new(particles: &Particles, edges: &Edges) -> Self {
        Self::beside(particles, edges, &ExplicitGroups::default())
    }

    /// The groups that `edges` imply in a body with explicit groups: a member of one has no group of its own, unless all that it is a member of can open; then it has one that rests while any of
    /// them is closed, see [`rest_where_held`](Self::rest_where_held). Members may be in a neighbour's group all the same.
    pub fn beside(particles: &Particles, edges: &Edges, explicit: &ExplicitGroups) -> Self {
        let mut neighbours: Vec<Vec<u32>> = vec![Vec::new(); particles.len()];
        for &[i, j] in &edges.pairs {
            neighbours[i as usize].push(j);
            neighbours[j as usize].push(i);
        }
        let rank = rank(&particles.rest_position);
        let rings = neighbours.into_iter().enumerate().filter(|(i, ring)| !ring.is_empty() && explicit.leaves_group_to(*i));
        let rings = rings.map(|(i, mut ring)| {
            ring.sort_unstable_by_key(|&j| rank[j as usize]);
            ring.insert(0, i as u32);
            ring
        });
        let mut groups = Self::sorted(particles, rings.collect(), &rank);
        groups.rest_where_held(explicit);
        groups
    }

    /// Groups of any members, of which the first is the particle that the group belongs to: two rings instead of one, say.
    ///
    /// # Errors
    ///
    /// The first group that is empty, names a particle twice or one that does not exist.
    pub fn of(particles: &Particles, rows: &[&[u32]]) -> Result<Self, GroupError> {
        check_members(particles.len(), rows.iter().copied())?;
        Ok(Self::sorted(particles, rows.iter().map(|row| row.to_vec()).collect(), &rank(&particles.rest_position)))
    }

    fn sorted(particles: &Particles, mut rings: Vec<Vec<u32>>, rank: &[u32]) -> Self {
        rings.sort_by_key(|ring| (Reverse(ring.len()), rank[ring[0] as usize]));
        let (order, batches) = batch_rows(particles.len(), LANES, rings.iter().map(|r| r.as_slice()));
        let (mut rows, mut members) = (vec![0], Vec::new());
        let mut groups = Self::default();
        for &g in &order {
            let ring = &rings[g as usize];
            members.extend_from_slice(ring);
            rows.push(members.len() as u32);
            groups.rotation.push(particles.rotation[ring[0] as usize]);
        }
        (groups.rows, groups.members) = (rows.into(), members.into());
        groups.moment = (0..particles.len()).map(|i| second_moment(particles, i)).collect();
        groups.batches = Arc::new(Batches::new(batches, &groups.rows, &groups.members, &groups.moment));
        groups.gathered = vec![Gathered::default(); groups.batches.longest()];
        groups.ways = vec![Vec3A::ZERO; groups.batches.longest()];
        groups.pose(particles, &RestPose::default());
        // Before there are clones, which would each get masses of their own.
        Batches::masses(&mut groups.batches, &groups.rows, &particles.mass);
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

    /// The members of group `g`; the first is the particle that it belongs to.
    ///
    /// # Panics
    ///
    /// If there is no group `g`; so do the next two.
    #[inline]
    pub fn members(&self, g: usize) -> &[u32] {
        &self.members[self.row(g)]
    }

    /// x̄_i − c̄, where each member of group `g` is at rest, relative to its group's centre of mass \[m\].
    #[inline]
    pub fn rest(&self, g: usize) -> &[Vec3A] {
        &self.rest[self.row(g)]
    }

    /// Which of all groups' members those of group `g` are.
    #[inline]
    pub fn row(&self, g: usize) -> Range<usize> {
        self.rows[g] as usize..self.rows[g + 1] as usize
    }

    /// How many members all groups have together.
    #[inline]
    pub fn member_count(&self) -> usize {
        self.members.len()
    }

    /// How many batches of groups that share no particle there are.
    #[inline]
    pub fn batch_count(&self) -> usize {
        self.batches.len()
    }

    /// B_i = (m_i/5)·Q_i·diag(a², b², c²)·Q_iᵀ \[kg·m²\], the second moment of particle `i` at rest.
    ///
    /// An ellipsoid turned by R_i contributes A_i = ∫ (R_i·ȳ)·ȳᵀ dm = R_i·B_i to a group. (m/5·diag(a², b², c²)·R_i, as often printed, depends on the frame of reference.)
    ///
    /// # Panics
    ///
    /// If there is no particle `i`.
    #[inline]
    pub fn moment(&self, i: usize) -> Mat3A {
        self.moment[i]
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

/// Checks that each group has members, each once, among `count` particles.
pub(crate) fn check_members<'a>(count: usize, groups: impl Iterator<Item = &'a [u32]>) -> Result<(), GroupError> {
    let mut last = vec![usize::MAX; count];
    for (group, members) in groups.enumerate() {
        if members.is_empty() {
            return Err(GroupError::Empty { group });
        }
        for &particle in members {
            match last.get_mut(particle as usize) {
                None => return Err(GroupError::Index { group, particle, count }),
                Some(l) if *l == group => return Err(GroupError::Duplicate { group, particle }),
                Some(l) => *l = group,
            }
        }
    }
    Ok(())
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
