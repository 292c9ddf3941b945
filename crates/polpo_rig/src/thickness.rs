//! How deep the body is at every voxel, and how thick.

use crate::flood::{Cells, Front, UNIT};
use crate::voxels::{STEPS_A_VOXEL, Voxels};

/// A deep voxel vouches for the thickness this many times its depth around it. √3 reaches the corners of a cube from its middle, so
/// that they don't pass for thin.
const REACH: f64 = 1.8;

/// Depths in steps, at least half a voxel.
pub(crate) struct Thickness {
    /// How far every voxel is from the skin.
    pub(crate) depth: Vec<u32>,
    /// For every voxel the depth of the deepest one that vouches for it.
    pub(crate) thickness: Vec<u32>,
    /// The most of them.
    pub(crate) thickest: u32,
}

impl Thickness {
    pub(crate) fn new(voxels: &Voxels) -> Thickness {
        let all = 0..voxels.len() as u32;
        let skin: Vec<u32> = all.clone().filter(|&v| voxels.is_skin(v)).collect();
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
        let thickest = thickness.iter().copied().max().unwrap_or(1);
        Thickness { depth, thickness, thickest }
    }
}
