//! Explicit shape-matching groups: any subsets of a body's particles, each a rigid or soft piece; particles that two of them share are joints.

use std::sync::Arc;

use glam::{DVec3, Quat, Vec3A};

use crate::groups::{check_members, second_moment};
use crate::joints::Joints;
use crate::landing::Landing;
use crate::rigid_groups::{Held, RigidBody};
use crate::{Contacts, ImplicitGroups, Motor, Particles, Share, Stiffness};

/// What an explicit group is made of and how it behaves.
#[derive(Clone, Debug, PartialEq)]
pub struct ExplicitGroup {
    /// Its particles, each once, in any order.
    pub members: Vec<u32>,
    /// How strongly it pulls. [`Stiffness::RIGID`], the default, makes it a rigid body; anything softer matches shapes as implicit groups do.
    pub stiffness: Stiffness,
    /// Whether blows open it; default no.
    pub deformable: Option<Deformable>,
    /// What drives it; default nothing.
    pub motor: Option<Motor>,
    /// Size of the rest shape against that of the particles at rest, positive; default 1. Other values inflate or shrink it.
    pub scale: f32,
}

impl ExplicitGroup {
    /// A rigid group of `members`.
    pub fn rigid(members: impl Into<Vec<u32>>) -> Self {
        Self { members: members.into(), stiffness: Stiffness::RIGID, deformable: None, motor: None, scale: 1.0 }
    }
}

/// How a blow opens a group: it then exerts nothing for a while, and its members' implicit groups hold them instead.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Deformable {
    /// From which closing speed of a member's contact on \[m/s\], 0 … infinity. Too low, and a group opens by rolling; infinite, and it never does.
    pub speed: f32,
    /// For how long \[s\], positive. A blow while it is open starts the time anew.
    pub time: f32,
    /// How much of a dent may stay when it closes, 0 … 1: the mean distance of the members from where they were made, over the group's mean radius. 0 springs back.
    pub dent: f32,
}

/// What is wrong with an explicit group.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum GroupError {
    /// It has no members.
    #[error("group {group} has no members")]
    Empty {
        /// Which group.
        group: usize,
    },
    /// A member does not exist.
    #[error("group {group}: particle {particle} is not among the {count} there are")]
    Index {
        /// Which group.
        group: usize,
        /// The member that does not exist.
        particle: u32,
        /// How many particles there are.
        count: usize,
    },
    /// A member is named twice.
    #[error("group {group}: particle {particle} is named twice")]
    Duplicate {
        /// Which group.
        group: usize,
        /// The member.
        particle: u32,
    },
    /// A number is out of its range.
    #[error("group {group}: {what} is {value}, {range}")]
    Range {
        /// Which group.
        group: usize,
        /// Which of its numbers.
        what: &'static str,
        /// What it is.
        value: f32,
        /// What it should be.
        range: &'static str,
    },
    /// A group is named that does not exist.
    #[error("group {group} is not among the {count} there are")]
    NoGroup {
        /// The group that does not exist.
        group: usize,
        /// How many groups there are.
        count: usize,
    },
    /// A motor acts against its own group.
    #[error("group {group}: its motor acts against itself")]
    Against {
        /// Which group.
        group: usize,
    },
}

/// The explicit groups of one body, in the order they were given, as compressed rows.
///
/// A particle that is in two or more groups is a *joint* and *non-oriented* (Müller & Chentanez 2011): no group looks at its orientation. It follows the first rigid group it is in, for skinning, and
/// its spin inertia counts there. One such particle makes a ball joint, two make a hinge, three that are not on one line weld. In soft groups nobody turns it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ExplicitGroups {
    /// Rows, members, rest offsets and rotations. The last rotations are those of the soft groups; those of the rigid ones are in `bodies`.
    pub(crate) shape: ImplicitGroups,
    pub(crate) stiffness: Vec<Stiffness>,
    pub(crate) deformable: Vec<Option<Deformable>>,
    pub(crate) motor: Vec<Option<Motor>>,
    pub(crate) scale: Vec<f32>,
    /// How long each group stays open \[s\]; 0 for a closed one.
    pub(crate) open: Vec<f32>,
    /// Per particle, whether it is a member, and whether all the groups it is in can open.
    membership: Vec<Membership>,
    pub(crate) revision: u32,
    /// Per group, what it is as a rigid body.
    pub(crate) bodies: Vec<RigidBody>,
    /// Per row entry, what its group last made of the member.
    pub(crate) held: Vec<Held>,
    pub(crate) joints: Joints,
    /// Scratch: the shares of the soft groups.
    pub(crate) shares: Vec<Share>,
    /// Scratch: what contacts did to one group's members.
    pub(crate) landings: Vec<Landing>,
    /// Scratch: the groups that motors turn, and the angular impulses on them \[N·m·s\].
    pub(crate) driven: Vec<(u32, DVec3)>,
    /// Scratch: how many rigid groups each particle is in.
    pub(crate) sharers: Vec<u32>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Membership {
    groups: u32,
    closed: u32,
    rigid_for_good: bool,
}

