//! The voxels under the skin, and how much of each particle's cell is felt there.
//!
//! Every voxel starts as part of one cell. Then its shares mix with those around it, round by round, by diffusion:
//!
//! ```text
//! w ← (1 − λ)·w + λ·mean of w over the voxel and its neighbours
//! ```
//!
//! Shares stay a partition of unity, change from voxel to voxel by no more than the blur lets them whatever the mesh is, and go along
//! the body only: over the voxels' own links and, where a crease or a thin wall has none, along the skin. A round adds up to ⅔λ to the variance of the blur per axis \[voxels²\]: of the 27 voxels 18 are one away. λ is such that
//! all rounds add [`BLUR`]·h²/12 in a cell of width h. A box of that width has h²/12, so a blur of 1 would make linear B-splines of the
//! cells and one of 2 quadratic ones.
//!
//! After every round a voxel keeps the n heaviest shares, less the one after them (see [`Mixer::keep`]), with n as for a vertex but not
//! below [`FEWEST`].

use glam::{DMat3, DVec3};

use crate::clean::Surface;
use crate::ellipsoids::volume_covariances;
use crate::grid::pieces;
use crate::recipe::MOST_INFLUENCES;
use crate::sample::Sample;
use crate::voxels::Voxels;

/// Variance that the blur adds to a cell's own. More is smoother, but with four influences there is more to cut.
const BLUR: f64 = 1.5;
/// Variance a round adds \[voxels²\].
const SPREAD: f64 = 2.0 / 3.0;
/// More rounds than this would cost seconds: where a cell is wider than 23 voxels shares change within less than its width.
const ROUNDS: f64 = 100.0;
/// As many neighbours does one count for that only the skin leads to: all those on one side of a voxel.
const SEAM: usize = 9;
/// Layers of voxels around those right under the skin.
const LAYERS: usize = 2;
/// Shares a voxel keeps at least: with one or two the cells' borders would straighten round by round, and small cells vanish.
const FEWEST: usize = 3;
/// Lighter shares are forgotten.
const LIGHTEST: f32 = 1e-4;

const NONE: u32 = u32::MAX;

/// Shares of particles, with sum 1, heaviest first.
#[derive(Clone, Copy)]
pub(crate) struct Shares {
    count: u32,
    particles: [u32; MOST_INFLUENCES],
    shares: [f32; MOST_INFLUENCES],
}

impl Shares {
    pub(crate) fn whole(particle: u32) -> Shares {
        Shares { count: 1, particles: [particle; MOST_INFLUENCES], shares: [1.0; MOST_INFLUENCES] }
    }

    fn is_whole(&self, particle: u32) -> bool {
        self.count == 1 && self.particles[0] == particle
    }

    /// Half the sum of all differences: 0 for the same shares, 1 for other particles.
    pub(crate) fn change(&self, other: &Shares) -> f32 {
        let of = |shares: &Shares, particle| shares.iter().find(|s| s.0 == particle).map_or(0.0, |s| s.1);
        let ours = self.iter().map(|(particle, share)| (share - of(other, particle)).max(0.0)).sum::<f32>();
        let theirs = other.iter().map(|(particle, share)| (share - of(self, particle)).max(0.0)).sum::<f32>();
        0.5 * (ours + theirs)
    }

    /// The particles with their shares, heaviest first.
    pub(crate) fn iter(&self) -> impl Iterator<Item = (u32, f32)> {
        self.particles.into_iter().zip(self.shares).take(self.count as usize)
    }
}

/// Sums up shares.
pub(crate) struct Mixer {
    /// One a particle; 0 for all that are not listed.
    sums: Vec<f32>,
    listed: Vec<(u32, f32)>,
    /// As many shares as are kept.
    most: usize,
}

impl Mixer {
    /// For so many particles, of which `most` are kept.
    pub(crate) fn new(particles: usize, most: usize) -> Mixer {
        Mixer { sums: vec![0.0; particles], listed: Vec::new(), most }
    }

