//! Rigs any mesh and drops it: `cargo run --release --example drop -- my_mesh.glb`.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Parser;
use polpo_scenes::{DropScene, Options, run};

/// Rigs a mesh (glb, gltf, obj, ply, stl) and drops it on a floor.
#[derive(Parser)]
struct Arguments {
    /// The mesh.
    mesh: PathBuf,
    /// Particles wanted.
    #[arg(long, default_value_t = 300)]
    particles: usize,
    /// Edges wanted.
    #[arg(long, default_value_t = 750)]
    edges: usize,
    /// Largest side of the body in the scene, in metres.
    #[arg(long, default_value_t = 1.0)]
    size: f32,
    #[command(flatten)]
    options: Options,
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let options = arguments.options;
    let count = options.count.unwrap_or(1);
    match DropScene::new(&arguments.mesh, arguments.particles, arguments.edges, arguments.size, count, options.seed) {
        Ok(scene) => run("drop", &options, |app| {
            app.add_plugins(scene);
        }),
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}
