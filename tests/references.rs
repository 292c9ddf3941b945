//! Every line of the method's references is within its tolerance: pendulums, chains, friction, beams, tops, springs, conservation, rest, convergence.
//!
//! Scenes and tolerances, with their reasons, are in the crate `polpo_references`; `polpo simulate --references` prints the same table.

use polpo_references::{Reference, measurements, table};

#[test]
fn the_solver_comes_to_what_it_should() {
    let mut references: Vec<Reference> = measurements().iter().flat_map(|m| (m.run)()).collect();
    references.sort_by(|a, b| b.share().total_cmp(&a.share()));
    println!("{}", table(&references));
    for r in &references {
        assert!(!r.reason.is_empty() && !r.source.is_empty() && !r.setting.is_empty(), "{} tells neither why nor where", r.name);
        assert!(r.tolerance > 0.0 && r.tolerance < 0.25, "{}: a tolerance of {} is none", r.name, r.tolerance);
    }
    let out: Vec<Reference> = references.into_iter().filter(|r| !r.holds()).collect();
    assert!(out.is_empty(), "out of tolerance:\n{}", table(&out));
}
