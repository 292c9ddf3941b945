//! What the contract tests share.

mod fixtures;
pub mod render;

pub use fixtures::{cube, lattice, simulation, simulation_at, steps};
