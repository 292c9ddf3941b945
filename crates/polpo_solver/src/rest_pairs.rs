//! Which particles of a body never count as touching each other.

use crate::ellipsoid_pair::EllipsoidPair;
use crate::pairs::key;
use crate::{Bounds, BroadPhase, Particles};

/// The pairs of a body that never count as touching, see [`SelfSearch`](crate::SelfSearch).
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct RestPairs {
    /// Particle i's partners j > i, sorted, are `partners[rows[i]..rows[i + 1]]`.
    rows: Vec<u32>,
    partners: Vec<u32>,
}

/// So many particles of a body overlap at rest that self-contact would have nothing to hold apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{pairs} or more pairs of its {particles} particles overlap at rest")]
pub struct TooDense {
    /// How many pairs were found before the search was given up.
    pub pairs: usize,
    /// How many particles there are.
    pub particles: usize,
}

/// Gaps at rest up to this share of the smaller one's radius count as an overlap: what all but touches at rest would touch for ever.
const NEARLY: f32 = 0.1;

impl RestPairs {
    /// As [`SelfSearch::new`](crate::SelfSearch::new).
    pub(crate) fn new(particles: &Particles, edges: &[[u32; 2]]) -> Result<Self, TooDense> {
        let n = particles.len();
        let most = (256 * n).max(500_000);
        let boxes: Vec<Bounds> = (0..n)
            .map(|i| {
                let x = particles.rest_position[i];
                Bounds::of_swept_ball(x, x, 1.5 * particles.radii[i].max_element())
            })
            .collect();
        let mut keys: Vec<u64> = edges.iter().map(|&[i, j]| key(i.min(j), i.max(j))).collect();
        let mut both_ways: Vec<(u32, u32)> = edges.iter().flat_map(|&[i, j]| [(i, j), (j, i)]).collect();
        both_ways.sort_unstable();
        let neighbours = |i: u32| {
            let from = both_ways.partition_point(|&(a, _)| a < i);
            both_ways[from..].iter().take_while(move |&&(a, _)| a == i).map(|&(_, b)| b)
        };
        let mut found = 0;
        BroadPhase::default().pairs(&boxes, |i, j| {
            let (a, b) = (i as usize, j as usize);
            let d = particles.rest_position[b] - particles.rest_position[a];
            let bound = |k: usize| particles.radii[k].max_element();
            let akin = neighbours(i).any(|k| neighbours(j).any(|l| k == l));
            let near = if akin { 1.0 } else { NEARLY } * bound(a).min(bound(b));
            if d.length_squared() < (bound(a) + bound(b) + near).powi(2) {
                let at_rest = |k: usize| crate::Ellipsoid { radii: particles.radii[k], orientation: particles.frame[k] };
                if EllipsoidPair::new(&at_rest(a), &at_rest(b), d).contact().gap <= near {
                    keys.push(key(i, j));
                    found += 1;
                }
            }
            found < most
        });
        if found >= most {
            return Err(TooDense { pairs: found, particles: n });
        }
        keys.sort_unstable();
        keys.dedup();
        // An edge may lead to a particle that does not exist.
        keys.retain(|&k| (k as u32 as usize) < n);
        let mut this = Self::default();
        fill_rows(n, &keys, &mut this.rows, &mut this.partners);
        Ok(this)
    }

    /// Whether `i` and `j`, i < j, are left out.
    #[inline]
    pub(crate) fn contains(&self, i: u32, j: u32) -> bool {
        let i = i as usize;
        match (self.rows.get(i), self.rows.get(i + 1)) {
            (Some(&from), Some(&to)) => self.partners[from as usize..to as usize].contains(&j),
            _ => false,
        }
    }
}

/// Sorted `keys` of particles below `count` as compressed rows: the partners of i are `partners[rows[i]..rows[i + 1]]`.
pub(crate) fn fill_rows(count: usize, keys: &[u64], rows: &mut Vec<u32>, partners: &mut Vec<u32>) {
    rows.clear();
    rows.resize(count + 1, 0);
    for k in keys {
        rows[(k >> 32) as usize + 1] += 1;
    }
    for i in 0..count {
        rows[i + 1] += rows[i];
    }
    partners.clear();
    partners.reserve_exact(keys.len());
    partners.extend(keys.iter().map(|&k| k as u32));
}
