//! Facets: where the cells of two particles touch, as the faces between their voxels show.
//!
//! A facet across the grid is a staircase. Its faces count by what they show of its own direction n: with the sums over the faces of each axis k, those that face the other way taken off,
//!
//! ```text
//! S_k = Σ a,   n = S/|S|,   c = Σ_k n_k·Σ a·x / |S|,   ∫(x − c)(x − c)ᵀ dA = Σ_k n_k·Σ a·(x − c)(x − c)ᵀ + |S|·s²/12·(1 − nnᵀ)
//! ```
//!
//! where the last term is the extent of a face itself.

use std::collections::BTreeMap;

use glam::{DMat3, DVec3};

use crate::ellipsoids::outer;
use crate::fill::Fill;
use crate::sample::Sample;
use crate::voxels::Voxels;

/// Where two cells touch, in the unit box.
pub(crate) struct Patch {
    /// The particles, the smaller index first.
    pub(crate) pair: [u32; 2],
    /// Vector area, from the first to the second.
    pub(crate) area: DVec3,
    pub(crate) centroid: DVec3,
    /// Second moments of area about the centroid.
    pub(crate) moments: DMat3,
}

/// Faces of one axis: signed area, and its first and second moments about the first particle, in units of a face.
#[derive(Clone, Copy, Default)]
struct Sums {
    area: f64,
    first: DVec3,
    second: DMat3,
}

/// The facets between all cells that touch, sorted by their pairs.
pub(crate) fn between(fill: &Fill<'_>, sample: &Sample) -> Vec<Patch> {
    let owner = |v: u32| sample.owner[v as usize];
    let mut table: BTreeMap<[u32; 2], ([Sums; 3], bool)> = BTreeMap::new();
    fill.faces(
        |a, b| owner(a) != owner(b),
        |ends, axis, place, share, touch| {
            let [a, b] = ends.map(owner);
            let pair = [a.min(b), a.max(b)];
            let share = if a < b { share } else { -share };
            let x = place - sample.positions[pair[0] as usize];
            let (axes, touches) = table.entry(pair).or_insert(([Sums { second: DMat3::ZERO, ..Sums::default() }; 3], false));
            let sums = &mut axes[axis];
            sums.area += share;
            sums.first += x * share;
            sums.second += outer(x) * share;
            *touches |= touch;
        },
    );
    // What only touches where the body reaches into a voxel is beside a corner, or across the air.
    let touching = table.into_iter().filter(|(_, (_, touches))| *touches);
    touching.filter_map(|(pair, (sums, _))| patch(fill.voxels, sample, pair, &sums)).collect()
}

/// `None` for what does not face from one particle to the other: a cell bent around its neighbour.
fn patch(voxels: &Voxels, sample: &Sample, pair: [u32; 2], sums: &[Sums; 3]) -> Option<Patch> {
    let [from, to] = pair.map(|i| sample.positions[i as usize]);
    let faces = DVec3::new(sums[0].area, sums[1].area, sums[2].area);
    let size = faces.length();
    if faces.dot(to - from) <= 1e-3 * size * to.distance(from) {
        return None;
    }
    let normal = faces / size;
    let (mut first, mut second) = (DVec3::ZERO, DMat3::ZERO);
    for (axis, sums) in sums.iter().enumerate() {
        first += sums.first * normal[axis];
        second += sums.second * normal[axis];
    }
    let centroid = first / size;
    let face = voxels.size * voxels.size;
    let own = (DMat3::IDENTITY - outer(normal)) * (size * face / 12.0);
    Some(Patch { pair, area: faces * face, centroid: from + centroid, moments: (second - outer(centroid) * size + own) * face })
}
