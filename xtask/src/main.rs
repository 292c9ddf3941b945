//! Chores of the house, one file a command.

mod assets;
mod beam;
mod ci;
mod glb;
mod instructions;
mod octopus;
mod sheet;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// Chores of the house.
#[derive(Parser)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Make the meshes and rigs in assets/, the same bytes every time.
    Assets(assets::Arguments),
    /// Measure one beam in every way of solving, and write docs/beam.md.
    Beam,
    /// Run what CI runs: formatting, lints, documentation, tests.
    Ci,
    /// Count the kernels' instructions with callgrind, and write benches/instructions.json.
    Instructions(instructions::Arguments),
    /// Rig meshes, drop them on a floor, and lay their pictures side by side into docs/rigs.png.
    Sheet(sheet::Arguments),
}

fn main() -> ExitCode {
    let done = match Arguments::parse().command {
        Command::Assets(arguments) => assets::run(&arguments).map_err(|e| e.to_string()),
        Command::Beam => beam::run().map_err(|e| e.to_string()),
        Command::Ci => ci::run().map_err(|e| e.to_string()),
        Command::Instructions(arguments) => instructions::run(&arguments).map_err(|e| e.to_string()),
        Command::Sheet(arguments) => sheet::run(&arguments).map_err(|e| e.to_string()),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}
