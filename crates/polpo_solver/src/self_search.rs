//! Which particles of one body may touch each other in a step.

use std::sync::Arc;

use glam::Vec3A;

use crate::pairs::{MOST, key, mean_velocity, meet_in_step, swept};
use crate::rest_pairs::{RestPairs, fill_rows};
use crate::{Bounds, PairFinder, PairSearch, Pairs, Particles, TooDense};

/// The search for the pairs of one body with itself.
///
/// Particles whose boxes meet, grown by a margin, are *near* each other, unless they never count as touching. Who is near is searched for only when a box has left the grown one that it had then, which in a body that lies still or flies on happens
/// every few seconds or never, and only for that particle unless there are many; in between, a step looks at those near alone. What it finds does not depend on when they were searched for.
///
/// Never counted as touching are those joined by an edge, those that overlap at rest or all but do, and those that have a neighbour in common and are nearer at rest than the smaller one's radius.
/// What is joined that closely is held apart by the body's stiffness; a contact on top would only quarrel with it.
#[derive(Clone, Debug, Default)]
pub struct SelfSearch {
    /// Shared by clones.
    resting: Arc<RestPairs>,
    /// The particles' boxes when those near were searched for, grown.
    around: Vec<Bounds>,
    /// Those near particle i with higher indices, sorted, are `near[rows[i]..rows[i + 1]]`.
    rows: Vec<u32>,
    near: Vec<u32>,
}

/// Boxes are grown by this share of their particle's radius: the less, the sooner they are left; the more, the more are near.
const MARGIN: f32 = 0.25;

/// Room from the start for so many near each particle, and for so many pairs a particle: what a body has that lies on itself. In a knot the lists grow.
const ROOM: usize = 8;
const PAIRS: usize = 2;

/// While not more than one particle in so many has left its box, only those near these are searched for anew.
const FEW: usize = 16;

impl SelfSearch {
    /// For a body of `particles` with the edges `edges`; an edge to a particle that does not exist is ignored. A clone serves another body with the same particles at rest and the same edges.
    ///
    /// # Errors
    ///
    /// If more than 256 pairs a particle (and more than half a million) overlap at rest.
    pub fn new(particles: &Particles, edges: &[[u32; 2]]) -> Result<Self, TooDense> {
        Ok(Self { resting: RestPairs::new(particles, edges)?.into(), ..Self::default() })
    }

    /// Fills `pairs` for a step. `finder` is scratch memory only.
    pub fn find(&mut self, p: &Particles, search: &PairSearch, finder: &mut PairFinder, pairs: &mut Pairs) {
        let frame = mean_velocity(p);
        let swept = |i| swept(p, i, Vec3A::ZERO, frame, search);
        let most = MOST * p.len();
        let grown = |i| swept(i).grown(MARGIN * p.radii[i].max_element());
        finder.owners.clear();
        finder.owners.extend((0u32..).zip(&self.around).filter(|(i, around)| !around.holds(&swept(*i as usize))).map(|(i, _)| i));
        if self.around.len() != p.len() || FEW * finder.owners.len() > p.len() {
            pairs.reserve(PAIRS * p.len());
            self.around.clear();
            self.around.reserve_exact(p.len());
            self.around.extend((0..p.len()).map(grown));
            self.look_around(most, finder, |_, _| true);
        } else if !finder.owners.is_empty() {
            for &i in &finder.owners {
                self.around[i as usize] = grown(i as usize);
            }
            self.look_after(finder);
        }
        let meet = |i: u32, j: u32| meet_in_step(p, i as usize, p, j as usize, Vec3A::ZERO, search);
        if self.near.len() >= most {
            // A body that has collapsed: it is searched anew in every step, for what meets in it.
            self.look_around(most, finder, meet);
            self.around.clear();
        }
        let near = (0u32..)
            .zip(self.rows.windows(2))
            .flat_map(|(i, row)| self.near[row[0] as usize..row[1] as usize].iter().map(move |&j| (i, j)));
        pairs.refill(near.filter(|&(i, j)| meet(i, j)).map(|(i, j)| key(i, j)), p, p, Vec3A::ZERO);
        pairs.way_out = None;
    }

    /// Searches for those near that `count`, up to so many.
    fn look_around(&mut self, most: usize, finder: &mut PairFinder, count: impl Fn(u32, u32) -> bool) {
        let PairFinder { broad, keys, .. } = finder;
        keys.clear();
        keys.reserve(ROOM * self.around.len());
        broad.pairs(&self.around, |i, j| {
            if !self.resting.contains(i, j) && count(i, j) {
                keys.push(key(i, j));
            }
            keys.len() < most
        });
        keys.sort_unstable();
        self.keep(keys);
    }

    /// Searches anew for those near the particles that `finder.owners` lists, whose boxes are others now.
    fn look_after(&mut self, finder: &mut PairFinder) {
        let PairFinder { owners: left, keys, .. } = finder;
        keys.clear();
        let has_left = |i: u32| left.binary_search(&i).is_ok();
        for (i, row) in (0u32..).zip(self.rows.windows(2)).filter(|(i, _)| !has_left(*i)) {
            let near = self.near[row[0] as usize..row[1] as usize].iter();
            keys.extend(near.filter(|j| !has_left(**j)).map(|&j| key(i, j)));
        }
        for &i in &*left {
            let around = self.around[i as usize];
            for (j, _) in (0u32..).zip(&self.around).filter(|(_, other)| around.meets(other)) {
                // Of two that have both left, the later one finds the other.
                let twice = i == j || (j > i && has_left(j));
                if !twice && !self.resting.contains(i.min(j), i.max(j)) {
                    keys.push(key(i.min(j), i.max(j)));
                }
            }
        }
        keys.sort_unstable();
        self.keep(keys);
    }

    fn keep(&mut self, keys: &[u64]) {
        self.near.clear();
        self.near.reserve(ROOM * self.around.len());
        fill_rows(self.around.len(), keys, &mut self.rows, &mut self.near);
    }
}
