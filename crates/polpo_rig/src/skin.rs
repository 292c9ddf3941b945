//! Skin weights: how much each vertex follows the particles around it.
//!
//! Candidates are the particles nearest *along the body*, so that nothing bleeds from one limb to the next. A candidate's distance is
//! its ellipsoid distance, stretched by the detour the body makes. With d₅ the fifth smallest distance the weight is (1 − d/d₅)²: at
//! most four are left, and where the fifth overtakes the fourth both have weight zero, so weights don't jump between neighbouring
//! vertices.

use glam::DVec3;

use crate::Influences;
use crate::clean::Surface;
use crate::ellipsoids::Ellipsoid;
use crate::flood::Front;
use crate::sample::Sample;
use crate::voxels::{STEPS, STEPS_A_VOXEL, Voxels};

/// Candidates a voxel. Four are used, a fifth sets the cut, the rest is room for ellipsoids that reach farther than others.
const CANDIDATES: usize = 6;
/// A flood's way is at most this much longer than the straight line where nothing is in the way: √1.5, along (1, 1, 1).
const FLOOD_EXCESS: f64 = 1.23;

/// Rounds of smoothing along the skin, and the distance in voxels at which a neighbour counts half.
const SMOOTHINGS: usize = 4;
const BLUR: f64 = 3.0;

/// At most four particles and their weights, heaviest first.
type Weights = Vec<(u32, f64)>;

/// The candidates of a voxel, in no order; a free place is infinitely far.
#[derive(Clone, Copy)]
struct Candidates {
    particles: [u32; CANDIDATES],
    /// Along the body, in steps.
    distances: [u32; CANDIDATES],
}

impl Candidates {
    /// Takes a particle in, or its shorter distance, and forgets the farthest for it; false if it is not among the nearest.
    fn offer(&mut self, particle: u32, distance: u32) -> bool {
        let known = (0..CANDIDATES).find(|&i| self.particles[i] == particle);
        let farthest = || (0..CANDIDATES).max_by_key(|&i| self.distances[i]).unwrap_or(0);
        let place = known.unwrap_or_else(farthest);
        let better = distance < self.distances[place];
        if better {
            self.particles[place] = particle;
            self.distances[place] = distance;
        }
        better
    }

    fn holds(&self, particle: u32, distance: u32) -> bool {
        (0..CANDIDATES).any(|i| self.particles[i] == particle && self.distances[i] == distance)
    }
}

/// The influences of every vertex of the mesh (welded vertices share theirs).
pub(crate) fn weigh(surface: &Surface, voxels: &Voxels, sample: &Sample, ellipsoids: &[Ellipsoid]) -> Vec<Influences> {
    let candidates = candidates(voxels, sample);
    let normals = mitres(surface);
    let mut weights: Vec<Weights> = surface
        .positions
        .iter()
        .zip(normals)
        .map(|(&point, normal)| {
            let voxel = voxels.under(point, normal);
            nearest(voxels, &candidates[voxel as usize], ellipsoids, point)
        })
        .collect();
    for _ in 0..SMOOTHINGS {
        weights = smooth(surface, &weights, BLUR * voxels.size);
    }
    let influences: Vec<Influences> = weights.iter().map(|w| Influences::new(w)).collect();
    surface.welded.iter().map(|&v| influences[v as usize]).collect()
}

/// The outward direction at every vertex, longer at a corner: a step against it goes as deep below each of the vertex's triangles as a
/// step against their own normals. At most three times as long, for where a fold has no such depth.
fn mitres(surface: &Surface) -> Vec<DVec3> {
    let faces = surface.normals();
    let mut normals = vec![DVec3::ZERO; surface.positions.len()];
    for (t, face) in faces.iter().enumerate() {
        let [a, b, c] = surface.corners(t);
        for v in surface.triangles[t] {
            normals[v as usize] += face * (b - a).cross(c - a).length();
        }
    }
    let mut slant = vec![1.0_f64; normals.len()];
    normals.iter_mut().for_each(|n| *n = n.normalize_or_zero());
    for (triangle, face) in surface.triangles.iter().zip(&faces) {
        for &v in triangle {
            slant[v as usize] = slant[v as usize].min(normals[v as usize].dot(*face));
        }
    }
    normals.iter().zip(slant).map(|(normal, slant)| *normal / slant.max(1.0 / 3.0)).collect()
}

