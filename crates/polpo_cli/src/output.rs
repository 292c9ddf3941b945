//! Where results go: a report for people, JSON for programs.

use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

use serde::Serialize;

use crate::error::CliError;

/// What every command takes.
#[derive(clap::Args, Debug, Clone)]
#[command(next_help_heading = "Report")]
pub(crate) struct Output {
    /// Write the result as JSON to FILE; to standard output, in place of the report, if it is `-`.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Print no report and show no progress.
    #[arg(long, short)]
    pub(crate) quiet: bool,
}

impl Output {
    /// Writes `result` as JSON if that was asked for, and prints `report`.
    ///
    /// # Errors
    /// If the file cannot be written, or standard output is broken in another way than by being closed.
    pub(crate) fn give(&self, result: &impl Serialize, report: &str) -> Result<(), CliError> {
        let to_stdout = self.json.as_deref() == Some(Path::new("-"));
        if let Some(path) = &self.json {
            let mut json = serde_json::to_string_pretty(result).map_err(|e| CliError::Output(e.into()))?;
            json.push('\n');
            if to_stdout {
                print(&json)?;
            } else {
                std::fs::write(path, json).map_err(|source| CliError::Write { path: path.clone(), source })?;
            }
        }
        if to_stdout || self.quiet { Ok(()) } else { print(report) }
    }
}

/// Prints `text`. Whoever reads may have read enough and closed the pipe.
pub(crate) fn print(text: &str) -> Result<(), CliError> {
    let mut stdout = std::io::stdout().lock();
    match stdout.write_all(text.as_bytes()).and_then(|()| stdout.flush()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(CliError::Output(error)),
        _ => Ok(()),
    }
}

/// Least, middle and greatest of a list; all 0 of an empty one.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub(crate) struct Spread {
    pub(crate) least: f32,
    pub(crate) median: f32,
    pub(crate) most: f32,
}

impl Spread {
    pub(crate) fn of(mut list: Vec<f32>) -> Spread {
        list.sort_by(f32::total_cmp);
        let at = |k: usize| list.get(k).copied().unwrap_or(0.0);
        Spread { least: at(0), median: at(list.len() / 2), most: at(list.len().saturating_sub(1)) }
    }
}

/// A number with three digits that count.
pub(crate) fn digits(x: f32) -> String {
    if x == 0.0 || !x.is_finite() {
        return format!("{x}");
    }
    // Rounded first: 0.9999 is 1.00.
    let rounded = format!("{x:.2e}");
    let before = rounded.rsplit('e').next().and_then(|e| e.parse::<i32>().ok()).unwrap_or(0);
    if (-4..6).contains(&before) { format!("{x:.*}", (2 - before).max(0) as usize) } else { rounded }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_digits_count() {
        assert_eq!(
            [0.0, 0.012_345, 0.999_99, 123.4, 98765.0, 1.5e9, f32::NAN].map(digits),
            ["0", "0.0123", "1.00", "123", "98765", "1.50e9", "NaN"]
        );
    }

    #[test]
    fn a_spread_of_nothing_is_zero() {
        assert_eq!(Spread::of(vec![]), Spread::default());
        assert_eq!(Spread::of(vec![3.0, 1.0, 2.0]), Spread { least: 1.0, median: 2.0, most: 3.0 });
    }
}
