//! The solver's kernels, each on a body in a state that it meets in a step, to be run from that state again and again.

mod body;
mod list;
mod state;

use std::time::{Duration, Instant};

pub use body::{Body, stir};
pub use list::all;

use state::State;

/// What the name of a kernel in plain glam ends with, after that of the one in vector lanes.
pub const SCALAR: &str = ", scalar glam";

/// One kernel on one body.
pub struct Kernel {
    /// What it is.
    pub name: &'static str,
    /// Which body it works on.
    pub body: &'static str,
    /// What its cost is told by: "particle", "group", …
    pub unit: &'static str,
    /// How many of them there are.
    pub count: usize,
    /// How often it runs before the state is taken back: more than once where neither what it does nor its cost depends on it, and the clock would be much of what is measured.
    repeats: u64,
    state: State,
    run: fn(&mut State),
}

impl Kernel {
    /// Runs it once.
    pub fn run(&mut self) {
        (self.run)(&mut self.state);
    }

    /// Takes back what it has done.
    pub fn reset(&mut self) {
        self.state.reset();
    }

    /// How long so many runs take, without what is taken back between them.
    pub fn time(&mut self, runs: u64) -> Duration {
        let (mut left, mut spent) = (runs, Duration::ZERO);
        while left > 0 {
            let runs = left.min(self.repeats);
            self.reset();
            let started = Instant::now();
            for _ in 0..runs {
                self.run();
            }
            spent += started.elapsed();
            left -= runs;
        }
        spent
    }
}
