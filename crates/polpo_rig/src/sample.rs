//! Particles: a centroidal Voronoi clustering of the body's voxels (Lloyd 1982), with distances along the body.
//!
//! In a limb thinner than the spacing the cells become slices and their centres lie on the medial axis; in a thick part they fill
//! the volume. They are denser where the body is thin, see [`thickness`].

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use glam::DVec3;

use crate::flood::Cells;
use crate::thickness;
use crate::voxels::Voxels;

/// Lloyd steps. After a dozen the cells barely change.
const LLOYD_STEPS: usize = 12;

/// The particles and the voxels each one stands for.
pub(crate) struct Sample {
    /// Centre of every particle, in the unit box, within its cell.
    pub(crate) positions: Vec<DVec3>,
    /// Voxels in every cell, at least one.
    pub(crate) volumes: Vec<u32>,
    /// The particle that owns each voxel.
    pub(crate) owner: Vec<u32>,
    /// The voxel each particle lies in.
    #[allow(dead_code, reason = "edits start from it")]
    pub(crate) voxel: Vec<u32>,
}

impl Sample {
    /// Spreads `wanted` particles over the body; more only if it has more parts than that, since every part gets one.
    pub(crate) fn new(voxels: &Voxels, wanted: usize) -> Sample {
        let weights = thickness::weights(voxels);
        let mut seeds = spread(voxels, &weights, wanted);
        let mut cells = Cells::new(voxels);
        for _ in 0..LLOYD_STEPS {
            cells = Cells::new(voxels);
            cells.flood(voxels, &weights, &seeds, 0);
            let moved = central_voxels(voxels, &cells.owner, &centroids(voxels, &cells.owner, seeds.len()).0);
            if moved == seeds {
                break;
            }
            seeds = moved;
        }
        let owner = cells.owner;
        let (centroids, volumes) = centroids(voxels, &owner, seeds.len());
        let voxel = central_voxels(voxels, &owner, &centroids);
        let positions = (0..seeds.len()).map(|i| {
            let within = voxels.at(centroids[i]).is_some_and(|v| owner[v as usize] == i as u32);
            if within { centroids[i] } else { voxels.centre(voxel[i]) }
        });
        Sample { positions: positions.collect(), volumes, voxel, owner }
    }
}

/// Where the particles start: one in every part, then always the voxel that is farthest from all of them.
fn spread(voxels: &Voxels, weights: &[u32], wanted: usize) -> Vec<u32> {
    let mut seeds = voxels.parts();
    let mut cells = Cells::new(voxels);
    cells.flood(voxels, weights, &seeds, 0);
    // Distances only shrink, so an entry that is out of date can wait until it comes up.
    let mut farthest: BinaryHeap<(u32, Reverse<u32>)> =
        (0..voxels.len() as u32).map(|v| (cells.distance[v as usize], Reverse(v))).collect();
    while seeds.len() < wanted {
        let Some((distance, Reverse(voxel))) = farthest.pop() else { break };
        let now = cells.distance[voxel as usize];
        if now < distance {
            farthest.push((now, Reverse(voxel)));
        } else if now > 0 {
            cells.flood(voxels, weights, &[voxel], seeds.len() as u32);
            seeds.push(voxel);
        }
    }
    seeds
}

/// Centre and number of the voxels of every cell.
fn centroids(voxels: &Voxels, owner: &[u32], count: usize) -> (Vec<DVec3>, Vec<u32>) {
    let mut sums = vec![DVec3::ZERO; count];
    let mut volumes = vec![0; count];
    for (voxel, &cell) in owner.iter().enumerate() {
        sums[cell as usize] += voxels.centre(voxel as u32);
        volumes[cell as usize] += 1;
    }
    for (sum, &volume) in sums.iter_mut().zip(&volumes) {
        *sum /= f64::from(volume);
    }
    (sums, volumes)
}

/// The voxel of every cell that is nearest to its centre.
fn central_voxels(voxels: &Voxels, owner: &[u32], centres: &[DVec3]) -> Vec<u32> {
    let mut nearest = vec![(f64::INFINITY, 0); centres.len()];
    for (voxel, &cell) in owner.iter().enumerate() {
        let distance = voxels.centre(voxel as u32).distance_squared(centres[cell as usize]);
        if distance < nearest[cell as usize].0 {
            nearest[cell as usize] = (distance, voxel as u32);
        }
    }
    nearest.into_iter().map(|(_, voxel)| voxel).collect()
}
