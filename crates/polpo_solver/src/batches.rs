//! Groups eight at a time, laid out as the vector kernel reads them.

use core::ops::Range;
use std::sync::Arc;

use glam::{Mat3A, Vec3A};

use crate::lanes::{LANES, Lane};

/// Batches of up to [`LANES`] groups that share no particle, one group a lane, longest first.
///
/// Batch b consists of the groups `groups(b)` and of the slots `batch(b)`: slot k holds the k-th member of each. Where a lane's group is shorter than the longest, or there are fewer than eight groups, the slot is
/// padded with a particle of the batch, without mass and moment.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Batches {
    /// Where each batch's groups start, and the end of the last.
    groups: Vec<u32>,
    /// Where each batch's slots start, and the end of the last.
    starts: Vec<u32>,
    slots: Vec<Slot>,
    /// Per slot, bit l: lane l's group has such a member.
    live: Vec<u8>,
    /// The masses that the slots were filled from.
    mass: Vec<f32>,
}

/// One member of each lane's group.
#[derive(Clone, Debug, Default, PartialEq)]
#[repr(align(32))]
pub(crate) struct Slot {
    /// Which particle.
    pub(crate) particle: [u32; LANES],
    /// Its mass \[kg\].
    pub(crate) mass: Lane,
    /// Its place at rest, as in [`ImplicitGroups::rest`](crate::ImplicitGroups::rest) \[m\].
    pub(crate) rest: [Lane; 3],
    /// Its second moment, xx, yy, zz, xy, xz, yz \[kg·m²\].
    pub(crate) moment: [Lane; 6],
}

impl Batches {
    /// Lays out groups with these `members`, whose batches start at `groups` and have at most eight of them, longest first. Without rest places and masses yet.
    pub(crate) fn new(groups: Vec<u32>, rows: &[u32], members: &[u32], moment: &[Mat3A]) -> Self {
        let mut this = Self { groups, starts: vec![0], ..Self::default() };
        for b in 0..this.len() {
            let row = |g: usize| &members[rows[g] as usize..rows[g + 1] as usize];
            let batch = this.groups(b);
            let start = this.slots.len();
            let length = row(batch.start).len();
            this.slots.resize(start + length, Slot { particle: [row(batch.start)[0]; LANES], ..Slot::default() });
            this.live.resize(start + length, 0);
            for (l, g) in batch.enumerate() {
                for k in 0..length {
                    let slot = &mut this.slots[start + k];
                    slot.particle[l] = row(g)[0];
                    if let Some(&i) = row(g).get(k) {
                        slot.particle[l] = i;
                        this.live[start + k] |= 1 << l;
                        let m = &moment[i as usize];
                        let m = [m.x_axis.x, m.y_axis.y, m.z_axis.z, m.x_axis.y, m.x_axis.z, m.y_axis.z];
                        for (to, m) in slot.moment.iter_mut().zip(m) {
                            to[l] = m;
                        }
                    }
                }
            }
            this.starts.push(this.slots.len() as u32);
        }
        this
    }

    /// How many batches there are.
    pub(crate) fn len(&self) -> usize {
        self.groups.len().saturating_sub(1)
    }

    /// The groups of batch `b`, one a lane.
    #[inline]
    pub(crate) fn groups(&self, b: usize) -> Range<usize> {
        self.groups[b] as usize..self.groups[b + 1] as usize
    }

    /// The slots of batch `b`, and which lanes have a member in each.
    #[inline]
    pub(crate) fn batch(&self, b: usize) -> (&[Slot], &[u8]) {
        let slots = self.starts[b] as usize..self.starts[b + 1] as usize;
        (&self.slots[slots.clone()], &self.live[slots])
    }

    /// As many slots as the longest batch has.
    pub(crate) fn longest(&self) -> usize {
        self.starts.windows(2).map(|s| (s[1] - s[0]) as usize).max().unwrap_or(0)
    }

    /// Takes over the rest places of all members, which are stored row after row, if they are not those that it has.
    pub(crate) fn rest(shared: &mut Arc<Self>, rows: &[u32], rest: &[Vec3A]) {
        let known = |b: usize, l: usize, g: usize| {
            rest[rows[g] as usize..rows[g + 1] as usize].iter().enumerate().all(|(k, r)| {
                let slot = &shared.slots[shared.starts[b] as usize + k];
                slot.rest.iter().zip(r.to_array()).all(|(has, r)| has[l] == r)
            })
        };
        if (0..shared.len()).all(|b| shared.groups(b).enumerate().all(|(l, g)| known(b, l, g))) {
            return;
        }
        let this = Arc::make_mut(shared);
        for b in 0..this.len() {
            for (l, g) in this.groups(b).enumerate() {
                for (k, r) in rest[rows[g] as usize..rows[g + 1] as usize].iter().enumerate() {
                    let slot = &mut this.slots[this.starts[b] as usize + k];
                    for (to, r) in slot.rest.iter_mut().zip(r.to_array()) {
                        to[l] = r;
                    }
                }
            }
        }
    }

    /// Takes over the particles' masses, if they are not those that it has.
    pub(crate) fn masses(shared: &mut Arc<Self>, rows: &[u32], mass: &[f32]) {
        if shared.mass == mass {
            return;
        }
        let this = Arc::make_mut(shared);
        this.mass.clear();
        this.mass.extend_from_slice(mass);
        for b in 0..this.len() {
            for (l, g) in this.groups(b).enumerate() {
                for k in 0..(rows[g + 1] - rows[g]) as usize {
                    let slot = &mut this.slots[this.starts[b] as usize + k];
                    slot.mass[l] = mass[slot.particle[l] as usize];
                }
            }
        }
    }
}
