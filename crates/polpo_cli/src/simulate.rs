//! `polpo simulate --references`: every reference, the worst first.

use std::io::Write;
use std::path::{Path, PathBuf};

use indicatif::{ProgressBar, ProgressStyle};
use polpo_references::{Reference, measurements, table};
use serde::Serialize;

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Measure every reference and print reference, exact value, value reached, relative error, tolerance and setting, the worst first; exit code 1 if one is out of its tolerance.
    #[arg(long, required = true)]
    references: bool,
    /// Only measurements whose name contains NAME, such as `pendulum` or `friction/roll`; may be given several times.
    #[arg(long, value_name = "NAME")]
    only: Vec<String>,
    /// Write the references as JSON to FILE; to standard output in place of the table if it is `-`.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Multiply all tolerances by FACTOR: below 1, to see how much room is left.
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0, value_parser = positive)]
    scale_tolerances: f64,
}

fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if x > 0.0 && x.is_finite() => Ok(x),
        Ok(x) => Err(format!("{x} is not positive and finite")),
        Err(error) => Err(error.to_string()),
    }
}

/// Why the references could not be shown.
#[derive(Debug, thiserror::Error)]
pub(crate) enum SimulateError {
    /// No measurement has such a name.
    #[error("no measurement's name contains `{only}`; there are {names}")]
    Unknown {
        /// What was asked for.
        only: String,
        /// All names.
        names: String,
    },
    /// The JSON could not be written.
    #[error("{path}: {source}", path = path.display())]
    Write {
        /// Where to.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// Standard output is gone.
    #[error("standard output: {0}")]
    Output(#[from] std::io::Error),
}

/// Whether all references hold.
pub(crate) fn run(arguments: &Arguments) -> Result<bool, SimulateError> {
    let mut chosen = measurements();
    for only in &arguments.only {
        if !chosen.iter().any(|m| m.name.contains(only.as_str())) {
            let names: Vec<&str> = chosen.iter().map(|m| m.name).collect();
            return Err(SimulateError::Unknown { only: only.clone(), names: names.join(", ") });
        }
    }
    chosen.retain(|m| arguments.only.is_empty() || arguments.only.iter().any(|only| m.name.contains(only.as_str())));

    // Draws on standard error, and nothing if that is no terminal.
    let progress = ProgressBar::new(chosen.len() as u64);
    if let Ok(style) = ProgressStyle::with_template("{pos:>3}/{len} {wide_bar} {msg}") {
        progress.set_style(style);
    }
    let mut references = Vec::new();
    for measurement in chosen {
        progress.set_message(measurement.name);
        references.extend((measurement.run)());
        progress.inc(1);
    }
    progress.finish_and_clear();
    for reference in &mut references {
        reference.tolerance *= arguments.scale_tolerances;
    }
    references.sort_by(|a, b| b.share().total_cmp(&a.share()));

    let mut stdout = std::io::stdout().lock();
    match &arguments.json {
        Some(path) if path == Path::new("-") => writeln!(stdout, "{}", json(&references)?)?,
        Some(path) => {
            std::fs::write(path, json(&references)? + "\n").map_err(|source| SimulateError::Write { path: path.clone(), source })?;
            write!(stdout, "{}", table(&references))?;
        }
        None => write!(stdout, "{}", table(&references))?,
    }
    Ok(references.iter().all(Reference::holds))
}

/// A reference as it stands in the JSON. Numbers that are none become `null`.
#[derive(Serialize)]
struct Line<'a> {
    name: &'a str,
    source: &'a str,
    setting: &'a str,
    exact: f64,
    got: f64,
    relative_error: f64,
    tolerance: f64,
    reason: &'a str,
    holds: bool,
}

fn json(references: &[Reference]) -> Result<String, std::io::Error> {
    let lines: Vec<Line> = references
        .iter()
        .map(|r| Line {
            name: &r.name,
            source: r.source,
            setting: &r.setting,
            exact: r.exact,
            got: r.got,
            relative_error: r.error(),
            tolerance: r.tolerance,
            reason: r.reason,
            holds: r.holds(),
        })
        .collect();
    Ok(serde_json::to_string_pretty(&lines)?)
}
