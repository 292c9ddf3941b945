//! The command line of Polpo, one file a command.
//!
//! Exit codes: 0 all is well, 1 a check failed, 2 the command could not be done.

mod simulate;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// Soft bodies of oriented particles.
#[derive(Parser)]
#[command(name = "polpo", version)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Run the solver without a scene.
    Simulate(simulate::Arguments),
}

fn main() -> ExitCode {
    let done = match Arguments::parse().command {
        Command::Simulate(arguments) => simulate::run(&arguments),
    };
    match done {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::from(1),
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(2)
        }
    }
}
