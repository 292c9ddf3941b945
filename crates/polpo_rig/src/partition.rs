//! The partition of the body into Voronoi cells: what the facets between cells are made for.
//!
//! Sampling measures along the body in steps from voxel to voxel, which makes octagons of circles, and shrinks its cells where the body is thin. Both are fine for where particles lie; but a body strains evenly under an even
//! stress only if facets stand across the lines between particles. So the cells are settled: a voxel goes to the nearest particle by the straight line among those that the voxels around it belong to, so that nothing is
//! handed through the air, and particles move to the middle of what is theirs (Lloyd 1982). How densely they lie stays about as it was.

use std::collections::VecDeque;

use glam::DVec3;

use crate::fill::Fill;
use crate::sample::{Sample, central_voxels};
use crate::voxels::Voxels;

/// Lloyd steps.
const STEPS: usize = 5;

/// Makes Voronoi cells of the cells of `sample`, and centroids of its particles.
pub(crate) fn settle(voxels: &Voxels, fill: &Fill<'_>, sample: &mut Sample) {
    for _ in 0..STEPS {
        hand_over(voxels, &sample.positions, &mut sample.owner);
        move_to_middles(voxels, fill, sample);
    }
    sample.volumes.fill(0);
    for &owner in &sample.owner {
        sample.volumes[owner as usize] += 1;
    }
}

/// Hands voxels on until each belongs to the nearest of the particles that the voxels around it belong to.
fn hand_over(voxels: &Voxels, positions: &[DVec3], owner: &mut [u32]) {
    let differs = |owner: &[u32], v: u32| voxels.neighbours(v).any(|(n, _)| owner[n as usize] != owner[v as usize]);
    let mut waiting: VecDeque<u32> = (0..voxels.len() as u32).filter(|&v| differs(owner, v)).collect();
    let mut waits = vec![false; voxels.len()];
    for &v in &waiting {
        waits[v as usize] = true;
    }
    // Each change brings a voxel nearer to its particle, so this ends.
    while let Some(v) = waiting.pop_front() {
        waits[v as usize] = false;
        let centre = voxels.centre(v);
        let distance = |p: u32| centre.distance_squared(positions[p as usize]);
        let old = owner[v as usize];
        let mut best = (distance(old), old);
        for (n, _) in voxels.neighbours(v) {
            let other = owner[n as usize];
            if other != best.1 && distance(other) < best.0 {
                best = (distance(other), other);
            }
        }
        if best.1 != old {
            owner[v as usize] = best.1;
            for (n, _) in voxels.neighbours(v) {
                if owner[n as usize] != best.1 && !waits[n as usize] {
                    waits[n as usize] = true;
                    waiting.push_back(n);
                }
            }
        }
    }
}

/// Moves particles to the centroids of their cells; where a cell is bent so far that this is not in it, to the voxel next to it.
fn move_to_middles(voxels: &Voxels, fill: &Fill<'_>, sample: &mut Sample) {
    let mut sums = vec![(DVec3::ZERO, 0.0); sample.positions.len()];
    for (&owner, &(share, middle)) in sample.owner.iter().zip(&fill.parts) {
        let (sum, volume) = &mut sums[owner as usize];
        *sum += middle * share;
        *volume += share;
    }
    let centroids: Vec<DVec3> = sums.into_iter().map(|(sum, volume)| sum / volume).collect();
    sample.voxel = central_voxels(voxels, &[], &sample.owner, &centroids);
    for (i, centroid) in centroids.into_iter().enumerate() {
        let within = voxels.at(centroid).is_some_and(|v| sample.owner[v as usize] == i as u32);
        sample.positions[i] = if within { centroid } else { voxels.centre(sample.voxel[i]) };
    }
}
