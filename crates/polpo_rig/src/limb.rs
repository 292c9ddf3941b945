//! The limb: whether the body is one straight, slender limb of about the same section all along, and which.

use core::f64::consts::PI;

use glam::{DMat3, DVec3};

use crate::ellipsoids::{eigen, outer};
use crate::fill::Fill;

/// Slices across the body; those at its ends are left out, which may be round.
const SLICES: usize = 24;
/// Lengths a limb is at least as long as it is thick (the side of a square of its section).
const SLENDER: f64 = 6.0;
/// How far its middle may be from a straight line, in thicknesses.
const BENT: f64 = 0.2;
/// By how much the area of a slice may differ from the mean, as a share.
const UNEVEN: f64 = 0.2;
/// By how much the two moments of a section may differ, as a factor.
const FLAT: f64 = 1.5;
/// ∫r² dA of a section, in its area squared: 0.159 is a circle, 0.167 a square; a cross or two strands are more.
const LOOSE: f64 = 0.2;

/// A slender body's direction and section, in the unit box.
pub(crate) struct Bar {
    pub(crate) axis: DVec3,
    pub(crate) length: f64,
    pub(crate) area: f64,
    /// Second moment of area about an axis across.
    pub(crate) bending: f64,
    /// Torsion constant, by Saint-Venant's estimate 0.95·A⁴/(4π²·I_p), at most I_p.
    pub(crate) torsion: f64,
}

/// The bar that the body is, if it is one.
pub(crate) fn find(fill: &Fill<'_>) -> Option<Bar> {
    let size = fill.voxels.size;
    let volume: f64 = fill.parts.iter().map(|p| p.0).sum();
    let middle = fill.parts.iter().fold(DVec3::ZERO, |sum, (share, x)| sum + *x * *share) / volume;
    let spread = fill.parts.iter().fold(DMat3::ZERO, |sum, (share, x)| sum + outer(*x - middle) * *share);
    let (frame, variances) = eigen(spread);
    let longest = (0..3).max_by(|&a, &b| variances[a].total_cmp(&variances[b]))?;
    let axis = frame.col(longest);
    let (u, v) = axis.any_orthonormal_pair();

    let along = |x: DVec3| (x - middle).dot(axis);
    let (low, high) =
        fill.parts.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), p| (low.min(along(p.1)), high.max(along(p.1))));
    let length = high - low + size;
    let cube = size * size * size;
    let thick = length / SLICES as f64;
    // Area, first and second moments across.
    let mut slices = [[0.0; 6]; SLICES];
    for &(share, x) in &fill.parts {
        let at = (((along(x) - low + 0.5 * size) / thick) as usize).min(SLICES - 1);
        let (y, z, area) = ((x - middle).dot(u), (x - middle).dot(v), share * cube / thick);
        for (sum, term) in slices[at].iter_mut().zip([1.0, y, z, y * y, z * z, y * z]) {
            *sum += area * term;
        }
    }
    let slices = &slices[1..SLICES - 1];
    let mean = |k: usize| slices.iter().map(|s| s[k]).sum::<f64>() / slices.len() as f64;
    let area = mean(0);
    let side = area.sqrt();
    if length < SLENDER * side {
        return None;
    }
    let mut bending = 0.0;
    for s in slices {
        let (y, z) = (s[1] / s[0], s[2] / s[0]);
        let off = (y * y + z * z).sqrt();
        let own = s[0] * size * size / 12.0;
        let (yy, zz, yz) = (s[3] - s[0] * y * y + own, s[4] - s[0] * z * z + own, s[5] - s[0] * y * z);
        let (half, radius) = (0.5 * (yy + zz), (0.25 * (yy - zz) * (yy - zz) + yz * yz).sqrt());
        let even = (s[0] - area).abs() <= UNEVEN * area && off <= BENT * side;
        let round = half + radius <= FLAT * (half - radius) && 2.0 * half <= LOOSE * s[0] * s[0];
        if !(even && round) {
            return None;
        }
        bending += half / slices.len() as f64;
    }
    let polar = 2.0 * bending;
    let torsion = (0.95 / (4.0 * PI * PI) * area * area * area * area / polar).min(polar);
    Some(Bar { axis, length, area, bending, torsion })
}
