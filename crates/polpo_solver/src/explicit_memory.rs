//! What explicit groups carry over from substep to substep, in a form that can be kept and put back.

use std::sync::Arc;

use glam::{DQuat, DVec3, Vec3A};

use crate::rigid_groups::share_out;
use crate::{ExplicitGroups, Particles};

/// What a group has come to, beside its particles.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GroupMemory {
    /// How it is turned since rest, as found last: where the next search starts.
    pub rotation: DQuat,
    /// Whether it acted as a rigid body in the last substep.
    pub acting: bool,
    /// How long it stays open \[s\]; 0 for a closed one.
    pub open: f32,
    /// What of its spin the particles could not hold \[rad/s\].
    pub lost_spin: DVec3,
    /// Where its members rest about its centre of mass \[m\]; empty: where they were made.
    pub rest: Vec<Vec3A>,
    /// What of the group's motion each of its members could not hold, in place \[m\] and velocity \[m/s\]: rounding, and at joints half of what the two groups differ. Empty unless it acted.
    pub lost: Vec<[Vec3A; 2]>,
}

impl ExplicitGroups {
    /// What the groups, between two steps, remember besides how they were made: given to groups made alike, together with the particles, the steps that follow are the same to the bit.
    pub fn memory(&self, particles: &Particles) -> Vec<GroupMemory> {
        (0..self.len())
            .map(|g| {
                let (row, body) = (self.row(g), &self.bodies[g]);
                let rest = &self.shape.rest[row.clone()];
                let lost = &self.held[if body.acting { row.clone() } else { 0..0 }];
                GroupMemory {
                    rotation: if body.acting { body.end.rotation } else { self.shape.rotation[g].as_dquat() },
                    acting: body.acting,
                    open: self.open[g],
                    lost_spin: body.lost_spin,
                    rest: if self.made_offsets(g, particles) == rest { Vec::new() } else { rest.to_vec() },
                    lost: lost.iter().map(|h| [h.lost_position, h.lost_velocity]).collect(),
                }
            })
            .collect()
    }

    /// Whether `memory` can be that of these groups: one a group, lists as long as there are members, numbers finite, rotations near unit length, nothing open that does not open.
    pub fn can_recall(&self, memory: &[GroupMemory]) -> bool {
        memory.len() == self.len()
            && memory.iter().enumerate().all(|(g, m)| {
                let count = self.members(g).len();
                (0.25..=4.0).contains(&m.rotation.length_squared())
                    && m.open >= 0.0
                    && m.open.is_finite()
                    && (m.open == 0.0 || self.deformable[g].is_some())
                    && m.lost_spin.is_finite()
                    && (m.rest.is_empty() || m.rest.len() == count)
                    && m.rest.iter().all(|r| r.is_finite())
                    && m.lost.len() == if m.acting { count } else { 0 }
                    && m.lost.iter().flatten().all(|l| l.is_finite())
            })
    }

