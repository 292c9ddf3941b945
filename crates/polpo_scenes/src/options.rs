//! The flags that every example takes.

use std::path::PathBuf;

use bevy::asset::{AssetPlugin, UnapprovedPathMode};
use clap::Args;

/// Flags shared by all examples.
#[derive(Args, Debug, Clone, PartialEq)]
pub struct Options {
    /// Without a window: simulate as fast as the machine can, print timings, exit.
    #[arg(long)]
    pub headless: bool,
    /// Simulated time after which the example exits, in seconds; 6 without a window, for ever with one.
    #[arg(long, value_name = "S", value_parser = positive)]
    pub seconds: Option<f32>,
    /// How many bodies; the scene has a number of its own.
    #[arg(long, value_name = "N")]
    pub count: Option<usize>,
    /// Substeps a step; the plugin's default if not given.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub substeps: Option<u32>,
    /// Sweeps over the constraints a substep; the plugin's default if not given.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub iterations: Option<u32>,
    /// Threads that simulate; as many as the machine has if not given.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=256))]
    pub threads: Option<u32>,
    /// What differs from run to run in the scene.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// Writes the last frame here.
    #[arg(long, value_name = "FILE")]
    pub png: Option<PathBuf>,
    /// Writes frames into this folder as 00000.png, 00001.png, …
    #[arg(long, value_name = "DIR")]
    pub frames: Option<PathBuf>,
    /// With --frames: one frame every N steps.
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u32).range(1..))]
    pub every: u32,
    /// Writes figures about the run here, as JSON.
    #[arg(long, value_name = "FILE")]
    pub stats: Option<PathBuf>,
    /// The folder that the scene's assets are in; Bevy's own choice if not given.
    #[arg(skip)]
    pub assets: Option<PathBuf>,
}

impl Options {
    /// Bevy's assets. Whoever names a folder, named it on the command line, and may name files outside.
    pub(crate) fn asset_plugin(&self) -> AssetPlugin {
        match &self.assets {
            None => AssetPlugin::default(),
            Some(folder) => AssetPlugin {
                file_path: folder.display().to_string(),
                unapproved_path_mode: UnapprovedPathMode::Allow,
                ..AssetPlugin::default()
            },
        }
    }
}

fn positive(text: &str) -> Result<f32, String> {
    match text.parse::<f32>() {
        Ok(s) if s.is_finite() && s > 0.0 && s <= 1e6 => Ok(s),
        Ok(s) => Err(format!("{s} is not a duration between 0 and 1,000,000 seconds")),
        Err(error) => Err(error.to_string()),
    }
}
