//! Times of two cases, step by step in turns.

use std::time::{Duration, Instant};

/// How long the steps of a case took.
#[derive(Debug, Clone, Default)]
pub struct Times {
    steps: Vec<Duration>,
}

impl Times {
    /// Takes note of one more step.
    pub fn note(&mut self, step: Duration) {
        self.steps.push(step);
    }

    /// Runs `step` and takes note of its time.
    pub fn time(&mut self, step: impl FnOnce()) {
        let started = Instant::now();
        step();
        self.note(started.elapsed());
    }

    /// The shortest \[µs\]; infinite if there was none.
    pub fn best(&self) -> f64 {
        self.steps.iter().min().map_or(f64::INFINITY, |t| 1e6 * t.as_secs_f64())
    }

    /// The middle one \[µs\]; infinite if there was none.
    pub fn median(&self) -> f64 {
        let mut sorted = self.steps.clone();
        sorted.sort_unstable();
        sorted.get(sorted.len() / 2).map_or(f64::INFINITY, |t| 1e6 * t.as_secs_f64())
    }
}

/// Takes `rounds` steps of both in turns.
pub fn in_turns(rounds: usize, mut one: impl FnMut(), mut other: impl FnMut()) -> [Times; 2] {
    let mut times = <[Times; 2]>::default();
    for _ in 0..rounds {
        times[0].time(&mut one);
        times[1].time(&mut other);
    }
    times
}