    pub(crate) fn add(&mut self, shares: &Shares, times: f32) {
        for (particle, share) in shares.iter() {
            let sum = &mut self.sums[particle as usize];
            if *sum == 0.0 {
                self.listed.push((particle, 0.0));
            }
            *sum += times * share;
        }
    }

    /// The heaviest of the sums, each by how much it is heavier than the first one not kept, and starts anew.
    ///
    /// So a particle has no share left when another takes its place, and shares don't jump. If all weigh the same they share alike; there
    /// they do jump, but it takes one particle more than are kept in one place: with one influence at all sides of a cell, with two at its
    /// corners.
    pub(crate) fn keep(&mut self) -> Shares {
        for (particle, sum) in &mut self.listed {
            *sum = core::mem::take(&mut self.sums[*particle as usize]);
        }
        let listed = &mut self.listed;
        listed.sort_unstable_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        let next = listed.get(self.most).map_or(0.0, |l| l.1);
        let kept = listed.iter().take(self.most).take_while(|l| l.1 - next >= LIGHTEST).count();
        let sum: f32 = listed[..kept].iter().map(|l| l.1 - next).sum();
        let mut shares = Shares::whole(listed.first().map_or(0, |l| l.0));
        if kept == 0 {
            let alike = listed.len().min(self.most);
            shares.count = alike.max(1) as u32;
            for (slot, &(particle, _)) in listed[..alike].iter().enumerate() {
                (shares.particles[slot], shares.shares[slot]) = (particle, 1.0 / alike as f32);
            }
        } else {
            shares.count = kept as u32;
            for (slot, &(particle, share)) in listed[..kept].iter().enumerate() {
                (shares.particles[slot], shares.shares[slot]) = (particle, (share - next) / sum);
            }
        }
        listed.clear();
        shares
    }
}

/// The voxels under the skin.
pub(crate) struct Shell {
    /// Its place in the shell, for every voxel of the body, or `NONE`.
    place: Vec<u32>,
    shares: Vec<Shares>,
    /// Pairs of voxels that the skin joins and the voxels' links don't, both ways, sorted.
    seams: Vec<(u32, u32)>,
    /// Of the particles' cells, along their longer axes.
    pub(crate) widths: Vec<f64>,
}

impl Shell {
    /// Mixes shares under the whole of a surface, for vertices that follow `most` particles; `normals` are those at the vertices.
    pub(crate) fn new(surface: &Surface, voxels: &Voxels, sample: &Sample, normals: &[DVec3], most: usize) -> Shell {
        let (members, seams) = under_skin(surface, voxels, normals);
        let mut place = vec![NONE; voxels.len()];
        for (at, &voxel) in (0..).zip(&members) {
            place[voxel as usize] = at;
        }
        let owner = |voxel: u32| sample.owner[voxel as usize];
        // How many whole rounds each cell takes.
        let unit = BLUR / (12.0 * SPREAD * voxels.size * voxels.size);
        let widths: Vec<f64> = volume_covariances(voxels, sample).into_iter().map(|c| width_squared(c).sqrt()).collect();
        let wanted: Vec<f64> = widths.iter().map(|width| unit * width * width).collect();
        let rounds = members.iter().map(|&v| wanted[owner(v) as usize]).fold(0.0, f64::max).ceil().clamp(1.0, ROUNDS);
        let mixing: Vec<f32> = wanted.iter().map(|w| (w / rounds).min(1.0) as f32).collect();

        let mut mixer = Mixer::new(sample.positions.len(), most.max(FEWEST));
        let mut shell = Shell { place, shares: members.iter().map(|&voxel| Shares::whole(owner(voxel))).collect(), seams, widths };
        let mut mixed = shell.shares.clone();
        for _ in 0..rounds as usize {
            for ((mixed, own), &voxel) in mixed.iter_mut().zip(&shell.shares).zip(&members) {
                let around = || shell.around(voxels, voxel).flat_map(|(_, s, times)| core::iter::repeat_n(s, times));
                if own.count == 1 && around().all(|s| s.is_whole(own.particles[0])) {
                    *mixed = *own;
                    continue;
                }
                let mixing = mixing[owner(voxel) as usize];
                let each = mixing / (1 + around().count()) as f32;
                mixer.add(own, 1.0 - mixing + each);
                around().for_each(|s| mixer.add(s, each));
                *mixed = mixer.keep();
            }
            core::mem::swap(&mut shell.shares, &mut mixed);
        }
        shell
    }

