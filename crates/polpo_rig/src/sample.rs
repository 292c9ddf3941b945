//! Particles: a centroidal Voronoi clustering of the body's voxels (Lloyd 1982), with distances along the body.
//!
//! They start as a Poisson disk as dense as can be, always where it is farthest from all before (Gonzalez 1985), and are evened out
//! by Lloyd's steps. In a limb thinner than the spacing the cells become slices and their centres lie on the medial axis; in a thick
//! part they fill the volume. How dense they are where, and which voxels may hold one, is the [`Domain`] of the placement.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use glam::DVec3;

use crate::domain::Domain;
use crate::flood::Cells;
use crate::recipe::MOST_PARTICLES;
use crate::voxels::Voxels;

/// Lloyd steps. After a dozen the cells barely change.
const LLOYD_STEPS: usize = 12;

/// Rounds of the search for a spacing, and how well it is to be met.
const ROUNDS: usize = 6;
const MET: f64 = 0.03;
/// A body has one particle rather than two that are nearer than e⁻⁰·³⁵ = 0.7 of the spacing.
const ALONE: f64 = 0.35;

/// How many particles.
#[derive(Clone, Copy)]
pub(crate) enum Wanted {
    /// So many.
    Count(usize),
    /// As many as are so far from their nearest neighbour on average, in the unit box.
    Spacing(f64),
}

/// The particles and the voxels each one stands for.
pub(crate) struct Sample {
    /// Centre of every particle, in the unit box, within its cell.
    pub(crate) positions: Vec<DVec3>,
    /// Voxels in every cell, at least one.
    pub(crate) volumes: Vec<u32>,
    /// The particle that owns each voxel.
    pub(crate) owner: Vec<u32>,
    /// The voxel each particle lies in.
    pub(crate) voxel: Vec<u32>,
    /// The pairs of particles whose cells touch, the smaller index first, sorted.
    pub(crate) touching: Vec<[u32; 2]>,
}

impl Sample {
    /// Spreads so many particles over the domain; more only if it has more parts than that, since every part gets one.
    pub(crate) fn new(voxels: &Voxels, domain: &Domain, wanted: Wanted) -> Sample {
        let apart = match wanted {
            Wanted::Count(count) => {
                let (sites, seeds) = spread_where_it_fits(voxels, domain, |seeds, _| seeds >= count);
                return Sample::around(voxels, domain, sites, seeds);
            }
            Wanted::Spacing(apart) => apart,
        };
        // The widest gap is about as far as the nearest neighbour; from there on the count is tried, between one too few and one too many.
        let gap = domain.steps(voxels, apart);
        let (_, seeds) = spread_where_it_fits(voxels, domain, |seeds, distance| f64::from(distance) < gap || seeds >= MOST_PARTICLES);
        let (mut few, mut many) = (0, MOST_PARTICLES + 1);
        let mut count = seeds.len();
        let mut best: Option<(f64, Sample)> = None;
        for _ in 0..ROUNDS {
            let sample = Sample::new(voxels, domain, Wanted::Count(count));
            let ratio = sample.spacing().map(|s| s / apart);
            let off = ratio.map_or(ALONE, |r| libm::log(r).abs());
            if best.as_ref().is_none_or(|b| off < b.0) {
                best = Some((off, sample));
            }
            let ratio = ratio.unwrap_or(2.0);
            if ratio > 1.0 {
                few = few.max(count)
            } else {
                many = many.min(count)
            }
            if off < MET || few + 1 >= many {
                break;
            }
            count = ((count as f64 * ratio * ratio * ratio.sqrt()) as usize).clamp(few + 1, many - 1);
        }
        best.map_or_else(|| Sample::new(voxels, domain, Wanted::Count(1)), |b| b.1)
    }

    /// Moves the seeds to the middle of their cells until they stay.
    fn around(voxels: &Voxels, domain: &Domain, sites: &[bool], mut seeds: Vec<u32>) -> Sample {
        let mut cells = Cells::new(voxels);
        for _ in 0..LLOYD_STEPS {
            cells = Cells::new(voxels);
            cells.flood(voxels, &domain.weights, &seeds, 0);
            let moved = central_voxels(voxels, sites, &cells.owner, &centroids(voxels, &cells.owner, seeds.len()).0);
            if moved == seeds {
                break;
            }
            seeds = moved;
        }
        let touching = touching(voxels, &cells.owner, domain.shell);
        let (centroids, mut volumes) = centroids(voxels, &cells.owner, seeds.len());
        let voxel = central_voxels(voxels, sites, &cells.owner, &centroids);
        if domain.shell {
            // Only the skin is divided so far: what lies below it goes with what is nearest.
            cells.fill(voxels);
            volumes = self::centroids(voxels, &cells.owner, seeds.len()).1;
        }
        let owner = cells.owner;
        let positions = (0..seeds.len()).map(|i| {
            if voxels.at(centroids[i]).is_some_and(|v| owner[v as usize] == i as u32) { centroids[i] } else { voxels.centre(voxel[i]) }
        });
        Sample { positions: positions.collect(), volumes, voxel, owner, touching }
    }

