//! Polpo beside Rapier's own soft bodies, step by step in one run: what either takes, and what shape the bodies keep.
//!
//! All on one thread, at 60 steps a second. A row's two cases are stepped in turns, so that whatever else the machine does falls on both.

mod beam;
mod constrained;
mod crowd;
mod kernels;
mod ours;
mod rapier;
mod report;
mod rows;
mod scene;
mod shape;
mod table;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Parser;

/// Measures Polpo's step beside that of Rapier's own soft bodies.
#[derive(Parser)]
struct Arguments {
    /// Write the rows as JSON to FILE.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write the rows as a page of Markdown to FILE.
    #[arg(long, value_name = "FILE")]
    markdown: Option<PathBuf>,
    /// Only rows whose name contains SUBSTRING.
    #[arg(long, value_name = "SUBSTRING")]
    only: Option<String>,
    /// Step a crowd on so many threads, a step a line on standard input, and write what each took: how one process measures another's threads.
    #[arg(long, value_name = "THREADS", hide = true, value_parser = clap::value_parser!(u32).range(1..=256))]
    crowd: Option<u32>,
    /// Not a crowd but one body of so many particles a side.
    #[arg(long, value_name = "COUNT", hide = true, value_parser = clap::value_parser!(u32).range(2..=200))]
    side: Option<u32>,
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    if let Some(threads) = arguments.crowd {
        return finish(crowd::serve(threads as usize, arguments.side.map(|side| side as usize)).map_err(|e| e.to_string()));
    }
    let only = arguments.only.as_deref().unwrap_or_default();
    let chosen: Vec<_> = rows::ROWS.iter().filter(|row| row.name.contains(only)).collect();
    if chosen.is_empty() {
        let names: Vec<&str> = rows::ROWS.iter().map(|row| row.name).collect();
        eprintln!("error: no row's name contains `{only}`; there are:\n  {}", names.join("\n  "));
        return ExitCode::from(2);
    }
    table::print_head();
    let mut results = Vec::new();
    for row in chosen {
        let result = row.measure();
        table::print_row(&result);
        results.push(result);
    }
    let written = |path: &Path, done: std::io::Result<()>| done.map_err(|e| format!("{}: {e}", path.display()));
    let json = arguments.json.map_or(Ok(()), |path| written(&path, table::write_json(&path, &results)));
    let markdown = arguments.markdown.map_or(Ok(()), |path| written(&path, report::write_markdown(&path, &results)));
    finish(json.and(markdown))
}

fn finish(done: Result<(), String>) -> ExitCode {
    if let Err(error) = done {
        eprintln!("error: {error}");
        return ExitCode::from(2);
    }
    ExitCode::SUCCESS
}
