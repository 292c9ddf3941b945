//! Ellipsoids: the principal axes of the skin that belongs to a particle's cell, and how far it reaches along them.
//!
//! Covariance of the surface: C = ∫ (x − x̄)(x − x̄)ᵀ dA / ∫ dA over the triangles, cut into pieces smaller than a voxel. Weighting by
//! area and not by vertices makes it independent of how finely an artist meshed a corner (method, §6). The axes are its
//! eigenvectors; the half axes are the reach of the skin along them, seen from the particle's centre, so that the ellipsoid touches
//! the skin.
//!
//! A cell with only a scrap of skin would become a needle. So no half axis is shorter than √3σ, with σ² the variance of the cell's
//! volume along it: the half side of a box with that variance, which never sticks out of the cell. A cell without any skin takes
//! axes and half axes from its volume alone: a solid ellipsoid with half axis a has variance a²/5 along it.
//!
//! Particles on the skin are flat along it: there the volume says nothing but how thick one may be at most, and the ellipsoid is
//! moved in until it only touches the skin from below.

use glam::{DMat3, DQuat, DVec3};

use crate::clean::Surface;
use crate::grid::pieces;
use crate::sample::Sample;
use crate::voxels::Voxels;

/// No half axis is shorter than this share of the longest.
const FLATTEST: f64 = 0.05;

/// As thick as this share of its longest half axis is an ellipsoid on the skin, if the body is.
const FLAT: f64 = 0.25;

/// Variances at least this near each other pass for equal; the quarter turn is then tried in so many steps.
const EQUAL: f64 = 0.75;
const TURNS: usize = 16;

/// A particle's shape, in the unit box.
#[derive(Clone, Copy)]
pub(crate) struct Ellipsoid {
    pub(crate) centre: DVec3,
    /// Turns x, y, z into the principal axes.
    pub(crate) frame: DMat3,
    /// Half axes, positive.
    pub(crate) radii: DVec3,
}

impl Ellipsoid {
    /// The frame as a unit quaternion.
    pub(crate) fn rotation(&self) -> DQuat {
        DQuat::from_mat3(&self.frame).normalize()
    }
}

/// A piece of skin: middle, area.
type Piece = (DVec3, f64);

/// Fits an ellipsoid to every particle; flat ones for a `shell`, whose particles lie on the skin.
pub(crate) fn fit(surface: &Surface, voxels: &Voxels, sample: &Sample, shell: bool) -> Vec<Ellipsoid> {
    let mut skin: Vec<Vec<Piece>> = vec![Vec::new(); sample.positions.len()];
    let mut facing = vec![DVec3::ZERO; sample.positions.len()];
    for (t, &normal) in surface.normals().iter().enumerate() {
        pieces(surface.corners(t), 0.7 * voxels.size, |middle, area| {
            let voxel = voxels.under(middle, normal);
            let cell = sample.owner[voxel as usize] as usize;
            skin[cell].push((middle, area));
            facing[cell] += normal * area;
        });
    }
    let volume = volume_covariances(voxels, sample);
    let cells = sample.positions.iter().zip(&skin).zip(&volume).zip(&facing);
    cells
        .map(|(((&centre, skin), &volume), &facing)| {
            let (frame, radii) = if skin.is_empty() {
                let (frame, variances) = eigen(volume);
                (frame, (variances * 5.0).map(f64::sqrt))
            } else {
                let (frame, variances) = eigen(covariance(skin));
                let frame = settle(frame, variances, |axis| reach(skin, centre, axis));
                if shell {
                    return flat(centre, frame, skin, volume, facing);
                }
                let radius = |axis: DVec3| reach(skin, centre, axis).max((3.0 * axis.dot(volume * axis)).sqrt());
                (frame, DVec3::new(radius(frame.x_axis), radius(frame.y_axis), radius(frame.z_axis)))
            };
            Ellipsoid { centre, frame, radii: radii.max(DVec3::splat(radii.max_element() * FLATTEST)) }
        })
        .collect()
}

/// The ellipsoid of a particle on the skin: as wide as its skin, and no thicker than the body is below it.
fn flat(centre: DVec3, frame: DMat3, skin: &[Piece], volume: DMat3, facing: DVec3) -> Ellipsoid {
    let reaches = DVec3::from_array([0, 1, 2].map(|i| reach(skin, centre, frame.col(i))));
    let deepest = DVec3::from_array([0, 1, 2].map(|i| (3.0 * frame.col(i).dot(volume * frame.col(i))).sqrt()));
    let longest = reaches.max_element();
    let radii = reaches.max(deepest.min(DVec3::splat(longest * FLAT))).max(DVec3::splat(longest * FLATTEST));
    let out = facing.normalize_or_zero();
    let area: f64 = skin.iter().map(|p| p.1).sum();
    // Where the cell goes around the body there is no below.
    let one_sided = facing.length() > 0.5 * area;
    let thick = (frame.transpose() * out * radii).length();
    let above = skin.iter().fold(0.0_f64, |most, p| most.max((p.0 - centre).dot(out)));
    let down = if one_sided { (thick - above).max(0.0) } else { 0.0 };
    Ellipsoid { centre: centre - out * down, frame, radii }
}

