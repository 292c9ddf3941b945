//! Motors: a torque about an axis of one explicit group, and its counter-torque on another.

use glam::Vec3A;

use crate::rigid_groups::{RigidBody, read};
use crate::soft_groups::{read_soft, turn_soft};
use crate::{ExplicitGroups, GroupError, Particles};

/// A motor that turns its group about an axis fixed in the group.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motor {
    /// The axis in the group's axes at rest; any length but zero.
    pub axis: Vec3A,
    /// What it does about the axis.
    pub drive: Drive,
    /// The group that takes the counter-torque; `None`: the world does.
    pub against: Option<u32>,
}

/// What a motor does.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Drive {
    /// A torque \[N·m\], finite; negative the other way round.
    Torque(f32),
    /// Reaches for a speed and holds it.
    Speed {
        /// Angular velocity about the axis, relative to the group that it acts against \[rad/s\], finite.
        target: f32,
        /// No more torque than this either way \[N·m\], 0 … infinity. Too little, and the target is never reached under load.
        max_torque: f32,
    },
}

impl Motor {
    /// The angular impulse about the axis in a substep of `dt` \[s\] \[N·m·s\], where the group turns at `speed` \[rad/s\] against the other and 1 N·m·s changes that by `mobility` \[rad/s\].
    ///
    /// The impulse that would reach the target at once if nothing else held the two groups, limited by the torque. Whatever holds them (a joint off the axis) only makes them heavier, so the target is
    /// never overshot.
    pub(crate) fn impulse(&self, speed: f64, mobility: f64, dt: f64) -> f64 {
        match self.drive {
            Drive::Torque(torque) => f64::from(torque) * dt,
            Drive::Speed { target, max_torque } => {
                let limit = f64::from(max_torque) * dt;
                let wanted = (f64::from(target) - speed) / mobility;
                if wanted.is_finite() { wanted.clamp(-limit, limit) } else { 0.0 }
            }
        }
    }

    pub(crate) fn check(&self, group: usize, count: usize) -> Result<(), GroupError> {
        let bad = |what, value, range| Err(GroupError::Range { group, what, value, range });
        let length = self.axis.length();
        if !(length > 0.0 && length.is_finite()) {
            return bad("the length of its motor's axis", length, "not positive and finite");
        }
        match self.drive {
            Drive::Torque(torque) if !torque.is_finite() => return bad("its motor's torque", torque, "not finite"),
            Drive::Speed { target, .. } if !target.is_finite() => return bad("its motor's target speed", target, "not finite"),
            Drive::Speed { max_torque, .. } if max_torque.is_nan() || max_torque < 0.0 => {
                return bad("its motor's greatest torque", max_torque, "not 0 or more");
            }
            _ => {}
        }
        match self.against {
            Some(other) if other as usize == group => Err(GroupError::Against { group }),
            Some(other) if other as usize >= count => Err(GroupError::NoGroup { group: other as usize, count }),
            _ => Ok(()),
        }
    }
}

/// Lets the motors turn: the angular impulse on their group and the opposite on the one they act against, at the start of the substep.
pub(crate) fn drive(groups: &mut ExplicitGroups, particles: &mut Particles, dt: f64) {
    groups.driven.clear();
    for g in 0..groups.len() {
        let Some(motor) = groups.motor[g] else { continue };
        let other = motor.against.map(|o| o as usize);
        if groups.is_open(g) || other.is_some_and(|o| groups.is_open(o)) {
            continue;
        }
        // A soft group is read like a rigid one, and given its impulse back at once.
        for soft in [Some(g), other].into_iter().flatten() {
            if !groups.bodies[soft].acting {
                read_soft(groups, particles, soft);
            }
        }
        let body = &groups.bodies[g];
        let axis = body.start.rotation * motor.axis.as_dvec3().normalize();
        let turn = |b: &RigidBody| (axis.dot(b.spin_at(b.start.rotation)), axis.dot(b.mobility(b.start.rotation) * axis));
        let (mut speed, mut mobility) = turn(body);
        if let Some(o) = other {
            let (s, m) = turn(&groups.bodies[o]);
            speed -= s;
            mobility += m;
        }
        groups.driven.push((g as u32, axis * motor.impulse(speed, mobility, dt)));
        if let Some(o) = motor.against {
            groups.driven.push((o, -axis * motor.impulse(speed, mobility, dt)));
        }
    }
    let mut soft = false;
    for k in 0..groups.driven.len() {
        let (g, impulse) = groups.driven[k];
        if !groups.bodies[g as usize].acting {
            turn_soft(groups, particles, g as usize, impulse, dt);
            soft = true;
        }
    }
    // Rigid groups that share members with soft ones carry what those got.
    for g in 0..groups.len() {
        if soft && groups.bodies[g].acting {
            read(groups, particles, g, true);
        }
    }
    for &(g, impulse) in &groups.driven {
        if groups.bodies[g as usize].acting {
            groups.bodies[g as usize].angular += impulse;
        }
    }
}
