//! `polpo simulate --references`: every reference, the worst first.

use polpo_references::{Reference, measurements, table};
use serde::Serialize;

use crate::error::CliError;
use crate::output::Output;
use crate::progress;

#[derive(clap::Args)]
pub(crate) struct References {
    /// Measure every reference instead, and print reference, exact value, value reached, relative error, tolerance and setting, the worst first; exit code 1 if one is out of its tolerance.
    #[arg(long)]
    pub(crate) references: bool,
    /// Only measurements whose name contains NAME, such as `pendulum` or `friction/roll`; may be given several times.
    #[arg(long, value_name = "NAME", requires = "references")]
    only: Vec<String>,
    /// Multiply all tolerances by FACTOR: below 1, to see how much room is left.
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0, value_parser = crate::number::positive, requires = "references")]
    scale_tolerances: f64,
}

/// Whether all references hold.
pub(crate) fn run(arguments: &References, output: &Output) -> Result<bool, CliError> {
    let mut chosen = measurements();
    for only in &arguments.only {
        if !chosen.iter().any(|m| m.name.contains(only.as_str())) {
            let names: Vec<&str> = chosen.iter().map(|m| m.name).collect();
            return Err(CliError::UnknownReference { only: only.clone(), names: names.join(", ") });
        }
    }
    chosen.retain(|m| arguments.only.is_empty() || arguments.only.iter().any(|only| m.name.contains(only.as_str())));

    let progress = progress::bar(chosen.len(), output.quiet);
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

    output.give(&lines(&references), &table(&references))?;
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

fn lines(references: &[Reference]) -> Vec<Line<'_>> {
    references
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
        .collect()
}
