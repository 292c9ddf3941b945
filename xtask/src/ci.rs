//! `cargo xtask ci`: exactly what CI runs, in the order in which it fails fastest.

use std::process::Command;

struct Step {
    name: &'static str,
    arguments: &'static [&'static str],
    /// What is added to the environment.
    variable: Option<(&'static str, &'static str)>,
}

const STEPS: [Step; 4] = [
    Step { name: "format", arguments: &["fmt", "--all", "--check"], variable: None },
    Step { name: "lint", arguments: &["clippy", "--workspace", "--all-targets", "--", "-D", "warnings"], variable: None },
    Step { name: "document", arguments: &["doc", "--workspace", "--no-deps"], variable: Some(("RUSTDOCFLAGS", "-D warnings")) },
    // The README's test command.
    Step { name: "test", arguments: &["test", "--workspace"], variable: None },
];

/// What stopped CI.
#[derive(Debug, thiserror::Error)]
pub(crate) enum CiError {
    /// A step failed.
    #[error("{step} failed: cargo {command}")]
    Failed {
        /// Which.
        step: &'static str,
        /// Its command line.
        command: String,
    },
    /// Cargo could not be started.
    #[error("{step}: cargo could not be started: {source}")]
    NotStarted {
        /// Which.
        step: &'static str,
        /// Why.
        source: std::io::Error,
    },
}

/// Runs all steps, up to the first that fails.
pub(crate) fn run() -> Result<(), CiError> {
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    for Step { name: step, arguments, variable } in STEPS {
        println!("== {step}: cargo {}", arguments.join(" "));
        let mut command = Command::new(&cargo);
        command.args(arguments);
        if let Some((name, value)) = variable {
            command.env(name, value);
        }
        let status = command.status().map_err(|source| CiError::NotStarted { step, source })?;
        if !status.success() {
            return Err(CiError::Failed { step, command: arguments.join(" ") });
        }
    }
    Ok(())
}
