//! Distances along the body: a flood over the voxel links, Dijkstra's algorithm with a bucket a distance (Dial 1969).

use crate::voxels::{STEPS, Voxels};

/// Weights of voxels are in 1/16: a step counts by the mean of those at its ends.
pub(crate) const UNIT: u32 = 16;
pub(crate) const HEAVIEST: u32 = 8 * UNIT;
/// The weight of a voxel that no step leads to.
pub(crate) const BLOCKED: u32 = u32::MAX;

/// One more than the longest step: the pending distances are never further apart, so the buckets can be used in turn.
const BUCKETS: u32 = STEPS[2] * HEAVIEST / UNIT + 1;

/// The flood's front: items by distance.
pub(crate) struct Front<T> {
    buckets: Vec<Vec<T>>,
    at: u32,
    pending: usize,
}

impl<T> Front<T> {
    pub(crate) fn new() -> Front<T> {
        Front { buckets: (0..BUCKETS).map(|_| Vec::new()).collect(), at: 0, pending: 0 }
    }

    /// Adds an item at a distance not below the last one popped, and not a longest step above.
    pub(crate) fn push(&mut self, distance: u32, item: T) {
        self.buckets[(distance % BUCKETS) as usize].push(item);
        self.pending += 1;
    }

    /// The nearest item and its distance; items as far apart come last in, first out.
    pub(crate) fn pop(&mut self) -> Option<(u32, T)> {
        if self.pending == 0 {
            self.at = 0;
            return None;
        }
        loop {
            if let Some(item) = self.buckets[(self.at % BUCKETS) as usize].pop() {
                self.pending -= 1;
                return Some((self.at, item));
            }
            self.at += 1;
        }
    }
}

/// The nearest of a set of seeds for every voxel, and how far it is along the body (in [`STEPS`], weighted).
pub(crate) struct Cells {
    pub(crate) owner: Vec<u32>,
    pub(crate) distance: Vec<u32>,
    front: Front<u32>,
}

impl Cells {
    /// No seeds yet: everything is infinitely far.
    pub(crate) fn new(voxels: &Voxels) -> Cells {
        Cells { owner: vec![u32::MAX; voxels.len()], distance: vec![u32::MAX; voxels.len()], front: Front::new() }
    }

    /// Adds seeds, numbered from `number`, and gives them what is nearer to them than to the ones before.
    pub(crate) fn flood(&mut self, voxels: &Voxels, weights: &[u32], seeds: &[u32], number: u32) {
        for (owner, &seed) in (number..).zip(seeds) {
            self.distance[seed as usize] = 0;
            self.owner[seed as usize] = owner;
            self.front.push(0, seed);
        }
        self.grow(voxels, weights);
    }

    /// Gives what nobody owns, but can be reached, to the nearest owner.
    pub(crate) fn fill(&mut self, voxels: &Voxels) {
        for voxel in (0..voxels.len() as u32).filter(|&v| self.owner[v as usize] != u32::MAX) {
            self.distance[voxel as usize] = 0;
            self.front.push(0, voxel);
        }
        self.grow(voxels, &vec![UNIT; voxels.len()]);
    }

    fn grow(&mut self, voxels: &Voxels, weights: &[u32]) {
        while let Some((distance, voxel)) = self.front.pop() {
            if self.distance[voxel as usize] < distance {
                continue;
            }
            let owner = self.owner[voxel as usize];
            for (next, step) in voxels.neighbours(voxel) {
                if weights[next as usize] == BLOCKED {
                    continue;
                }
                let weight = weights[voxel as usize] + weights[next as usize];
                let there = distance + step * weight / (2 * UNIT);
                if there < self.distance[next as usize] {
                    self.distance[next as usize] = there;
                    self.owner[next as usize] = owner;
                    self.front.push(there, next);
                }
            }
        }
    }
}
