//! `polpo completions`: what a shell needs to complete the commands.

use clap::{Command, CommandFactory};
use clap_complete::Shell;

use crate::error::CliError;
use crate::output::print;

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Which shell; write it where that one looks for completions.
    shell: Shell,
}

pub(crate) fn run<Main: CommandFactory>(arguments: &Arguments) -> Result<bool, CliError> {
    let mut command: Command = Main::command();
    let mut script = Vec::new();
    clap_complete::generate(arguments.shell, &mut command, "polpo", &mut script);
    print(&String::from_utf8_lossy(&script))?;
    Ok(true)
}
