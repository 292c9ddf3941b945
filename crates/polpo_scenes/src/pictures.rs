//! The files that a run leaves: frames, the last picture, the figures.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::{Arc, Mutex};

use bevy::prelude::*;
use bevy::render::view::screenshot::{Screenshot, ScreenshotCaptured};

use crate::{Options, Stats};

/// Which pictures were asked for, and what went wrong with them.
pub(crate) struct Pictures {
    png: Option<PathBuf>,
    frames: Option<PathBuf>,
    every: u64,
    stats: Option<PathBuf>,
    taken: u64,
    failed: bool,
}

impl Pictures {
    pub(crate) fn new(options: &Options) -> Self {
        let mut pictures = Self {
            png: options.png.clone(),
            frames: options.frames.clone(),
            every: u64::from(options.every),
            stats: options.stats.clone(),
            taken: 0,
            failed: false,
        };
        if let Some(folder) = &pictures.frames
            && let Err(error) = std::fs::create_dir_all(folder)
        {
            let message = format!("{}: {error}", folder.display());
            pictures.fail(&message);
            pictures.frames = None;
        }
        pictures
    }

    fn fail(&mut self, message: &str) {
        eprintln!("{message}");
        self.failed = true;
    }

    /// The file for the frame at `step`, if one is due.
    pub(crate) fn due(&mut self, step: u64) -> Option<PathBuf> {
        let folder = self.frames.as_ref().filter(|_| step.is_multiple_of(self.every))?;
        let path = folder.join(format!("{:05}.png", self.taken));
        self.taken += 1;
        Some(path)
    }

    pub(crate) fn each_step(&mut self, step: u64, capture: impl FnOnce(&Path) -> Result<(), String>) {
        if let Some(path) = self.due(step)
            && let Err(error) = capture(&path)
        {
            self.fail(&error);
        }
    }

    pub(crate) fn at_end(&mut self, capture: impl FnOnce(&Path) -> Result<(), String>) {
        if let Some(path) = self.png.clone()
            && let Err(error) = capture(&path)
        {
            self.fail(&error);
        }
    }

    /// Whether a last picture was asked for.
    pub(crate) fn has_png(&self) -> bool {
        self.png.is_some()
    }

    /// Notes what became of the last picture.
    pub(crate) fn at_end_arrived(&mut self, result: Result<(), String>) {
        if let Err(error) = result {
            self.fail(&error);
        }
    }

    /// Whether any file could not be written.
    pub(crate) fn failed(&self) -> bool {
        self.failed
    }

    pub(crate) fn write_stats(&mut self, stats: &Stats) {
        if let Some(path) = &self.stats
            && let Err(error) = stats.write(path)
        {
            let message = format!("{}: {error}", path.display());
            self.fail(&message);
        }
    }

    pub(crate) fn exit_code(&self) -> ExitCode {
        if self.failed { ExitCode::FAILURE } else { ExitCode::SUCCESS }
    }
}

/// A picture that is on its way.
#[derive(Clone, Default)]
pub(crate) struct Shot(Arc<Mutex<Option<Result<(), String>>>>);

impl Shot {
    /// What became of it, once it is there.
    pub(crate) fn take(&self) -> Option<Result<(), String>> {
        self.0.lock().ok().and_then(|mut result| result.take())
    }
}

/// Takes a picture in the next frame that is drawn and writes it to `path`.
pub(crate) fn shoot(world: &mut World, screenshot: Screenshot, path: &Path) -> Shot {
    let shot = Shot::default();
    let (result, path) = (shot.clone(), path.to_owned());
    world.spawn(screenshot).observe(move |captured: On<ScreenshotCaptured>| {
        let saved = captured
            .image
            .clone()
            .try_into_dynamic()
            .map_err(|error| error.to_string())
            // The alpha channel is the renderer's business, not the picture's.
            .and_then(|picture| picture.to_rgb8().save(&path).map_err(|error| error.to_string()))
            .map_err(|error| format!("{}: {error}", path.display()));
        if let Ok(mut slot) = result.0.lock() {
            *slot = Some(saved);
        }
    });
    shot
}