impl ExplicitGroups {
    /// Groups of `particles` in the shape they have at rest.
    ///
    /// # Errors
    ///
    /// The first group that is empty, names a particle twice or one that does not exist, or has a setting out of range.
    pub fn new(particles: &Particles, groups: &[ExplicitGroup]) -> Result<Self, GroupError> {
        let n = particles.len();
        let mut this = Self { membership: vec![Membership::default(); n], ..Self::default() };
        let (mut rows, mut members) = (vec![0], Vec::new());
        check_members(n, groups.iter().map(|g| g.members.as_slice()))?;
        for (g, group) in groups.iter().enumerate() {
            for &particle in &group.members {
                let m = &mut this.membership[particle as usize];
                m.groups += 1;
                m.closed += 1;
                m.rigid_for_good |= group.deformable.is_none();
            }
            check_scale(g, group.scale)?;
            if let Some(d) = group.deformable {
                check_deformable(g, d)?;
            }
            if let Some(motor) = group.motor {
                motor.check(g, groups.len())?;
            }
            members.extend_from_slice(&group.members);
            rows.push(members.len() as u32);
            this.shape.rotation.push(particles.rotation[group.members[0] as usize]);
            this.shape.keys.push(g as u32);
            this.stiffness.push(group.stiffness);
            this.deformable.push(group.deformable);
            this.motor.push(group.motor);
            this.scale.push(group.scale);
        }
        (this.shape.rows, this.shape.members) = (rows.into(), members.into());
        this.open = vec![0.0; groups.len()];
        this.bodies = vec![RigidBody::default(); groups.len()];
        this.held = vec![Held::default(); this.shape.members.len()];
        let mut rest = vec![Vec3A::ZERO; this.shape.members.len()];
        for g in 0..groups.len() {
            let made = this.made_offsets(g, particles);
            let start = this.shape.rows[g] as usize;
            rest[start..start + made.len()].copy_from_slice(&made);
            this.bodies[g].start_from(this.shape.rotation[g].as_dquat());
        }
        this.shape.rest = rest.into();
        let largest = groups.iter().map(|g| g.members.len()).max().unwrap_or(0);
        this.shape.ways = vec![Vec3A::ZERO; largest];
        this.landings.reserve(largest);
        this.shape.unoriented = this.membership.iter().map(|m| m.groups > 1).collect();
        this.shape.moment =
            (0..n).map(|i| if this.shape.unoriented[i] { glam::Mat3A::ZERO } else { second_moment(particles, i) }).collect();
        Ok(this)
    }

    /// Number of groups.
    #[inline]
    pub fn len(&self) -> usize {
        self.stiffness.len()
    }

    /// Whether there are none.
    #[inline]
    pub fn is_empty(&self) -> bool {
        self.stiffness.is_empty()
    }

    /// The members of group `g`; none if there is no such group.
    pub fn members(&self, g: usize) -> &[u32] {
        if g < self.len() { &self.shape.members[self.row(g)] } else { &[] }
    }

    /// Whether group `g` is open; false if there is no such group.
    pub fn is_open(&self, g: usize) -> bool {
        self.open.get(g).is_some_and(|&t| t > 0.0)
    }

    /// How group `g` is turned since rest, as found last; `None` if there is no such group.
    pub fn rotation(&self, g: usize) -> Option<Quat> {
        self.shape.rotation.get(g).copied()
    }

    /// Changes whenever a group opens, closes, softens or stiffens: then [`ImplicitGroups::rest_where_held`] and [`Edges::rest_where_held`](crate::Edges::rest_where_held) are due.
    pub fn revision(&self) -> u32 {
        self.revision
    }

