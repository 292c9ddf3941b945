//! The stages of the rigger, for whoever waits, and how long they took.

use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};
use polpo_rig::{Built, Mesh, Recipe, RigError, Stage, build_rig_with};

/// What a stage is called.
fn name(stage: Stage) -> String {
    format!("{stage:?}").to_lowercase()
}

/// A bar on standard error; nothing if that is no terminal, or `quiet`.
pub(crate) fn bar(steps: usize, quiet: bool) -> ProgressBar {
    let bar = if quiet { ProgressBar::hidden() } else { ProgressBar::new(steps as u64) };
    if let Ok(style) = ProgressStyle::with_template("{pos:>4}/{len} {wide_bar} {msg}") {
        bar.set_style(style);
    }
    bar
}

/// Rigs `mesh`, and tells how long each stage took.
pub(crate) fn build(mesh: &Mesh, recipe: &Recipe, quiet: bool) -> Result<(Built, Vec<(String, Duration)>), RigError> {
    let bar = bar(Stage::ALL.len(), quiet);
    let mut begun: Vec<(String, Instant)> = Vec::new();
    let built = build_rig_with(mesh, recipe, &mut |stage| {
        bar.set_position(begun.len() as u64);
        bar.set_message(name(stage));
        begun.push((name(stage), Instant::now()));
    });
    let end = Instant::now();
    bar.finish_and_clear();
    let ends: Vec<Instant> = begun.iter().skip(1).map(|b| b.1).chain([end]).collect();
    let stages = begun.into_iter().zip(ends).map(|((name, from), to)| (name, to - from)).collect();
    built.map(|built| (built, stages))
}