    /// Makes these groups, newly made for `particles`, what they were when [`memory`](Self::memory) was asked for. What they [cannot recall](Self::can_recall) changes nothing.
    pub fn recall(&mut self, particles: &Particles, memory: &[GroupMemory]) {
        if !self.can_recall(memory) {
            return;
        }
        for (g, m) in memory.iter().enumerate() {
            self.bodies[g].start_from(m.rotation);
            self.bodies[g].acting = m.acting;
            self.shape.rotation[g] = m.rotation.as_quat();
            if m.open > 0.0 {
                self.open[g] = m.open;
                self.count_closed(g, -1);
            }
            if !m.rest.is_empty() {
                let row = self.row(g);
                Arc::make_mut(&mut self.shape.rest)[row].copy_from_slice(&m.rest);
            }
        }
        share_out(self, particles);
        for (g, m) in memory.iter().enumerate() {
            let row = self.row(g);
            self.bodies[g].lost_spin = m.lost_spin;
            for (held, &[position, velocity]) in self.held[row].iter_mut().zip(&m.lost) {
                (held.lost_position, held.lost_velocity) = (position, velocity);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{blob, scramble};
    use crate::{
        Deformable, ExplicitGroup, Stiffness, Sweep, hold_explicit_groups, integrate, match_explicit_groups, predict, predict_explicit,
    };

    const DT: f32 = 1.0 / 300.0;

    fn list() -> Vec<ExplicitGroup> {
        let deformable = Some(Deformable { speed: 0.1, time: 5.5 * DT, dent: 0.5 });
        vec![
            ExplicitGroup::rigid([0, 1, 2, 3]),
            // Two joints with the first.
            ExplicitGroup { scale: 1.1, ..ExplicitGroup::rigid([2, 3, 4, 5]) },
            ExplicitGroup { deformable, ..ExplicitGroup::rigid([6, 7, 8]) },
            ExplicitGroup { stiffness: Stiffness::hertz(30.0), ..ExplicitGroup::rigid([8, 9]) },
        ]
    }

    fn step(groups: &mut ExplicitGroups, p: &mut Particles) {
        predict(p, Vec3A::NEG_Y, DT);
        predict_explicit(groups, p, DT);
        match_explicit_groups(groups, p, Sweep::only(DT));
        p.velocity[5] += Vec3A::X * 0.01;
        hold_explicit_groups(groups, p, DT);
        integrate(p, DT, 0.0);
    }

    #[test]
    fn groups_go_on_from_their_memory_to_the_bit() {
        let (mut p, _) = blob();
        scramble(&mut p, 8);
        let mut groups = ExplicitGroups::new(&p, &list()).unwrap();
        let mut dented = false;
        for k in 0..40 {
            step(&mut groups, &mut p);
            // Opened again and again, and caught in every state.
            if k % 9 == 4 {
                groups.strike(7, 1.0);
            }
            let memory = groups.memory(&p);
            dented |= !memory[2].rest.is_empty() && memory[2].open == 0.0;
            let (mut q, mut again) = (p.clone(), ExplicitGroups::new(&p, &list()).unwrap());
            again.recall(&p, &memory);
            assert_eq!(again.memory(&p), memory, "{k}");
            assert!((0..p.len()).all(|i| again.holds(i) == groups.holds(i)), "{k}");
            let (mut r, mut goes_on) = (p.clone(), groups.clone());
            for _ in 0..12 {
                step(&mut again, &mut q);
                step(&mut goes_on, &mut r);
                assert!(q == r, "{k}");
            }
        }
        assert!(dented);
    }

    #[test]
    fn what_is_no_memory_of_theirs_changes_nothing() {
        let (mut p, _) = blob();
        scramble(&mut p, 8);
        let mut groups = ExplicitGroups::new(&p, &list()).unwrap();
        step(&mut groups, &mut p);
        let good = groups.memory(&p);
        let before = ExplicitGroups::new(&p, &list()).unwrap();
        let spoil: [fn(&mut Vec<GroupMemory>); 9] = [
            |m| m.truncate(3),
            |m| m[0].rotation.w = f64::NAN,
            |m| m[0].rotation = DQuat::from_xyzw(0.0, 0.0, 0.0, 0.1),
            |m| m[0].open = 1.0,
            |m| m[2].open = f32::INFINITY,
            |m| m[1].lost_spin.x = f64::INFINITY,
            |m| m[1].rest = vec![Vec3A::ZERO; 3],
            |m| m[1].lost.truncate(1),
            |m| m[3].lost = vec![[Vec3A::ZERO; 2]; 2],
        ];
        for (k, spoil) in spoil.into_iter().enumerate() {
            let mut bad = good.clone();
            spoil(&mut bad);
            let mut groups = before.clone();
            groups.recall(&p, &bad);
            assert!(!groups.can_recall(&bad) && groups == before, "{k}");
        }
    }
}
