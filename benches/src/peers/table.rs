//! The rows as a table, and as JSON.

use std::path::Path;

use serde::Serialize;

use crate::rows::{Measured, Row, Wanted};

/// A row and what came of it, as it is written to files.
#[derive(Debug, Serialize)]
pub(crate) struct Line {
    name: &'static str,
    /// The best step \[µs\].
    ours_us: f64,
    theirs_us: f64,
    ratio_best: f64,
    ratio_median: f64,
    quality: String,
    pass: bool,
    #[serde(skip)]
    medians_us: [f64; 2],
    #[serde(skip)]
    wanted: Wanted,
}

impl Line {
    pub(crate) fn new(row: &Row, measured: Measured) -> Self {
        let Measured { ours, theirs, quality, sound } = measured;
        let ratio = |ours: f64, theirs: f64| match row.wanted {
            Wanted::AtLeast(_) => theirs / ours,
            Wanted::AtMost(_) => ours / theirs,
        };
        let (ratio_best, ratio_median) = (ratio(ours.best, theirs.best), ratio(ours.median, theirs.median));
        Self {
            name: row.name,
            ours_us: ours.best,
            theirs_us: theirs.best,
            ratio_best,
            ratio_median,
            quality,
            pass: sound && row.wanted.holds(ratio_best),
            medians_us: [ours.median, theirs.median],
            wanted: row.wanted,
        }
    }
}

impl Line {
    /// As a row of a table in Markdown.
    pub(crate) fn markdown(&self) -> String {
        let Self { name, ours_us, theirs_us, ratio_best, ratio_median, quality, pass, wanted, .. } = self;
        let reached = if *pass { "yes" } else { "no" };
        format!("| {name} | {ours_us:.0} | {theirs_us:.0} | {ratio_best:.3} | {ratio_median:.3} | {wanted} | {reached} | {quality} |")
    }
}

pub(crate) fn print_head() {
    println!(
        "Times are of the best step and, in brackets, of the middle one [µs]. A ratio that is to be at least something is theirs/ours,"
    );
    println!(
        "one that is to be at most something is ours/theirs. A row passes by its ratio of the best, and only if our body keeps its shape."
    );
    println!();
    println!("{:<38} {:>20} {:>20} {:>8} {:>8} {:>8}  pass  quality", "row", "ours", "theirs", "ratio", "median", "wanted");
}

pub(crate) fn print_row(line: &Line) {
    let time = |best: f64, median: f64| format!("{best:.1} ({median:.1})");
    let [ours, theirs] = line.medians_us;
    println!(
        "{:<38} {:>20} {:>20} {:>8.3} {:>8.3} {:>8}  {:<4}  {}",
        line.name,
        time(line.ours_us, ours),
        time(line.theirs_us, theirs),
        line.ratio_best,
        line.ratio_median,
        line.wanted.to_string(),
        if line.pass { "yes" } else { "NO" },
        line.quality
    );
}

/// # Errors
/// If the file cannot be written.
pub(crate) fn write_json(path: &Path, lines: &[Line]) -> std::io::Result<()> {
    let mut text = serde_json::to_string_pretty(lines)?;
    text.push('\n');
    std::fs::write(path, text)
}
