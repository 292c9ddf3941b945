//! What the solver comes to, against what it should: closed forms, conservation laws and its own limit.
//!
//! Every measurement sets a scene up on the bare kernels, in the order of the plugin's step, and reads numbers off it. Each number stands in a [`Reference`] beside the exact one and the tolerance, which
//! is at most about three times the error that the method makes at that setting; why it makes that error is said beside it.
//!
//! `polpo simulate --references` prints them all, the worst first.
//!
//! Numbers here are measured in `f64` with the standard library's functions: the solver's own bits do not depend on them.

mod beam;
mod body;
mod bricks;
mod cell_body;
mod chain;
mod convergence;
mod drift;
mod free_fall;
mod friction;
mod jacobi;
mod material;
mod measure;
mod needs;
mod orientation;
mod pendulum;
mod rest;
mod soft;
mod solids;
mod statics;
mod stiffness;
mod table;
mod timoshenko;
mod top;
mod wheel;

pub use material::material_table;
pub use needs::{MaterialNeeds, material_needs};
pub use orientation::orientation_table;
pub use table::table;

/// One number that the solver came to, and what it should be.
#[derive(Clone, Debug, PartialEq)]
pub struct Reference {
    /// What was measured.
    pub name: String,
    /// Where the exact value comes from.
    pub source: &'static str,
    /// The exact value, in SI units.
    pub exact: f64,
    /// The value reached. NaN if the run never got that far.
    pub got: f64,
    /// The largest [`error`](Self::error) that passes.
    pub tolerance: f64,
    /// Why no smaller error can be asked for.
    pub reason: &'static str,
    /// Time step, substeps, iterations, resolution.
    pub setting: String,
}

impl Reference {
    /// The error relative to the exact value; where that is 0, the value reached, which then is itself relative to the scale that its name tells.
    pub fn error(&self) -> f64 {
        let difference = (self.got - self.exact).abs();
        if self.exact == 0.0 { difference } else { difference / self.exact.abs() }
    }

    /// The error as a share of the tolerance: up to 1 passes. Infinite for a value that is not a number.
    pub fn share(&self) -> f64 {
        let share = self.error() / self.tolerance;
        if share.is_nan() { f64::INFINITY } else { share }
    }

    /// A value read off a run, still without a tolerance.
    pub(crate) fn new(name: impl Into<String>, exact: f64, got: f64) -> Self {
        Self { name: name.into(), source: "", exact, got, tolerance: 0.0, reason: "", setting: String::new() }
    }

    pub(crate) fn after(self, source: &'static str) -> Self {
        Self { source, ..self }
    }

    pub(crate) fn at(self, setting: impl Into<String>) -> Self {
        Self { setting: setting.into(), ..self }
    }

    pub(crate) fn within(self, tolerance: f64, reason: &'static str) -> Self {
        Self { tolerance, reason, ..self }
    }

    /// Whether the error is within the tolerance.
    pub fn holds(&self) -> bool {
        self.share() <= 1.0
    }
}

/// A scene that is run to read one or more references off it.
#[derive(Clone, Copy, Debug)]
pub struct Measurement {
    /// Family and case, such as `pendulum/45`.
    pub name: &'static str,
    /// Runs it.
    pub run: fn() -> Vec<Reference>,
}

/// All measurements, in the order of the method's chapters.
pub fn measurements() -> Vec<Measurement> {
    [
        top::MEASUREMENTS,
        wheel::MEASUREMENTS,
        free_fall::MEASUREMENTS,
        pendulum::MEASUREMENTS,
        chain::MEASUREMENTS,
        friction::MEASUREMENTS,
        beam::MEASUREMENTS,
        material::MEASUREMENTS,
        stiffness::MEASUREMENTS,
        drift::MEASUREMENTS,
        rest::MEASUREMENTS,
        convergence::MEASUREMENTS,
    ]
    .concat()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_out_of_tolerance_or_not_a_number_does_not_pass() {
        let line = |exact, got| Reference::new("", exact, got).within(0.01, "");
        assert!(line(2.0, 2.01).holds() && line(-2.0, -2.01).holds() && line(0.0, 0.005).holds());
        assert!(!line(2.0, 2.03).holds() && !line(2.0, -2.0).holds() && !line(0.0, -0.02).holds());
        assert!(!line(2.0, f64::NAN).holds() && line(2.0, f64::NAN).share() == f64::INFINITY);
    }

    #[test]
    fn every_name_is_there_once() {
        let mut names: Vec<&str> = measurements().iter().map(|m| m.name).collect();
        names.sort_unstable();
        let count = names.len();
        names.dedup();
        assert_eq!(names.len(), count);
    }
}