    /// The mean distance of the particles from the nearest one whose cell touches theirs, if any touch.
    pub(crate) fn spacing(&self) -> Option<f64> {
        let mut nearest = vec![f64::INFINITY; self.positions.len()];
        for pair in &self.touching {
            let [a, b] = pair.map(|p| p as usize);
            let distance = self.positions[a].distance(self.positions[b]);
            nearest[a] = nearest[a].min(distance);
            nearest[b] = nearest[b].min(distance);
        }
        nearest.retain(|d| d.is_finite());
        (!nearest.is_empty()).then(|| nearest.iter().sum::<f64>() / nearest.len() as f64)
    }
}

/// Spreads particles over the narrowest sites on which they do not crowd: the sites and the particles.
fn spread_where_it_fits<'a>(voxels: &Voxels, domain: &'a Domain, enough: impl Fn(usize, u32) -> bool) -> (&'a [bool], Vec<u32>) {
    let mut last = (&[][..], Vec::new());
    for (sites, crowded) in &domain.sites {
        let (seeds, gap) = spread(voxels, domain, sites, &enough);
        last = (sites, seeds);
        if gap >= *crowded {
            break;
        }
    }
    last
}

/// Where the particles start: one in every part, then always the voxel that is farthest from all of them, until it is `enough`. And the
/// last one's distance from those before.
fn spread(voxels: &Voxels, domain: &Domain, sites: &[bool], enough: impl Fn(usize, u32) -> bool) -> (Vec<u32>, u32) {
    let allowed = |v: u32| sites.is_empty() || sites[v as usize];
    let parts = voxels.roots(|a, b| !domain.shell || allowed(a) && allowed(b));
    let mut begun = vec![false; voxels.len()];
    let first_of_its_part = |&v: &u32| allowed(v) && !std::mem::replace(&mut begun[parts[v as usize] as usize], true);
    let mut seeds: Vec<u32> = (0..voxels.len() as u32).filter(first_of_its_part).collect();
    let mut cells = Cells::new(voxels);
    cells.flood(voxels, &domain.weights, &seeds, 0);
    // Distances only shrink, so an entry that is out of date can wait until it comes up.
    let mut farthest: BinaryHeap<(u32, Reverse<u32>)> =
        (0..voxels.len() as u32).filter(|&v| allowed(v)).map(|v| (cells.distance[v as usize], Reverse(v))).collect();
    let mut gap = u32::MAX;
    while let Some((distance, Reverse(voxel))) = farthest.pop() {
        let now = cells.distance[voxel as usize];
        if now < distance {
            farthest.push((now, Reverse(voxel)));
            continue;
        }
        if now == 0 || enough(seeds.len(), now) {
            // Out of sites: as crowded as can be.
            gap = if now == 0 { 0 } else { gap };
            break;
        }
        cells.flood(voxels, &domain.weights, &[voxel], seeds.len() as u32);
        seeds.push(voxel);
        gap = now;
    }
    (seeds, gap)
}

/// Centre and number of the voxels of every cell.
fn centroids(voxels: &Voxels, owner: &[u32], count: usize) -> (Vec<DVec3>, Vec<u32>) {
    let mut sums = vec![DVec3::ZERO; count];
    let mut volumes = vec![0; count];
    for (voxel, &cell) in owner.iter().enumerate().filter(|v| *v.1 != u32::MAX) {
        sums[cell as usize] += voxels.centre(voxel as u32);
        volumes[cell as usize] += 1;
    }
    for (sum, &volume) in sums.iter_mut().zip(&volumes) {
        *sum /= f64::from(volume);
    }
    (sums, volumes)
}

/// The site of every cell that is nearest to its centre; every voxel is one if `sites` is empty.
pub(crate) fn central_voxels(voxels: &Voxels, sites: &[bool], owner: &[u32], centres: &[DVec3]) -> Vec<u32> {
    let mut nearest = vec![(f64::INFINITY, 0); centres.len()];
    for (voxel, &cell) in owner.iter().enumerate().filter(|v| *v.1 != u32::MAX && (sites.is_empty() || sites[v.0])) {
        let distance = voxels.centre(voxel as u32).distance_squared(centres[cell as usize]);
        if distance < nearest[cell as usize].0 {
            nearest[cell as usize] = (distance, voxel as u32);
        }
    }
    nearest.into_iter().map(|(_, voxel)| voxel).collect()
}

/// The pairs of cells that have voxels beside each other, on the skin of a `shell`, sorted.
pub(crate) fn touching(voxels: &Voxels, owner: &[u32], shell: bool) -> Vec<[u32; 2]> {
    let counts = |v: u32| owner[v as usize] != u32::MAX && (!shell || voxels.is_skin(v));
    let mut pairs = Vec::new();
    let mut last = [0, 0];
    for voxel in (0..voxels.len() as u32).filter(|&v| counts(v)) {
        let a = owner[voxel as usize];
        for (next, _) in voxels.neighbours(voxel) {
            let b = owner[next as usize];
            if a < b && counts(next) && last != [a, b] {
                last = [a, b];
                pairs.push(last);
            }
        }
    }
    pairs.sort_unstable();
    pairs.dedup();
    pairs
}
