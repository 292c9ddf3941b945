//! The order of constraints: sorted by place, then by colour, sets of constraints that share no particle.

use std::collections::VecDeque;

use glam::Vec3A;

/// The rank of each particle by where it is at rest: by x, then y, then z, then index.
///
/// Constraints that are solved one after the other come out differently in another order. Taken in the order of where they are, rather than of how a rig happens to number its particles, they come out
/// the same, to rounding, whatever the numbers.
pub(crate) fn rank(rest_position: &[Vec3A]) -> Vec<u32> {
    let mut order: Vec<u32> = (0..rest_position.len() as u32).collect();
    order.sort_by(|&i, &j| {
        let (a, b) = (rest_position[i as usize], rest_position[j as usize]);
        a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)).then(a.z.total_cmp(&b.z)).then(i.cmp(&j))
    });
    let mut rank = vec![0; order.len()];
    for (r, &i) in order.iter().enumerate() {
        rank[i as usize] = r as u32;
    }
    rank
}

/// Gives each of `rows` (lists of particle indices below `particles`) the smallest colour that no earlier row with a common particle has, and returns the rows sorted by colour (ties in row
/// order) with the start of each colour in that order, plus the end.
///
/// Rows of one colour touch disjoint particles, so they may be solved in any order, in parallel or in vector lanes, with the same result to the bit.
pub(crate) fn color_rows<'a>(particles: usize, rows: impl ExactSizeIterator<Item = &'a [u32]> + Clone) -> (Vec<u32>, Vec<u32>) {
    // Per particle, a bit set of the colours of the rows that contain it.
    let mut used: Vec<Vec<u64>> = vec![Vec::new(); particles];
    let mut color = Vec::with_capacity(rows.len());
    let mut taken: Vec<u64> = Vec::new();
    for row in rows {
        taken.clear();
        for &i in row {
            let words = &used[i as usize];
            if taken.len() < words.len() {
                taken.resize(words.len(), 0);
            }
            for (t, w) in taken.iter_mut().zip(words) {
                *t |= w;
            }
        }
        let word = taken.iter().position(|&w| w != u64::MAX).unwrap_or(taken.len());
        let bit = taken.get(word).map_or(0, |w| w.trailing_ones() as usize);
        for &i in row {
            let words = &mut used[i as usize];
            if words.len() <= word {
                words.resize(word + 1, 0);
            }
            words[word] |= 1 << bit;
        }
        color.push((word * 64 + bit) as u32);
    }
    let mut order: Vec<u32> = (0..color.len() as u32).collect();
    order.sort_by_key(|&row| color[row as usize]);
    let count = color.iter().max().map_or(0, |&c| c as usize + 1);
    let mut starts = vec![0u32; count + 1];
    for &c in &color {
        starts[c as usize + 1] += 1;
    }
    for c in 0..count {
        starts[c + 1] += starts[c];
    }
    (order, starts)
}

/// Cuts rows sorted by colour, whose colours start at `starts`, into batches of at most `width` of one colour; returns where each begins, plus the end.
///
/// [`batch_rows`] fills batches better, but takes rows in another order.
pub(crate) fn cut(starts: &[u32], width: usize) -> Vec<u32> {
    let mut batches: Vec<u32> = starts.windows(2).flat_map(|ends| (ends[0]..ends[1]).step_by(width)).collect();
    batches.extend(starts.last());
    batches
}

/// How many unfilled batches are kept open for further rows.
const OPEN: usize = 64;

/// Gathers `rows` (lists of particle indices below `particles`), in their order, into batches of at most `width` that share no particle. Returns the rows batch after batch, and where each batch starts, plus the end.
///
/// Rows of one batch may be solved side by side, in vector lanes, with the same result to the bit. Each goes into the first batch that has room and nothing in common with it; of batches with room only the newest 64 are
/// looked at. Of the octopus' 300 groups, sorted by length, 39 batches are made, where 38 are the least.
pub(crate) fn batch_rows<'a>(particles: usize, width: usize, rows: impl Iterator<Item = &'a [u32]>) -> (Vec<u32>, Vec<u32>) {
    // Per particle, the batches that contain it.
    let mut of: Vec<Vec<u32>> = vec![Vec::new(); particles];
    let mut batches: Vec<Vec<u32>> = Vec::new();
    let mut open: VecDeque<u32> = VecDeque::new();
    for (row, members) in rows.enumerate() {
        let fits = |b: &u32| !members.iter().any(|&i| of[i as usize].contains(b));
        let batch = match open.iter().position(fits) {
            Some(at) => {
                let batch = open[at];
                if batches[batch as usize].len() + 1 == width {
                    open.remove(at);
                }
                batch
            }
            None => {
                if open.len() == OPEN {
                    open.pop_front();
                }
                batches.push(Vec::new());
                let batch = (batches.len() - 1) as u32;
                if width > 1 {
                    open.push_back(batch);
                }
                batch
            }
        };
        batches[batch as usize].push(row as u32);
        members.iter().for_each(|&i| of[i as usize].push(batch));
    }
    let mut starts = vec![0];
    starts.extend(batches.iter().scan(0, |end, batch| {
        *end += batch.len() as u32;
        Some(*end)
    }));
    (batches.concat(), starts)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_of_one_colour_share_no_particle() {
        // A complete graph on 70 particles needs more than 64 colours: past one word of the bit set.
        let pairs: Vec<[u32; 2]> = (0..70).flat_map(|i| (0..i).map(move |j| [j, i])).collect();
        let (order, starts) = color_rows(70, pairs.iter().map(|p| p.as_slice()));
        assert_eq!(order.len(), pairs.len());
        assert_eq!(*starts.last().unwrap() as usize, pairs.len());
        assert!(starts.len() > 65);
        let mut seen = vec![false; pairs.len()];
        for range in starts.windows(2) {
            let mut touched = [false; 70];
            for &row in &order[range[0] as usize..range[1] as usize] {
                assert!(!std::mem::replace(&mut seen[row as usize], true));
                for &i in &pairs[row as usize] {
                    assert!(!std::mem::replace(&mut touched[i as usize], true));
                }
            }
        }
        assert!(seen.into_iter().all(|s| s));
    }

    #[test]
    fn rows_of_one_batch_share_no_particle() {
        let pairs: Vec<[u32; 2]> = (0..70).flat_map(|i| (0..i).map(move |j| [j, i])).collect();
        let (order, starts) = batch_rows(70, 8, pairs.iter().map(|p| p.as_slice()));
        let mut sorted = order.clone();
        sorted.sort_unstable();
        assert!(sorted.into_iter().eq(0..pairs.len() as u32));
        assert!(starts.len() - 1 < pairs.len() / 7, "{} batches", starts.len() - 1);
        for range in starts.windows(2) {
            assert!((1..=8).contains(&(range[1] - range[0])));
            let mut touched = [false; 70];
            for &row in &order[range[0] as usize..range[1] as usize] {
                for &i in &pairs[row as usize] {
                    assert!(!std::mem::replace(&mut touched[i as usize], true));
                }
            }
        }
    }

    #[test]
    fn batches_end_with_their_colour() {
        assert_eq!(cut(&[0, 3, 12, 28], 8), [0, 3, 11, 12, 20, 28]);
        assert_eq!(cut(&[0], 8), [0]);
    }

    #[test]
    fn nothing_has_no_colours() {
        let none: [[u32; 2]; 0] = [];
        assert_eq!(color_rows(3, none.iter().map(|p| p.as_slice())), (vec![], vec![0]));
        assert_eq!(batch_rows(3, 8, none.iter().map(|p| p.as_slice())), (vec![], vec![0]));
    }
}
