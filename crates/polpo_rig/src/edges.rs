//! Edges: pairs of particles that are near each other along the body, never across the air.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet, BinaryHeap};

use glam::DVec3;

use crate::RigError;
use crate::clean::DisjointSets;
use crate::recipe::check;
use crate::sample::Sample;
use crate::voxels::Voxels;

/// A way over cells that touch is at most this much longer than a straight one.
const ZIGZAG: f64 = 1.3;
/// More edges than this no game wants, and a machine may not hold.
const MOST_EDGES: usize = 10_000_000;

/// Which edges.
#[derive(Clone, Copy)]
pub(crate) enum Wanted {
    /// So many.
    Count(usize),
    /// All pairs that are at most so far apart along the body, in the unit box.
    Length(f64),
}

/// Connects the particles by edges.
///
/// The distance of two particles is the shortest way over cells that touch. For a count it is in units of the spacing there, and the
/// nearest pairs become edges; for a length it is the straight line where that lies in the body. What hangs together in
/// the body hangs together by edges even if that takes more than wanted, and parts that are apart are tied by the shortest edge
/// between them, so that the body doesn't fall to pieces.
///
/// # Errors
/// [`RigError::Setting`] if these were more than a machine holds.
pub(crate) fn connect(voxels: &Voxels, sample: &Sample, wanted: Wanted) -> Result<Vec<[u32; 2]>, RigError> {
    let count = sample.positions.len();
    let distance = |a: u32, b: u32| sample.positions[a as usize].distance(sample.positions[b as usize]);

    let mut shortest: Vec<(f64, [u32; 2])> = sample.touching.iter().map(|&[a, b]| (distance(a, b), [a, b])).collect();
    shortest.sort_unstable_by(|x, y| x.0.total_cmp(&y.0).then(x.1.cmp(&y.1)));

    let mut sets = DisjointSets::new(count);
    let mut edges: BTreeSet<[u32; 2]> = shortest.iter().map(|x| x.1).filter(|&[a, b]| sets.join(a, b)).collect();
    edges.extend(ties(&sample.positions, &mut sets));

    let mut near: Vec<Vec<(u32, f64)>> = vec![Vec::new(); count];
    for &(d, [a, b]) in &shortest {
        near[a as usize].push((b, d));
        near[b as usize].push((a, d));
    }
    let all = count * count.saturating_sub(1) / 2;
    let within_reach = |reach: f64, setting: &'static str, value: f64| {
        let mut pairs: Vec<(f64, [u32; 2])> = Vec::new();
        for a in 0..count as u32 {
            pairs.extend(within(&near, a, reach));
            check(setting, value, pairs.len() <= MOST_EDGES, "small enough for at most 10000000 pairs of particles")?;
        }
        Ok::<_, RigError>(pairs)
    };
    match wanted {
        Wanted::Count(wanted) => {
            check("edges", wanted as f64, wanted.min(all) <= MOST_EDGES, "at most 10000000")?;
            // Twice the reach until the pairs within it are enough; no way is longer than all steps together.
            let longest: f64 = shortest.iter().map(|x| x.0).sum();
            let mut reach = shortest.last().map_or(0.0, |x| x.0);
            let mut pairs = within_reach(reach, "edges", wanted as f64)?;
            while pairs.len() < wanted && reach < longest {
                reach *= 2.0;
                pairs = within_reach(reach, "edges", wanted as f64)?;
            }
            // Near is meant in units of the spacing there, the mean distance to the cells that touch.
            let spacing: Vec<f64> = near.iter().map(|near| near.iter().map(|n| n.1).sum::<f64>() / near.len().max(1) as f64).collect();
            for (distance, [a, b]) in &mut pairs {
                *distance /= spacing[*a as usize] + spacing[*b as usize];
            }
            pairs.sort_unstable_by(|x, y| x.0.total_cmp(&y.0).then(x.1.cmp(&y.1)));
            for (_, pair) in pairs {
                if edges.len() >= wanted {
                    break;
                }
                edges.insert(pair);
            }
        }
        Wanted::Length(length) => {
            let straight = |[a, b]: [u32; 2]| {
                let [from, to] = [a, b].map(|p| sample.positions[p as usize]);
                from.distance(to) <= length && voxels.sees(from, to)
            };
            let pairs = within_reach(length * ZIGZAG, "edge_length", length)?;
            edges.extend(pairs.into_iter().filter(|&(way, pair)| way <= length || straight(pair)).map(|x| x.1));
        }
    }
    Ok(edges.into_iter().collect())
}

/// The pairs (from, higher index) within a distance over touching cells, with their distance.
fn within(near: &[Vec<(u32, f64)>], from: u32, reach: f64) -> Vec<(f64, [u32; 2])> {
    // Distances are positive, so their bits sort as they do.
    let mut best = BTreeMap::from([(from, 0.0_f64)]);
    let mut front = BinaryHeap::from([Reverse((0_u64, from))]);
    while let Some(Reverse((bits, at))) = front.pop() {
        let distance = f64::from_bits(bits);
        if best[&at] < distance {
            continue;
        }
        for &(next, step) in &near[at as usize] {
            let there = distance + step;
            if there <= reach && best.get(&next).is_none_or(|&b| there < b) {
                best.insert(next, there);
                front.push(Reverse((there.to_bits(), next)));
            }
        }
    }
    best.into_iter().filter(|&(to, _)| to > from).map(|(to, d)| (d, [from, to])).collect()
}

/// The shortest edges that tie all sets together: Prim's algorithm, where everything in a set is at no distance.
fn ties(positions: &[DVec3], sets: &mut DisjointSets) -> Vec<[u32; 2]> {
    let count = positions.len() as u32;
    let set: Vec<u32> = (0..count).map(|p| sets.root(p)).collect();
    let mut members: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    for p in 0..count {
        members.entry(set[p as usize]).or_default().push(p);
    }
    let mut nearest = vec![(f64::INFINITY, 0); positions.len()];
    let mut outside: BTreeSet<u32> = (0..count).collect();
    let mut ties = Vec::new();
    let mut joining = set.first().copied();
    while let Some(part) = joining.and_then(|root| members.remove(&root)) {
        for p in &part {
            outside.remove(p);
        }
        for &q in &outside {
            for &p in &part {
                let distance = positions[q as usize].distance_squared(positions[p as usize]);
                if distance < nearest[q as usize].0 {
                    nearest[q as usize] = (distance, p);
                }
            }
        }
        let next = outside.iter().copied().min_by(|&a, &b| nearest[a as usize].0.total_cmp(&nearest[b as usize].0));
        joining = next.map(|q| {
            let p = nearest[q as usize].1;
            ties.push([p.min(q), p.max(q)]);
            set[q as usize]
        });
    }
    ties
}
