//! Any model in its own materials: `cargo run --release --example any_mesh -- my_model.glb`.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Parser;
use polpo_scenes::{AnyMeshScene, Options, run};

/// Makes soft bodies of a model (.glb, .gltf, .obj) and drops them on a floor.
#[derive(Parser)]
struct Arguments {
    /// The model.
    model: PathBuf,
    /// A rig for it (.rig, .rig.ron) or a recipe (.rig.toml); without, the one in the model's file, and if that has none it is rigged at load.
    #[arg(long)]
    rig: Option<PathBuf>,
    /// Particles of a model that is rigged at load without a recipe.
    #[arg(long, default_value_t = 300)]
    particles: usize,
    /// Largest side of a body in the scene, in metres.
    #[arg(long, default_value_t = 1.0)]
    size: f32,
    #[command(flatten)]
    options: Options,
}

fn main() -> ExitCode {
    let Arguments { model, rig, particles, size, options } = Arguments::parse();
    // What lies beside the model (buffers, textures) is found from its folder.
    let full = |path: &Path| std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    let model = full(&model);
    let rig = rig.map(|rig| full(&rig).display().to_string());
    let (Some(folder), Some(file)) = (model.parent(), model.file_name()) else {
        eprintln!("{} is not a file", model.display());
        return ExitCode::FAILURE;
    };
    let scene = AnyMeshScene {
        model: file.to_string_lossy().into_owned(),
        rig,
        particles,
        size,
        count: options.count.unwrap_or(1),
        seed: options.seed,
    };
    let options = Options { assets: Some(folder.to_owned()), ..options };
    run("any_mesh", &options, |app| {
        app.add_plugins(scene);
    })
}
