//! How thick the body is at every voxel, and how finely it wants to be sampled there.
//!
//! Particles are for bending: a thin arm needs them close together, a thick mantle doesn't. The spacing follows the cube root of
//! the thickness, down to a third of the widest.

use crate::flood::{Cells, Front};
use crate::voxels::{STEPS_A_VOXEL, Voxels};

/// A deep voxel vouches for the thickness this many times its depth around it. √3 reaches the corners of a cube from its middle, so
/// that they don't pass for thin.
const REACH: f64 = 1.8;
/// Weights are in 1/16; 16 where the body is thickest.
pub(crate) const UNIT: u32 = 16;
pub(crate) const HEAVIEST: u32 = 3 * UNIT;

/// The weight of every voxel: distances through it count `weight / UNIT` times, so cells become smaller by that factor.
pub(crate) fn weights(voxels: &Voxels) -> Vec<u32> {
    let thickness = thickness(voxels);
    let thickest = thickness.iter().copied().max().unwrap_or(1);
    let weight = |t: u32| {
        let factor = libm::cbrt(f64::from(thickest) / f64::from(t));
        ((f64::from(UNIT) * factor) as u32).min(HEAVIEST)
    };
    thickness.into_iter().map(weight).collect()
}

/// For every voxel the depth, in steps, of the deepest one that vouches for it. At least half a voxel.
fn thickness(voxels: &Voxels) -> Vec<u32> {
    let all = 0..voxels.len() as u32;
    let skin: Vec<u32> = all.clone().filter(|&v| voxels.neighbours(v).len() < 26).collect();
    let mut cells = Cells::new(voxels);
    cells.flood(voxels, &vec![UNIT; voxels.len()], &skin, 0);
    // Seen from the skin itself; a body without skin has no voxels.
    let depth: Vec<u32> = cells.distance.into_iter().map(|d| d.saturating_add(STEPS_A_VOXEL as u32 / 2)).collect();

    let mut deepest_first: Vec<u32> = all.collect();
    deepest_first.sort_by_key(|&v| std::cmp::Reverse(depth[v as usize]));
    let mut thickness = vec![0; voxels.len()];
    let mut front = Front::new();
    for sources in deepest_first.chunk_by(|&a, &b| depth[a as usize] == depth[b as usize]) {
        let own = depth[sources[0] as usize];
        for &v in sources {
            thickness[v as usize] = thickness[v as usize].max(own);
            front.push(0, v);
        }
        while let Some((distance, voxel)) = front.pop() {
            for (next, step) in voxels.neighbours(voxel) {
                let there = distance + step;
                if thickness[next as usize] == 0 && f64::from(there) <= REACH * f64::from(own) {
                    thickness[next as usize] = own;
                    front.push(there, next);
                }
            }
        }
    }
    thickness
}
