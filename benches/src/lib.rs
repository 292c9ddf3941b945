//! What the benches start from. It needs no renderer, so that it is built in minutes.

pub mod block;
pub mod headless;
pub mod kernels;
pub mod measure;
mod noise;
pub mod scalar;

use std::sync::Arc;

use bevy::math::{Quat, Vec3};
use polpo_rig::{Mesh, Particle, Rig};

/// The octopus that comes with the project: its mesh and its rig.
///
/// # Panics
///
/// Never: both files are part of the program.
pub fn octopus() -> (Mesh, Arc<Rig>) {
    let mesh = polpo_rig::parse_glb("octopus.glb", include_bytes!("../../assets/octopus.glb"));
    let rig = Rig::from_postcard("octopus.rig", include_bytes!("../../assets/octopus.rig"));
    (mesh.expect("the embedded mesh is whole"), Arc::new(rig.expect("the embedded rig is whole")))
}

/// A cube of `n`³ balls of 10 cm, a little out of their lattice, joined along its axes and face diagonals: 9 edges a particle, less at its faces. It has no skin.
pub fn cube(n: usize) -> Rig {
    const SPACING: f32 = 0.1;
    let index = |[x, y, z]: [usize; 3]| x + n * (y + n * z);
    let mut noise = 1u32;
    let mut shake = || {
        noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (noise >> 8) as f32 / (1 << 24) as f32 - 0.5
    };
    let mut rig = Rig::default();
    for at in (0..n * n * n).map(|i| [i % n, i / n % n, i / n / n]) {
        let cell = Vec3::from(at.map(|x| x as f32 - 0.5 * (n - 1) as f32)) + 0.1 * Vec3::new(shake(), shake(), shake());
        let radii = Vec3::splat(0.5 * SPACING);
        rig.particles.push(Particle { position: cell * SPACING, frame: Quat::IDENTITY, radii, mass: 0.5 });
        for way in [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [1, 0, 1], [0, 1, 1], [1, -1, 0], [1, 0, -1], [0, 1, -1]] {
            let to: [isize; 3] = core::array::from_fn(|k| at[k] as isize + way[k]);
            if to.iter().all(|x| (0..n as isize).contains(x)) {
                let ends = [index(at) as u32, index(to.map(|x| x as usize)) as u32];
                rig.edges.push([ends[0].min(ends[1]), ends[0].max(ends[1])]);
            }
        }
    }
    rig.edges.sort_unstable();
    rig
}
