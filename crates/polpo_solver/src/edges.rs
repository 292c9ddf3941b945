//! Edges: the pairs of particles that hold on to each other.

use std::ops::Range;

use glam::Quat;

use crate::coloring::{color_rows, cut, rank};
use crate::lanes::{LANES, ends};
use crate::{ExplicitGroups, Particles};

/// What is wrong with an edge.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum EdgeError {
    /// An end does not exist.
    #[error("edge {edge}: particle {particle} is not among the {count} there are")]
    Index {
        /// Which edge.
        edge: usize,
        /// The end that does not exist.
        particle: u32,
        /// How many particles there are.
        count: usize,
    },
    /// Both ends are the same particle.
    #[error("edge {edge}: both ends are particle {particle}")]
    Loop {
        /// Which edge.
        edge: usize,
        /// The particle.
        particle: u32,
    },
    /// The same two particles are joined twice.
    #[error("edge {edge}: particles {a} and {b} are already joined")]
    Duplicate {
        /// Which edge.
        edge: usize,
        /// Its first end.
        a: u32,
        /// Its second end.
        b: u32,
    },
}

/// Edges sorted by colour, and by where they are at rest; those of one colour share no particle and are solved side by side, in batches of up to eight.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Edges {
    /// Ends of each edge.
    pub pairs: Vec<[u32; 2]>,
    /// Distance of the ends at rest \[m\].
    pub rest_length: Vec<f32>,
    /// Which of the pairs that [`Edges::new`] was given each edge is.
    pub input: Vec<u32>,
    /// What each edge has been stretched in this substep \[m\], and twisted \[rad\]; empty with one sweep a substep.
    pub(crate) stretch: Vec<f32>,
    pub(crate) twist: Vec<f32>,
    /// By how much plastic flow has made each edge longer, as a factor; empty while nothing has flowed.
    pub(crate) flow: Vec<f32>,
    /// q_j⁻¹·q_i of the rotations that the ends have in the rest pose; empty while they have none.
    pub(crate) rest_turn: Vec<Quat>,
    /// Whether each edge rests because a rigid group holds both its ends; empty if none ever does.
    pub(crate) held: Vec<bool>,
    /// Scratch: per particle, the last rigid group seen that has it.
    pub(crate) holder: Vec<u32>,
    /// Where each batch starts in `pairs`, and the end of the last.
    pub(crate) batches: Vec<u32>,
}

impl Edges {
    /// Edges between particles at their rest positions.
    ///
    /// # Errors
    ///
    /// The first edge that has an end that does not exist, joins a particle to itself, or repeats an earlier one.
    pub fn new(particles: &Particles, pairs: &[[u32; 2]]) -> Result<Self, EdgeError> {
        let count = particles.len();
        for (edge, &[a, b]) in pairs.iter().enumerate() {
            for particle in [a, b] {
                if particle as usize >= count {
                    return Err(EdgeError::Index { edge, particle, count });
                }
            }
            if a == b {
                return Err(EdgeError::Loop { edge, particle: a });
            }
        }
        let mut sorted: Vec<(u32, u32, usize)> = pairs.iter().enumerate().map(|(edge, &[a, b])| (a.min(b), a.max(b), edge)).collect();
        sorted.sort_unstable();
        for two in sorted.windows(2) {
            if (two[0].0, two[0].1) == (two[1].0, two[1].1) {
                return Err(EdgeError::Duplicate { edge: two[1].2, a: two[1].0, b: two[1].1 });
            }
        }
        let rank = rank(&particles.rest_position);
        let mut input: Vec<u32> = (0..pairs.len() as u32).collect();
        input.sort_by_key(|&e| {
            let [a, b] = pairs[e as usize].map(|i| rank[i as usize]);
            (a.min(b), a.max(b))
        });
        let (order, colors) = color_rows(count, input.iter().map(|&e| pairs[e as usize].as_slice()));
        let batches = cut(&colors, LANES);
        let order: Vec<u32> = order.iter().map(|&k| input[k as usize]).collect();
        let pairs: Vec<[u32; 2]> = order.iter().map(|&e| pairs[e as usize]).collect();
        let rest_length =
            pairs.iter().map(|&[a, b]| particles.rest_position[a as usize].distance(particles.rest_position[b as usize])).collect();
        Ok(Self { pairs, rest_length, input: order, batches, ..Self::default() })
    }

    /// Batch `b`, as a range of `pairs`, with its ends in eight lanes; a lane without an edge repeats the first.
    #[inline(always)]
    pub(crate) fn batch(&self, b: usize) -> (Range<usize>, [[u32; LANES]; 2]) {
        let batch = self.batches[b] as usize..self.batches[b + 1] as usize;
        let ends = ends(&self.pairs[batch.clone()]);
        (batch, ends)
    }

    /// Lets the edges rest whose two ends a rigid, closed group holds, which could only quarrel with it once it is dented or inflated, and wakes the others. To be called when
    /// [`ExplicitGroups::revision`] has changed; does nothing without explicit groups.
    pub fn rest_where_held(&mut self, explicit: &ExplicitGroups) {
        self.held.clear();
        if explicit.is_empty() {
            return;
        }
        self.held.resize(self.pairs.len(), false);
        let Self { held, holder: last, pairs, .. } = self;
        last.clear();
        last.resize(explicit.shape.moment.len(), u32::MAX);
        for g in (0..explicit.len()).filter(|&g| explicit.bodies[g].acting) {
            for &i in explicit.members(g) {
                last[i as usize] = g as u32;
            }
            for (held, pair) in held.iter_mut().zip(&*pairs) {
                *held |= pair.iter().all(|&i| last.get(i as usize) == Some(&(g as u32)));
            }
        }
    }

    /// Number of edges.
    #[inline]
    pub fn len(&self) -> usize {
        self.pairs.len()
    }

    /// Whether there are none.
    #[inline]
    pub fn is_empty(&self) -> bool {
        self.pairs.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::line;

    #[test]
    fn bad_edges_are_named() {
        let p = line(3, 1.0, 0.1);
        assert_eq!(Edges::new(&p, &[[0, 1], [1, 3]]), Err(EdgeError::Index { edge: 1, particle: 3, count: 3 }));
        assert_eq!(Edges::new(&p, &[[2, 2]]), Err(EdgeError::Loop { edge: 0, particle: 2 }));
        assert_eq!(Edges::new(&p, &[[0, 1], [1, 2], [1, 0]]), Err(EdgeError::Duplicate { edge: 2, a: 0, b: 1 }));
    }

    #[test]
    fn a_chain_has_two_batches() {
        let p = line(5, 0.5, 0.1);
        let edges = Edges::new(&p, &[[0, 1], [1, 2], [2, 3], [3, 4]]).unwrap();
        assert_eq!(edges.batches, [0, 2, 4]);
        assert!(edges.rest_length.iter().all(|&l| l == 0.5));
    }
}
