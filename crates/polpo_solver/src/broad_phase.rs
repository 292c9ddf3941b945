//! Which of many boxes meet.

use fearless_simd::prelude::*;
use fearless_simd::{Level, dispatch};
use glam::Vec3A;

use crate::lanes::{LANES, Lane, Lanes, bits};

/// An axis-aligned box \[m\].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Its least corner.
    pub min: Vec3A,
    /// Its greatest corner.
    pub max: Vec3A,
}

impl Bounds {
    /// The box of nothing, which meets none; grow it by [`include`](Self::include).
    pub const NOTHING: Self = Self { min: Vec3A::INFINITY, max: Vec3A::NEG_INFINITY };

    /// The box of a ball of `radius` on its way from `from` to `to`.
    #[inline]
    pub fn of_swept_ball(from: Vec3A, to: Vec3A, radius: f32) -> Self {
        Self { min: from.min(to) - radius, max: from.max(to) + radius }
    }

    /// Grows to hold `other` too.
    #[inline]
    pub fn include(&mut self, other: &Self) {
        self.min = self.min.min(other.min);
        self.max = self.max.max(other.max);
    }

    /// The box and what is up to `margin` \[m\] away from it along each axis.
    #[inline]
    pub fn grown(&self, margin: f32) -> Self {
        Self { min: self.min - margin, max: self.max + margin }
    }

    /// Whether all of `other` is in this. Nothing that is not a number is.
    #[inline]
    pub fn holds(&self, other: &Self) -> bool {
        self.min.cmple(other.min).all() && self.max.cmpge(other.max).all()
    }

    /// Whether the two have a point in common. A box that is not finite meets none.
    #[inline]
    pub fn meets(&self, other: &Self) -> bool {
        self.min.cmple(other.max).all() && self.max.cmpge(other.min).all()
    }

    /// Whether all its numbers are.
    #[inline]
    pub fn is_finite(&self) -> bool {
        self.min.is_finite() && self.max.is_finite()
    }
}

/// Sort and sweep: the boxes are sorted by where they begin along the axis on which they are spread out most, and each is compared with those that begin before it ends.
///
/// Nothing depends on the boxes' sizes or on how far apart they are, as the cells of a grid would; a thousand boxes in a heap cost about as much as a grid's. Sorted by place and index, so the same
/// boxes give the same pairs in the same order. Reuse it: a warmed-up search allocates nothing.
#[derive(Clone, Debug, Default)]
pub struct BroadPhase {
    /// Of all boxes, or of two kinds that are looked at apart.
    lines: [Line; 2],
}

/// Boxes sorted along the axis.
#[derive(Clone, Debug, Default)]
struct Line {
    /// Beginnings along the axis, as integers of the same order, and indices.
    order: Vec<(i32, u32)>,
    /// The boxes in that order, eight to one; what makes up the last eight meets none.
    sorted: Vec<EightBoxes>,
}

/// The least and greatest corners of eight boxes, by axes.
#[derive(Clone, Copy, Debug)]
struct EightBoxes {
    min: [Lane; 3],
    max: [Lane; 3],
}

impl EightBoxes {
    const NOTHING: Self = Self { min: [[f32::INFINITY; LANES]; 3], max: [[f32::NEG_INFINITY; LANES]; 3] };
}

impl BroadPhase {
    /// Calls `meet` with the indices of every two boxes that meet, the smaller first, until it says no. Boxes that are not finite are left out.
    pub fn pairs(&mut self, boxes: &[Bounds], mut meet: impl FnMut(u32, u32) -> bool) {
        let axis = widest_axis(boxes);
        let [all, _] = &mut self.lines;
        all.sort(boxes, 0, axis);
        let all = &*all;
        dispatch!(Level::new(), simd => all.sweep(Lanes::<_, false>(simd), all, boxes, axis, |k| k + 1, &mut meet));
    }

    /// The same of every two of which one is among the `first` so many boxes and the other is not: of two heaps, without what meets in either.
    pub fn pairs_between(&mut self, boxes: &[Bounds], first: usize, mut meet: impl FnMut(u32, u32) -> bool) {
        let axis = widest_axis(boxes);
        let (these, those) = boxes.split_at(first.min(boxes.len()));
        let [one, other] = &mut self.lines;
        one.sort(these, 0, axis);
        other.sort(those, these.len() as u32, axis);
        let (one, other) = (&*one, &*other);
        // Of two that begin together, the first one's sweep finds the second.
        let (mut at, mut past) = (0, 0);
        let from = |k: usize| {
            at += other.order[at..].iter().take_while(|(begin, _)| *begin < one.order[k].0).count();
            at
        };
        let behind = |k: usize| {
            past += one.order[past..].iter().take_while(|(begin, _)| *begin <= other.order[k].0).count();
            past
        };
        dispatch!(Level::new(), simd => {
            if one.sweep(Lanes::<_, false>(simd), other, boxes, axis, from, &mut meet) {
                other.sweep(Lanes::<_, false>(simd), one, boxes, axis, behind, &mut meet);
            }
        });
    }
}

impl Line {
    /// Takes the finite ones of `boxes`, whose indices are counted on from `count`.
    fn sort(&mut self, boxes: &[Bounds], count: u32, axis: usize) {
        self.order.clear();
        self.order.extend((0u32..).zip(boxes).filter(|(_, b)| b.is_finite()).map(|(i, b)| (ordered(b.min[axis]), count + i)));
        self.order.sort_unstable();
        self.sorted.clear();
        self.sorted.resize(self.order.len().div_ceil(LANES), EightBoxes::NOTHING);
        for (k, &(_, i)) in self.order.iter().enumerate() {
            let (eight, l, of) = (&mut self.sorted[k / LANES], k % LANES, &boxes[(i - count) as usize]);
            for a in 0..3 {
                (eight.min[a][l], eight.max[a][l]) = (of.min[a], of.max[a]);
            }
        }
    }

