//! The demo scenes, each a plugin in one file, and the harness that every example shares.
//!
//! An example is three lines: parse [`Options`], name the scene, [`run`] it. The harness brings the window or does without, light and camera, the keys, the overlay, the pictures and the
//! figures.

mod any_mesh;
mod controls;
mod drop;
mod headless;
mod noise;
mod octopus;
mod options;
mod outfit;
mod overlay;
mod pictures;
mod props;
mod recorder;
mod run;
mod stage;
mod windowed;

pub use any_mesh::AnyMeshScene;
pub use drop::{DropScene, DropSceneError};
pub use octopus::{OctopusScene, octopus_asset};
pub use options::Options;
pub use outfit::Outfit;
pub use props::{Prop, spawn_prop};
pub use recorder::{Recorder, Stats};
pub use run::{SimulationPlugins, run};
pub use stage::View;
