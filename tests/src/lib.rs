//! What the contract tests share.

pub mod render;
