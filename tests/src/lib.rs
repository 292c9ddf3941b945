//! What the contract tests share.

mod fixtures;
pub mod render;

pub use fixtures::{lattice, simulation, steps};