    /// The shares at a voxel, if it is in the shell.
    pub(crate) fn at(&self, voxel: u32) -> Option<&Shares> {
        self.shares.get(self.place[voxel as usize] as usize)
    }

    /// The voxels in the shell that a voxel leads to, by the body or the skin, with their shares and how many times each counts.
    pub(crate) fn around(&self, voxels: &Voxels, voxel: u32) -> impl Iterator<Item = (u32, &Shares, usize)> {
        let from = self.seams.partition_point(|seam| seam.0 < voxel);
        let seams = self.seams[from..].iter().take_while(move |seam| seam.0 == voxel).map(|seam| (seam.1, SEAM));
        let linked = voxels.neighbours(voxel).map(|next| (next.0, 1));
        linked.chain(seams).filter_map(|(next, times)| Some((next, self.at(next)?, times)))
    }
}

/// The voxels right under the skin and some layers around them, in order; and the pairs that the skin joins and no link does.
fn under_skin(surface: &Surface, voxels: &Voxels, normals: &[DVec3]) -> (Vec<u32>, Vec<(u32, u32)>) {
    let mut taken = vec![false; voxels.len()];
    let mut seams = Vec::new();
    let mut join = |a: u32, b: u32| {
        if a != b && !voxels.neighbours(a).any(|next| next.0 == b) {
            seams.extend([(a, b), (b, a)]);
        }
    };
    for (t, &normal) in surface.normals().iter().enumerate() {
        pieces(surface.corners(t), 0.7 * voxels.size, |middle, _| taken[voxels.under(middle, normal) as usize] = true);
        let [a, b, c] = surface.triangles[t].map(|v| v as usize);
        for (a, b) in [(a, b), (b, c), (c, a)] {
            // Normals between two that go deep enough below a triangle do so too, and miss what is beyond a thin gap.
            let (from, to) = (surface.positions[a], surface.positions[b]);
            let steps = (from.distance(to) / (0.7 * voxels.size)).ceil().max(1.0) as u32;
            let mut before = None;
            for step in 0..=steps {
                let s = f64::from(step) / f64::from(steps);
                let voxel = voxels.under(from.lerp(to, s), normals[a].lerp(normals[b], s));
                taken[voxel as usize] = true;
                if let Some(before) = before.replace(voxel) {
                    join(before, voxel);
                }
            }
        }
    }
    seams.sort_unstable();
    seams.dedup();
    let mut members: Vec<u32> = (0..voxels.len() as u32).filter(|&v| taken[v as usize]).collect();
    let mut done = 0;
    for _ in 0..LAYERS {
        let end = members.len();
        for at in done..end {
            for (next, _) in voxels.neighbours(members[at]) {
                if !core::mem::replace(&mut taken[next as usize], true) {
                    members.push(next);
                }
            }
        }
        done = end;
    }
    members.sort_unstable();
    (members, seams)
}

/// The square of a cell's width along its longer axes: 12·Σσ⁴/Σσ², with σ² the variances along its principal axes. A cube of side h has
/// h²; so have a sheet's and a rod's cell, however thin.
fn width_squared(covariance: DMat3) -> f64 {
    let squares = covariance.to_cols_array().iter().map(|x| x * x).sum::<f64>();
    12.0 * squares / (covariance.x_axis.x + covariance.y_axis.y + covariance.z_axis.z)
}
