//! Prints the table of the decision on orientations, `docs/decisions/0011-orientation.md`.

fn main() {
    print!("{}", polpo_references::orientation_table());
}
