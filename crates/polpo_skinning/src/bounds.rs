//! A box around the skinned mesh from the particle transforms alone, so that culling needs no vertex.
//!
//! A skinned vertex is a convex combination of the points M_k·x̄ of its influences k. So a box that holds, for every particle, the images of all rest vertices that follow it holds the
//! mesh. Each particle offers two such boxes and the smaller counts, axis by axis:
//!
//! - its rest box [c ± h] of followers, rotated: centre M_k·c, half extents |s·R_k|·h (absolute values entry by entry);
//! - its sphere of radius s·ρ_k about p_k = M_k·p̄_k.
//!
//! The box is the tighter one near the rest pose, the sphere when the box is turned onto its corner. Cost: about 60 flops a particle, no vertex touched. The result is larger than the
//! mesh's true box by at most the followers' spread, since it does not know where between its influences a vertex lies.
//!
//! Rounding: a vertex is summed in f32, so the box is padded by [`PADDING`] of its largest coordinate.

use glam::Vec3;

use crate::{Binding, ParticleTransform};

/// Padding of the box relative to its largest absolute coordinate \[1\]: some ten roundings of f32.
pub const PADDING: f32 = 2e-6;

/// An axis-aligned box \[m\].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aabb {
    /// Smallest coordinates \[m\].
    pub min: Vec3,
    /// Largest coordinates \[m\].
    pub max: Vec3,
}

/// The rest vertices that follow one particle: their box and their distance from it. Empty (no follower) while `min > max`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RestExtent {
    min: Vec3,
    max: Vec3,
    radius_squared: f32,
}

impl RestExtent {
    pub(crate) const NONE: Self = Self { min: Vec3::INFINITY, max: Vec3::NEG_INFINITY, radius_squared: 0.0 };

    pub(crate) fn include(&mut self, vertex: Vec3, particle: Vec3) {
        self.min = self.min.min(vertex);
        self.max = self.max.max(vertex);
        self.radius_squared = self.radius_squared.max(vertex.distance_squared(particle));
    }

    pub(crate) fn radius(&self) -> f32 {
        self.radius_squared.sqrt()
    }

    fn is_empty(&self) -> bool {
        self.min.x > self.max.x
    }
}

/// The box around the mesh of `binding` when its particles are at `transforms` [m, in the space of the transforms' positions].
///
/// `None` if the lengths differ or a transform that moves vertices is not finite: there is no meaningful box then, and the caller keeps its last one.
pub fn skinned_aabb(binding: &Binding, transforms: &[ParticleTransform]) -> Option<Aabb> {
    if transforms.len() != binding.rest_particles().len() {
        return None;
    }
    let mut min = Vec3::INFINITY;
    let mut max = Vec3::NEG_INFINITY;
    let mut finite = true;
    let particles = binding.rest_particles().iter().zip(binding.extents());
    for (transform, (&rest, extent)) in transforms.iter().zip(particles) {
        if extent.is_empty() {
            continue;
        }
        let center = transform.transform_point(0.5 * (extent.min + extent.max));
        let half = 0.5 * (extent.max - extent.min);
        let half = Vec3::from_array(transform.rows.map(|row| row.truncate().abs().dot(half)));
        let position = transform.transform_point(rest);
        let radius = transform.rows[0].truncate().length() * extent.radius();
        // min and max drop NaN silently, so it is looked for on its own.
        finite &= center.is_finite() && half.is_finite() && position.is_finite();
        min = min.min((center - half).max(position - radius));
        max = max.max((center + half).min(position + radius));
    }
    let padding = PADDING * min.abs().max(max.abs()).max_element();
    finite &= padding.is_finite();
    finite.then_some(Aabb { min: min - padding, max: max + padding })
}
