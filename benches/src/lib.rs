//! What the benches start from. It needs no renderer, so that it is built in minutes.

pub mod block;
pub mod headless;
pub mod kernels;
pub mod measure;
mod noise;
pub mod scalar;

use std::sync::Arc;

use polpo_rig::{Mesh, Rig};

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