    /// Compares the k-th box with those in `others` that begin before it ends, from `start(k)` on. Whether `meet` never said no.
    #[inline(always)]
    fn sweep<S: Simd>(
        &self,
        lanes: Lanes<S, false>,
        others: &Self,
        boxes: &[Bounds],
        axis: usize,
        mut start: impl FnMut(usize) -> usize,
        meet: &mut impl FnMut(u32, u32) -> bool,
    ) -> bool {
        for (k, &(_, i)) in self.order.iter().enumerate() {
            let Bounds { min, max } = boxes[i as usize];
            let (min, max) = ([min.x, min.y, min.z], [max.x, max.y, max.z]);
            let end = max[axis];
            let start = start(k);
            // The first eight hold some before those.
            let mut after = u8::MAX << (start % LANES);
            for (block, other) in others.sorted.iter().enumerate().skip(start / LANES) {
                if other.min[axis][0] > end {
                    break;
                }
                let begins = |a: usize| lanes.load(&other.min[a]).simd_le(lanes.splat(max[a]));
                let ends = |a: usize| lanes.load(&other.max[a]).simd_ge(lanes.splat(min[a]));
                let meets = begins(0) & begins(1) & begins(2) & ends(0) & ends(1) & ends(2);
                for l in bits(after & meets.to_bitmask() as u8) {
                    let j = others.order[block * LANES + l].1;
                    if !meet(i.min(j), i.max(j)) {
                        return false;
                    }
                }
                after = u8::MAX;
            }
        }
        true
    }
}

/// The axis on which the boxes' middles are spread out most.
fn widest_axis(boxes: &[Bounds]) -> usize {
    let (mut sum, mut squares, mut count) = (Vec3A::ZERO, Vec3A::ZERO, 0.0);
    for b in boxes.iter().filter(|b| b.is_finite()) {
        let middle = 0.5 * b.min + 0.5 * b.max;
        sum += middle;
        squares += middle * middle;
        count += 1.0;
    }
    let spread = squares - sum * sum / count;
    // Also for spreads beyond what f32 holds: then any axis will do.
    if spread.x >= spread.y && spread.x >= spread.z {
        0
    } else if spread.y >= spread.z {
        1
    } else {
        2
    }
}

/// An integer that sorts like the number; −0 comes right before 0.
#[inline]
fn ordered(x: f32) -> i32 {
    let bits = x.to_bits() as i32;
    bits ^ (((bits >> 31) as u32) >> 1) as i32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Random;

    fn pairs(boxes: &[Bounds]) -> Vec<(u32, u32)> {
        let mut found = Vec::new();
        BroadPhase::default().pairs(boxes, |i, j| {
            found.push((i, j));
            true
        });
        found.sort_unstable();
        found
    }

    /// Sizes from 1 to 100, in three shapes of heap, some of it not finite.
    #[test]
    fn it_finds_what_comparing_all_with_all_finds() {
        let mut random = Random(1);
        let mut met = 0;
        for stretch in [Vec3A::ONE, Vec3A::new(20.0, 1.0, 0.0), Vec3A::new(0.0, 0.0, 1e30)] {
            let boxes: Vec<Bounds> = (0..300)
                .map(|i| {
                    let at = random.vector() * 10.0 * stretch;
                    let radius = if i % 50 == 0 { 5.0 } else { 0.05 + random.signed().abs() };
                    let at = if i % 97 == 5 { at / 0.0 } else { at };
                    Bounds::of_swept_ball(at, at + random.vector(), radius)
                })
                .collect();
            let mut expected = Vec::new();
            for j in 0..boxes.len() {
                for i in 0..j {
                    if boxes[i].is_finite() && boxes[j].is_finite() && boxes[i].meets(&boxes[j]) {
                        expected.push((i as u32, j as u32));
                    }
                }
            }
            expected.sort_unstable();
            met += expected.len();
            assert_eq!(pairs(&boxes), expected);
        }
        assert!(met > 300, "{met}");
        assert!(pairs(&[]).is_empty());
    }

    /// Among them some that begin at the same place, on both sides.
    #[test]
    fn between_two_it_finds_the_pairs_of_one_from_each() {
        let mut random = Random(2);
        let (mut met, mut broad) = (0, BroadPhase::default());
        for first in [0, 1, 7, 120, 293, 300] {
            let boxes: Vec<Bounds> = (0..300)
                .map(|i| {
                    let at = (random.vector() * 8.0).round() * if i % 97 == 5 { f32::NAN } else { 1.0 };
                    Bounds::of_swept_ball(at, at + random.vector(), 0.5 + random.signed().abs())
                })
                .collect();
            let mut expected = pairs(&boxes);
            expected.retain(|(i, j)| (*i as usize) < first && *j as usize >= first);
            let mut found = Vec::new();
            broad.pairs_between(&boxes, first, |i, j| {
                found.push((i, j));
                true
            });
            found.sort_unstable();
            met += found.len();
            assert_eq!(found, expected, "{first} beside the rest");
        }
        assert!(met > 300, "{met}");
    }

    #[test]
    fn it_stops_when_told() {
        let boxes = [Bounds::of_swept_ball(Vec3A::ZERO, Vec3A::ZERO, 1.0); 5];
        let mut calls = 0;
        BroadPhase::default().pairs(&boxes, |_, _| {
            calls += 1;
            calls < 3
        });
        assert_eq!(calls, 3);
        for first in [1, 4] {
            calls = 0;
            BroadPhase::default().pairs_between(&boxes, first, |_, _| {
                calls += 1;
                calls < 2
            });
            assert_eq!(calls, 2);
        }
    }
}