    /// Makes these groups the ones that `groups` describes, and tells whether they had to be made anew: while members and which of them can open stay the same, only numbers change, and what is open, dented
    /// and turning goes on. Made anew they are closed and in the shape they have at rest.
    ///
    /// # Errors
    ///
    /// As [`new`](Self::new); the groups are then only partly changed and not to be used any more.
    pub fn update(&mut self, particles: &Particles, groups: &[ExplicitGroup]) -> Result<bool, GroupError> {
        let same = self.len() == groups.len()
            && self.membership.len() == particles.len()
            && groups
                .iter()
                .enumerate()
                .all(|(g, group)| self.members(g) == group.members && self.deformable[g].is_some() == group.deformable.is_some());
        if !same {
            *self = Self::new(particles, groups)?;
            return Ok(true);
        }
        for (g, group) in groups.iter().enumerate() {
            self.set_motor(g, group.motor)?;
            self.set_stiffness(g, group.stiffness)?;
            if group.scale != self.scale[g] {
                self.set_scale(g, group.scale)?;
            }
            if let Some(d) = group.deformable {
                check_deformable(g, d)?;
                self.deformable[g] = Some(d);
            }
        }
        Ok(false)
    }

    /// Drives group `g` by another motor, or by none. The new one starts with the next substep.
    ///
    /// # Errors
    ///
    /// If there is no such group or the motor is out of its range.
    pub fn set_motor(&mut self, g: usize, motor: Option<Motor>) -> Result<(), GroupError> {
        self.check_group(g)?;
        if let Some(motor) = motor {
            motor.check(g, self.len())?;
        }
        self.motor[g] = motor;
        Ok(())
    }

    /// Gives group `g` another stiffness.
    ///
    /// # Errors
    ///
    /// If there is no such group.
    pub fn set_stiffness(&mut self, g: usize, stiffness: Stiffness) -> Result<(), GroupError> {
        self.check_group(g)?;
        self.stiffness[g] = stiffness;
        Ok(())
    }

    /// Inflates or shrinks group `g` to `scale` times the size it was made in. It takes the new size in the next substep; spin is kept, so it turns slower when it grows.
    ///
    /// # Errors
    ///
    /// If there is no such group or the scale is not positive and finite.
    pub fn set_scale(&mut self, g: usize, scale: f32) -> Result<(), GroupError> {
        self.check_group(g)?;
        check_scale(g, scale)?;
        let ratio = scale / self.scale[g];
        if !ratio.is_normal() {
            return Err(GroupError::Range { group: g, what: "the rest scale", value: scale, range: "too far from the last one" });
        }
        self.scale[g] = scale;
        let row = self.row(g);
        for r in &mut Arc::make_mut(&mut self.shape.rest)[row] {
            *r *= ratio;
        }
        // Which shared particles make the joints follows from where they rest now, not from when it was asked last.
        let Self { joints, bodies, shape, held, .. } = self;
        joints.build(bodies, shape, |k| held[k].pinned);
        Ok(())
    }

    /// Tells the groups that `particle` was hit at the closing speed `speed` \[m/s\]: those that are deformable open if it was fast enough. A particle that does not exist is nobody's.
    pub fn strike(&mut self, particle: u32, speed: f32) {
        if self.deformable.iter().all(Option::is_none) {
            return;
        }
        for g in 0..self.len() {
            let Some(d) = self.deformable[g] else { continue };
            if speed > d.speed && self.members(g).contains(&particle) {
                let was_open = self.is_open(g);
                self.open[g] = d.time;
                if !was_open {
                    self.count_closed(g, -1);
                }
            }
        }
    }

    /// Opens the deformable groups that `contacts` strike fast enough. To be called just before the contacts are solved in a substep of `dt` \[s\], while the velocities still tell the blow.
    pub fn strike_all(&mut self, particles: &Particles, contacts: &Contacts, dt: f32) {
        if self.deformable.iter().all(Option::is_none) {
            return;
        }
        for contact in &contacts.list {
            let i = contact.particle as usize;
            if i >= particles.len() {
                continue;
            }
            let n = contact.normal;
            let (h, reach) = particles.ellipsoid(i).support(-n);
            let gap = n.dot(particles.position[i] - contact.point - contact.velocity * dt) - h;
            let velocity = particles.velocity[i] + particles.angular_velocity[i].cross(reach) - contact.velocity;
            if gap < 0.0 {
                self.strike(contact.particle, -n.dot(velocity));
            }
        }
    }

    /// Lets the open groups' time pass, and closes those whose time is over.
    pub(crate) fn pass_time(&mut self, particles: &Particles, dt: f32) {
        for g in 0..self.len() {
            if self.open[g] > 0.0 {
                self.open[g] -= dt;
                if self.open[g] <= 0.0 {
                    self.open[g] = 0.0;
                    self.count_closed(g, 1);
                    self.keep_dent(g, particles);
                }
            }
        }
    }

    /// Whether group `g` acts as a rigid body in a substep of `dt` \[s\].
    pub(crate) fn is_rigid(&self, g: usize, dt: f32) -> bool {
        let share = self.stiffness[g].share(dt);
        self.open[g] <= 0.0 && share.stiffness >= 1.0 && share.damping <= 0.0
    }

