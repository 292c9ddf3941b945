//! Octopuses fall down a staircase, are swept by a turning bar, and come to rest.
//!
//! `cargo run --release --example octopus -- --help` lists the flags, the keys stand on the screen.

use std::process::ExitCode;

use clap::Parser;
use polpo_scenes::{OctopusScene, Options, run};

/// Octopuses fall down a staircase.
#[derive(Parser)]
struct Arguments {
    #[command(flatten)]
    options: Options,
}

fn main() -> ExitCode {
    let Arguments { options } = Arguments::parse();
    let scene = OctopusScene { count: options.count.unwrap_or(3), seed: options.seed };
    run("octopus", &options, |app| {
        app.add_plugins(scene);
    })
}
