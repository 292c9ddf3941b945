//! A body of any number of particles.

use bevy::math::{Quat, Vec3};
use polpo_rig::{MeshHash, Particle, Rig};

use crate::noise::noise;

/// Distance between neighbours \[m\].
pub const SPACING: f32 = 0.02;
/// \[kg/m³\]
pub const DENSITY: f32 = 1000.0;
/// How far a particle is from its place in the lattice at most, along each axis, as a share of the spacing.
const JITTER: f32 = 0.1;

/// A block of nx·ny·nz particles on a jittered cubic lattice about the origin, with an edge to each of up to six neighbours.
pub fn block([nx, ny, nz]: [u32; 3]) -> Rig {
    let index = |x: u32, y: u32, z: u32| (x * ny + y) * nz + z;
    let (mut particles, mut edges) = (Vec::new(), Vec::new());
    for x in 0..nx {
        for y in 0..ny {
            for z in 0..nz {
                let i = index(x, y, z);
                let jitter = noise(i as usize) * JITTER;
                let middle = Vec3::new((nx - 1) as f32, (ny - 1) as f32, (nz - 1) as f32) * 0.5;
                particles.push(Particle {
                    position: (Vec3::new(x as f32, y as f32, z as f32) - middle + jitter) * SPACING,
                    frame: Quat::IDENTITY,
                    radii: Vec3::new(0.5, 0.45, 0.4) * SPACING,
                    mass: DENSITY * SPACING.powi(3),
                });
                let ahead = [(x + 1 < nx, [1, 0, 0]), (y + 1 < ny, [0, 1, 0]), (z + 1 < nz, [0, 0, 1])];
                edges.extend(ahead.into_iter().filter(|(inside, _)| *inside).map(|(_, [a, b, c])| [i, index(x + a, y + b, z + c)]));
            }
        }
    }
    edges.sort_unstable();
    Rig { mesh_hash: MeshHash(0), particles, edges, ..Rig::default() }
}
