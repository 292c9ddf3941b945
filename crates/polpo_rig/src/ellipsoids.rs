//! Ellipsoids: the principal axes of the skin that belongs to a particle's cell, and how far it reaches along them.
//!
//! Covariance of the surface: C = ∫ (x − x̄)(x − x̄)ᵀ dA / ∫ dA over the triangles, cut into pieces smaller than a voxel. Weighting by
//! area and not by vertices makes it independent of how finely an artist meshed a corner (method, §6). The axes are its
//! eigenvectors; the half axes are the farthest reach of the skin along them, seen from the particle's centre, so that the
//! ellipsoid touches the skin. A cell without skin takes the covariance of its voxels instead: a solid ellipsoid with half axis a has
//! variance a²/5 along it.

use glam::{DMat3, DQuat, DVec3};

use crate::clean::Surface;
use crate::sample::Sample;
use crate::voxels::{Voxels, pieces};

/// No half axis is shorter than this share of the longest.
const FLATTEST: f64 = 0.05;

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
    /// Distance from the centre in units of the radius in that direction: 1 on the ellipsoid.
    pub(crate) fn distance(&self, point: DVec3) -> f64 {
        (self.frame.transpose() * (point - self.centre) / self.radii).length()
    }

    /// The frame as a unit quaternion.
    pub(crate) fn rotation(&self) -> DQuat {
        DQuat::from_mat3(&self.frame).normalize()
    }
}

/// A piece of skin: middle, area.
type Piece = (DVec3, f64);

/// Fits an ellipsoid to every particle.
pub(crate) fn fit(surface: &Surface, voxels: &Voxels, sample: &Sample) -> Vec<Ellipsoid> {
    let count = sample.positions.len();
    let mut skin: Vec<Vec<Piece>> = vec![Vec::new(); count];
    let normals = surface.normals();
    for (t, &normal) in normals.iter().enumerate() {
        pieces(surface.corners(t), 0.7 * voxels.size, |middle, area| {
            let voxel = voxels.under(middle, normal);
            skin[sample.owner[voxel as usize] as usize].push((middle, area));
        });
    }
    let mut volume: Vec<Vec<Piece>> = vec![Vec::new(); count];
    for (voxel, &cell) in sample.owner.iter().enumerate() {
        if skin[cell as usize].is_empty() {
            volume[cell as usize].push((voxels.centre(voxel as u32), 1.0));
        }
    }
    let half_voxel = 0.5 * voxels.size;
    (0..count)
        .map(|i| {
            let centre = sample.positions[i];
            let (frame, radii) = if skin[i].is_empty() {
                let (frame, variances) = principal_axes(&volume[i]);
                (frame, (variances * 5.0).map(f64::sqrt).max(DVec3::splat(half_voxel)))
            } else {
                let (frame, _) = principal_axes(&skin[i]);
                let reach = skin[i].iter().fold(DVec3::ZERO, |reach, (p, _)| reach.max((frame.transpose() * (p - centre)).abs()));
                (frame, reach)
            };
            // A scrap of skin in the very centre of a particle has no reach at all.
            let longest = radii.max_element().max(half_voxel);
            Ellipsoid { centre, frame, radii: radii.max(DVec3::splat(longest * FLATTEST)) }
        })
        .collect()
}

/// Eigenvectors (a rotation, no reflection) and eigenvalues of the pieces' covariance.
fn principal_axes(pieces: &[Piece]) -> (DMat3, DVec3) {
    let total: f64 = pieces.iter().map(|p| p.1).sum();
    let mean = pieces.iter().map(|p| p.0 * p.1).sum::<DVec3>() / total;
    let mut covariance = DMat3::ZERO;
    for &(point, weight) in pieces {
        let d = point - mean;
        covariance += DMat3::from_cols(d * d.x, d * d.y, d * d.z) * (weight / total);
    }
    let (mut frame, values) = eigen(covariance);
    if frame.determinant() < 0.0 {
        frame.z_axis = -frame.z_axis;
    }
    (frame, values.max(DVec3::ZERO))
}

/// Eigenvectors (columns) and eigenvalues of a symmetric matrix: cyclic Jacobi rotations (Golub & Van Loan, §8.5).
///
/// The larger of the two angles that zero an entry is never taken, so equal eigenvalues leave the axes where they are; a zero
/// matrix gives the identity.
fn eigen(mut m: DMat3) -> (DMat3, DVec3) {
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
    (vectors, DVec3::new(m.x_axis.x, m.y_axis.y, m.z_axis.z))
}
