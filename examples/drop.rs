//! drop
fn main() {}