/// Floods from all particles at once until every voxel knows its nearest ones.
fn candidates(voxels: &Voxels, sample: &Sample) -> Vec<Candidates> {
    let none = Candidates { particles: [u32::MAX; CANDIDATES], distances: [u32::MAX; CANDIDATES] };
    let mut known = vec![none; voxels.len()];
    let mut front = Front::new();
    for (particle, &voxel) in (0..).zip(&sample.voxel) {
        known[voxel as usize].offer(particle, 0);
        front.push(0, (voxel, particle));
    }
    while let Some((distance, (voxel, particle))) = front.pop() {
        if !known[voxel as usize].holds(particle, distance) {
            continue;
        }
        // Well inside, steps over faces and edges lead everywhere; saving the corners saves a third of the time.
        let deep = voxels.neighbours(voxel).len() == 26;
        let steps = voxels.neighbours(voxel).filter(|&(_, step)| !deep || step < STEPS[2]);
        for (next, step) in steps {
            if known[next as usize].offer(particle, distance + step) {
                front.push(distance + step, (next, particle));
            }
        }
    }
    known
}

/// The weights of the four nearest particles, heaviest first.
fn nearest(voxels: &Voxels, candidates: &Candidates, ellipsoids: &[Ellipsoid], point: DVec3) -> Weights {
    let known = candidates.particles.iter().zip(&candidates.distances);
    let mut distances: Vec<(u32, f64)> = known
        .filter(|&(_, &steps)| steps != u32::MAX)
        .map(|(&particle, &steps)| {
            let ellipsoid = &ellipsoids[particle as usize];
            let straight = point.distance(ellipsoid.centre).max(voxels.size);
            let along = f64::from(steps) / STEPS_A_VOXEL * voxels.size;
            let detour = (along / (FLOOD_EXCESS * straight)).max(1.0);
            (particle, ellipsoid.distance(point) * detour)
        })
        .collect();
    distances.sort_unstable_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
    // With no fifth to take over nothing has to vanish.
    let cut = match (distances.get(4), distances.last()) {
        (Some(fifth), _) => fifth.1,
        (None, Some(last)) => last.1 * 1.5,
        (None, None) => 1.0,
    };
    distances.truncate(4);
    for (_, weight) in &mut distances {
        let near = (1.0 - *weight / cut).max(0.0);
        *weight = near * near;
    }
    normalize(distances)
}

/// Mixes the weights of every vertex with those of its neighbours on the skin, the less the further they are. Where many
/// ellipsoids are equally near, the cut at four makes weights change fast; this spreads the change over a few triangles.
fn smooth(surface: &Surface, weights: &[Weights], blur: f64) -> Vec<Weights> {
    let mut mixed: Vec<Weights> = weights.to_vec();
    for t in &surface.triangles {
        for (a, b) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
            let [a, b] = [a as usize, b as usize];
            let apart = surface.positions[a].distance(surface.positions[b]) / blur;
            // A side counts in both its triangles.
            let share = 0.25 / (1.0 + apart * apart);
            mixed[a].extend(weights[b].iter().map(|&(particle, weight)| (particle, share * weight)));
            mixed[b].extend(weights[a].iter().map(|&(particle, weight)| (particle, share * weight)));
        }
    }
    let cut_to_four = |mut mixed: Weights| {
        mixed.sort_by_key(|w| w.0);
        let mut sums: Weights = Vec::new();
        for (particle, weight) in mixed {
            match sums.last_mut() {
                Some(last) if last.0 == particle => last.1 += weight,
                _ => sums.push((particle, weight)),
            }
        }
        sums.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        let fifth = sums.get(4).map_or(0.0, |w| w.1);
        sums.truncate(4);
        sums.iter_mut().for_each(|w| w.1 -= fifth);
        normalize(sums)
    };
    mixed.into_iter().map(cut_to_four).collect()
}

/// Scales weights to sum 1. If all of them vanish, five particles are equally near: then the four that stay share alike.
fn normalize(mut weights: Weights) -> Weights {
    let sum: f64 = weights.iter().map(|w| w.1).sum();
    let share = 1.0 / weights.len().max(1) as f64;
    let degenerate = sum.is_nan() || sum < 1e-12;
    weights.iter_mut().for_each(|w| w.1 = if degenerate { share } else { w.1 / sum });
    weights
}
