//! `cargo run --release -p polpo_references --example material [NAME]`: how far rigs of a material are from what they should be.

fn main() {
    print!("{}", polpo_references::material_table(&std::env::args().nth(1).unwrap_or_default()));
}