/// Two axes with about the same variance could point anywhere in their plane, and rounding would decide. Then the pair that makes
/// the smallest box is taken: along the sides of a square bar, not across its corners.
fn settle(mut frame: DMat3, variances: DVec3, reach: impl Fn(DVec3) -> f64) -> DMat3 {
    for (p, q) in [(0, 1), (1, 2), (2, 0)] {
        let (least, most) = (variances[p].min(variances[q]), variances[p].max(variances[q]));
        if least < EQUAL * most {
            continue;
        }
        let (a, b) = (frame.col(p), frame.col(q));
        let turned = |step: usize| {
            let angle = std::f64::consts::FRAC_PI_2 * step as f64 / TURNS as f64;
            let (sin, cos) = (libm::sin(angle), libm::cos(angle));
            (a * cos + b * sin, b * cos - a * sin)
        };
        let area = |(a, b): (DVec3, DVec3)| reach(a) * reach(b);
        let mut best = (area((a, b)), 0);
        for step in 1..TURNS {
            let area = area(turned(step));
            // A round limb has no corners, and keeps its axes.
            if area < 0.98 * best.0 {
                best = (area, step);
            }
        }
        let (a, b) = turned(best.1);
        *frame.col_mut(p) = a;
        *frame.col_mut(q) = b;
    }
    frame
}

/// Covariance of every cell's volume about its particle; positive, since a voxel has an extent of its own.
pub(crate) fn volume_covariances(voxels: &Voxels, sample: &Sample) -> Vec<DMat3> {
    let own = DMat3::from_diagonal(DVec3::splat(voxels.size * voxels.size / 12.0));
    let mut sums = vec![DMat3::ZERO; sample.positions.len()];
    for (voxel, &cell) in sample.owner.iter().enumerate() {
        sums[cell as usize] += outer(voxels.centre(voxel as u32) - sample.positions[cell as usize]);
    }
    sums.iter().zip(&sample.volumes).map(|(sum, &volume)| *sum * (1.0 / f64::from(volume)) + own).collect()
}

/// Area-weighted covariance of pieces of skin.
fn covariance(pieces: &[Piece]) -> DMat3 {
    let area: f64 = pieces.iter().map(|p| p.1).sum();
    let mean = pieces.iter().map(|p| p.0 * p.1).sum::<DVec3>() / area;
    pieces.iter().fold(DMat3::ZERO, |sum, p| sum + outer(p.0 - mean) * (p.1 / area))
}

pub(crate) fn outer(d: DVec3) -> DMat3 {
    DMat3::from_cols(d * d.x, d * d.y, d * d.z)
}

/// How far the skin reaches from a centre along an axis, to either side.
fn reach(skin: &[Piece], centre: DVec3, axis: DVec3) -> f64 {
    skin.iter().fold(0.0, |reach, p| reach.max((p.0 - centre).dot(axis).abs()))
}

/// Eigenvectors (columns of a rotation) and eigenvalues of a symmetric, positive matrix: cyclic Jacobi rotations (Golub & Van Loan, §8.5).
///
/// The larger of the two angles that zero an entry is never taken, so equal eigenvalues leave the axes where they are; a zero
/// matrix gives the identity.
pub(crate) fn eigen(mut m: DMat3) -> (DMat3, DVec3) {
    let mut vectors = DMat3::IDENTITY;
    // Quadratic convergence: five sweeps reach f64, the rest is for luck.
    for _ in 0..12 {
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            let (off, gap) = (m.col(q)[p], m.col(q)[q] - m.col(p)[p]);
            if off == 0.0 {
                continue;
            }
            // t = tan of the angle solves t² + (gap/off) t − 1 = 0.
            let ratio = gap / (2.0 * off);
            let t = if ratio.is_finite() { (1.0_f64).copysign(ratio) / (ratio.abs() + (ratio * ratio + 1.0).sqrt()) } else { 0.0 };
            let cos = 1.0 / (t * t + 1.0).sqrt();
            let sin = t * cos;
            let mut turn = DMat3::IDENTITY;
            turn.col_mut(p)[p] = cos;
            turn.col_mut(q)[q] = cos;
            turn.col_mut(p)[q] = -sin;
            turn.col_mut(q)[p] = sin;
            m = turn.transpose() * m * turn;
            vectors *= turn;
        }
    }
    // Products of rotations are a rotation: no reflection to undo.
    (vectors, DVec3::new(m.x_axis.x, m.y_axis.y, m.z_axis.z).max(DVec3::ZERO))
}
