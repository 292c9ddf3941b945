//! The command line of Polpo, one file a command.

mod completions;
mod draw;
mod drop;
mod error;
mod figures;
mod inspect;
mod number;
mod output;
mod progress;
mod recipe;
mod references;
mod rig;
mod simulate;
mod source;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// Soft bodies of oriented particles: from a mesh to a body.
#[derive(Parser)]
#[command(name = "polpo", version, after_help = "Exit codes: 0 all is well, 1 a check failed, 2 the command could not be done.")]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Make a rig of a mesh.
    #[command(after_help = "Exit codes: 0 the rig was made, 2 it could not be.")]
    Rig(rig::Arguments),
    /// Tell the numbers and faults of a rig or a mesh, and draw it.
    #[command(
        after_help = "Exit codes: 0 all is well, 1 the rig's edges leave it in pieces, 2 a file cannot be read or mesh and rig do not go together."
    )]
    Inspect(inspect::Arguments),
    /// Drop a body on a floor and tell what becomes of it, or run the references.
    #[command(after_help = simulate::EXIT_CODES)]
    Simulate(simulate::Arguments),
    /// Print completions for a shell.
    Completions(completions::Arguments),
}

fn main() -> ExitCode {
    let done = match Arguments::parse().command {
        Command::Rig(arguments) => rig::run(&arguments),
        Command::Inspect(arguments) => inspect::run(&arguments),
        Command::Simulate(arguments) => simulate::run(&arguments),
        Command::Completions(arguments) => completions::run::<Arguments>(&arguments),
    };
    match done {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::from(1),
        Err(error) => {
            use std::io::Write;
            // Nobody may listen there either.
            let _ = writeln!(std::io::stderr(), "error: {}", error::one_line(&error));
            ExitCode::from(2)
        }
    }
}
