//! What the tests of scalar kernels share.

use polpo_solver::{Particles, quat_log};

/// Both are the same but for a thousandth of how far, on the average, they are from where they started, and for rounding.
///
/// Positions are rounded at 1e-7 m, rotations at 1e-6 rad where they come from a search; velocities are told by those, in a substep of `dt` \[s\].
pub(super) fn assert_close(a: &Particles, b: &Particles, start: &Particles, dt: f32) {
    let position = |a: &Particles, b: &Particles, i: usize| a.position[i].distance(b.position[i]);
    let rotation = |a: &Particles, b: &Particles, i: usize| quat_log(a.rotation[i] * b.rotation[i].conjugate()).length();
    let velocity = |a: &Particles, b: &Particles, i: usize| a.velocity[i].distance(b.velocity[i]);
    let spin = |a: &Particles, b: &Particles, i: usize| a.angular_velocity[i].distance(b.angular_velocity[i]);
    let measures: [(&str, f32, &dyn Fn(&Particles, &Particles, usize) -> f32); 4] =
        [("position", 3e-7, &position), ("rotation", 3e-6, &rotation), ("velocity", 3e-7 / dt, &velocity), ("spin", 3e-6 / dt, &spin)];
    for (what, rounding, apart) in measures {
        let all = 0..a.len();
        let moved = all.clone().map(|i| apart(a, start, i)).sum::<f32>() / a.len() as f32;
        assert!(moved > 10.0 * rounding, "{what} has hardly changed: {moved}");
        let worst = all.map(|i| apart(a, b, i)).fold(0.0, f32::max);
        assert!(worst < 1e-3 * moved + rounding, "{what}: {worst} apart, of {moved}");
    }
}