    /// Whether particle `i` may have an implicit group.
    pub(crate) fn leaves_group_to(&self, i: usize) -> bool {
        self.membership.get(i).is_none_or(|m| m.groups == 0 || !m.rigid_for_good)
    }

    /// Whether a closed group has particle `i`, soft or rigid.
    pub(crate) fn holds(&self, i: usize) -> bool {
        self.membership.get(i).is_some_and(|m| m.closed > 0)
    }

    #[inline]
    pub(crate) fn row(&self, g: usize) -> core::ops::Range<usize> {
        self.shape.rows[g] as usize..self.shape.rows[g + 1] as usize
    }

    /// Where the members of group `g` were made, about their centre of mass, at its scale \[m\].
    pub(crate) fn made_offsets(&self, g: usize, particles: &Particles) -> Vec<Vec3A> {
        let members = &self.shape.members[self.row(g)];
        let (mut center, mut mass) = (Vec3A::ZERO, 0.0);
        for &i in members {
            center += particles.rest_position[i as usize] * particles.mass[i as usize];
            mass += particles.mass[i as usize];
        }
        members.iter().map(|&i| (particles.rest_position[i as usize] - center / mass) * self.scale[g]).collect()
    }

    pub(crate) fn count_closed(&mut self, g: usize, by: i32) {
        for k in self.row(g) {
            let closed = &mut self.membership[self.shape.members[k] as usize].closed;
            *closed = closed.saturating_add_signed(by);
        }
        self.revision = self.revision.wrapping_add(1);
    }

    fn check_group(&self, group: usize) -> Result<(), GroupError> {
        if group < self.len() { Ok(()) } else { Err(GroupError::NoGroup { group, count: self.len() }) }
    }
}

fn check_scale(group: usize, scale: f32) -> Result<(), GroupError> {
    let fine = scale > 0.0 && scale.is_normal() && (1.0 / scale).is_normal();
    if fine { Ok(()) } else { Err(GroupError::Range { group, what: "the rest scale", value: scale, range: "not positive and normal" }) }
}

fn check_deformable(group: usize, d: Deformable) -> Result<(), GroupError> {
    let bad = |what, value, range| Err(GroupError::Range { group, what, value, range });
    if d.speed.is_nan() || d.speed < 0.0 {
        return bad("the opening speed", d.speed, "not 0 or more");
    }
    if !(d.time > 0.0 && d.time.is_finite()) {
        return bad("the opening time", d.time, "not positive and finite");
    }
    if !(0.0..=1.0).contains(&d.dent) {
        return bad("the dent", d.dent, "not in 0 … 1");
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Drive;
    use crate::testing::line;

    #[test]
    fn bad_groups_are_named() {
        let p = line(4, 1.0, 0.1);
        let error = |groups: &[ExplicitGroup]| ExplicitGroups::new(&p, groups).unwrap_err().to_string();
        let good = ExplicitGroup::rigid([0, 1]);
        assert_eq!(error(&[good.clone(), ExplicitGroup::rigid([])]), "group 1 has no members");
        assert_eq!(error(&[ExplicitGroup::rigid([3, 4])]), "group 0: particle 4 is not among the 4 there are");
        assert_eq!(error(&[ExplicitGroup::rigid([3, 1, 3])]), "group 0: particle 3 is named twice");
        assert_eq!(error(&[ExplicitGroup { scale: -1.0, ..good.clone() }]), "group 0: the rest scale is -1, not positive and normal");
        let motor = |against, torque| ExplicitGroup {
            motor: Some(Motor { axis: Vec3A::X, drive: Drive::Torque(torque), against }),
            ..good.clone()
        };
        assert_eq!(error(&[motor(Some(0), 1.0)]), "group 0: its motor acts against itself");
        assert_eq!(error(&[motor(Some(1), 1.0)]), "group 1 is not among the 1 there are");
        assert_eq!(error(&[motor(None, f32::NAN)]), "group 0: its motor's torque is NaN, not finite");
        let dent = |dent| ExplicitGroup { deformable: Some(Deformable { speed: 1.0, time: 1.0, dent }), ..good.clone() };
        assert_eq!(error(&[dent(2.0)]), "group 0: the dent is 2, not in 0 … 1");
        let mut groups = ExplicitGroups::new(&p, &[good]).unwrap();
        assert_eq!(groups.set_scale(1, 1.0), Err(GroupError::NoGroup { group: 1, count: 1 }));
        assert!(groups.members(7).is_empty() && !groups.is_open(7));
        groups.strike(99, 1e9);
    }
}
