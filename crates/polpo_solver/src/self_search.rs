//! Which particles of one body may touch each other in a step.

use glam::Vec3A;

use crate::pairs::{MOST, key, mean_velocity, meet_in_step, swept};
use crate::rest_pairs::RestPairs;
use crate::{Bounds, BroadPhase, PairSearch, Pairs, Particles, TooDense};

/// The search for the pairs of one body with itself.
///
/// Particles whose boxes meet, grown by a margin, are *near* each other, unless they never count as touching. Who is near is searched for only when a box has left the grown one that it had then, which in a body that lies still or flies on happens
/// every few seconds or never; in between, a step looks at those near alone. What it finds does not depend on when they were searched for.
///
/// Never counted as touching are those joined by an edge, those that overlap at rest or all but do, and those that have a neighbour in common and are nearer at rest than the smaller one's radius.
/// What is joined that closely is held apart by the body's stiffness; a contact on top would only quarrel with it.
#[derive(Clone, Debug, Default)]
pub struct SelfSearch {
    resting: RestPairs,
    broad: BroadPhase,
    /// The particles' boxes when those near were searched for, grown.
    around: Vec<Bounds>,
    /// Keys of those near, sorted.
    near: Vec<u64>,
}

/// Boxes are grown by this share of their particle's radius: the less, the sooner they are left; the more, the more are near.
const MARGIN: f32 = 0.25;

impl SelfSearch {
    /// For a body of `particles` with the edges `edges`; an edge to a particle that does not exist is ignored.
    ///
    /// # Errors
    ///
    /// If more than 256 pairs a particle (and more than half a million) overlap at rest.
    pub fn new(particles: &Particles, edges: &[[u32; 2]]) -> Result<Self, TooDense> {
        Ok(Self { resting: RestPairs::new(particles, edges)?, ..Self::default() })
    }

    /// Fills `pairs` for a step.
    pub fn find(&mut self, p: &Particles, search: &PairSearch, pairs: &mut Pairs) {
        let frame = mean_velocity(p);
        let swept = |i| swept(p, i, Vec3A::ZERO, frame, search);
        let most = MOST * p.len();
        let known = self.around.len() == p.len() && self.around.iter().enumerate().all(|(i, around)| around.holds(&swept(i)));
        if !known {
            self.around.clear();
            self.around.extend((0..p.len()).map(|i| swept(i).grown(MARGIN * p.radii[i].max_element())));
            self.look_around(most, |_, _| true);
        }
        let meet = |i: u32, j: u32| meet_in_step(p, i as usize, p, j as usize, Vec3A::ZERO, search);
        if self.near.len() >= most {
            // A body that has collapsed: it is searched anew in every step, for what meets in it.
            self.look_around(most, meet);
            self.around.clear();
        }
        pairs.refill(self.near.iter().copied().filter(|&k| meet((k >> 32) as u32, k as u32)), p, p, Vec3A::ZERO);
        pairs.way_out = None;
    }

    /// Searches for those near that `count`, up to so many.
    fn look_around(&mut self, most: usize, count: impl Fn(u32, u32) -> bool) {
        let Self { resting, broad, around, near } = self;
        near.clear();
        broad.pairs(around, |i, j| {
            if !resting.contains(i, j) && count(i, j) {
                near.push(key(i, j));
            }
            near.len() < most
        });
        near.sort_unstable();
    }
}
