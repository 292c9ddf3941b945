//! What one step costs.
fn main() {}
