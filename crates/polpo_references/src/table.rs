//! The table of all references.

use core::fmt::Write;

use crate::Reference;

/// Reference, exact value, value reached, relative error, tolerance and setting in columns, in the order given; then how many there are, and how many are out of their tolerance.
pub fn table(references: &[Reference]) -> String {
    let name = references.iter().map(|r| r.name.chars().count()).max().unwrap_or(0).max("reference".len());
    let mut out = String::new();
    // Writing to a string cannot fail.
    let _ = writeln!(out, "{:name$}  {:>12}  {:>12}  {:>8}  {:>9}  setting", "reference", "exact", "got", "error", "tolerance");
    for r in references {
        let mark = if r.holds() { "" } else { "  OUT OF TOLERANCE" };
        let (exact, got) = (seven_digits(r.exact), seven_digits(r.got));
        let _ = writeln!(out, "{:name$}  {exact:>12}  {got:>12}  {:>8.1e}  {:>9.1e}  {}{mark}", r.name, r.error(), r.tolerance, r.setting);
    }
    let out_of = references.iter().filter(|r| !r.holds()).count();
    let _ = writeln!(out, "{} references, {out_of} out of tolerance", references.len());
    out
}

fn seven_digits(x: f64) -> String {
    let size = x.abs();
    if x == 0.0 {
        "0".to_owned()
    } else if (1e-3..1e7).contains(&size) {
        let decimals = (6.0 - size.log10().floor()).max(0.0) as usize;
        format!("{x:.decimals$}")
    } else {
        format!("{x:.2e}")
    }
}
