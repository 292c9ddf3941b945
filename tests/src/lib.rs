//! What the contract tests share.

mod fixtures;
pub mod models;
mod random_capabilities;
mod random_scene;
pub mod render;

pub use fixtures::{cube, lattice, shaken, simulation, simulation_at, state_of, steps};
pub use random_scene::{Random, random_scene};
