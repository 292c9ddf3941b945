//! octopus
fn main() {}
