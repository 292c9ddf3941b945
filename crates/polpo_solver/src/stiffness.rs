//! Stiffness in hertz.

use core::f32::consts::TAU;

/// The share of its error that a constraint of `frequency` \[Hz\] corrects in one substep of `dt` \[s\]: s = (ω₀Δt)²/(1 + (ω₀Δt)²), ω₀ = 2πf.
///
/// A spring of angular frequency ω₀, stepped by implicit Euler, moves by exactly this share of its error, and with it the frequency that one sees is the frequency that one asked for,
/// whatever the time step (2 Hz becomes 1.89, 1.97, 1.998, 2.000 Hz at 30, 60, 240, 960 Hz). A bare share s per step instead gives asin(√s)/Δt.
///
/// Range: `frequency` from 0 (off: 0) to infinity (rigid: 1). As f·Δt grows past about 0.3 the share saturates and frequencies can no longer be told apart: take more substeps. Negative
/// and NaN frequencies count as 0.
#[inline]
pub fn stiffness_fraction(frequency: f32, dt: f32) -> f32 {
    if frequency == f32::INFINITY {
        return 1.0;
    }
    let x = TAU * frequency * dt;
    let x2 = x * x;
    if frequency > 0.0 && x2 > 0.0 { if x2.is_finite() { x2 / (1.0 + x2) } else { 1.0 } } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ends_are_defined() {
        assert_eq!(stiffness_fraction(0.0, 0.01), 0.0);
        assert_eq!(stiffness_fraction(-1.0, 0.01), 0.0);
        assert_eq!(stiffness_fraction(f32::NAN, 0.01), 0.0);
        assert_eq!(stiffness_fraction(f32::INFINITY, 0.01), 1.0);
        assert_eq!(stiffness_fraction(1e30, 1.0), 1.0);
        assert_eq!(stiffness_fraction(5.0, 0.0), 0.0);
    }

    /// A point on a spring of 2 Hz swings at 2 Hz, at every step.
    #[test]
    fn frequency_survives_a_change_of_time_step() {
        for (rate, expected) in [(30.0, 1.89), (60.0, 1.97), (240.0, 1.998), (960.0, 2.0)] {
            let dt = 1.0 / rate;
            let s = stiffness_fraction(2.0, dt);
            let (mut x, mut v, mut crossings, mut last) = (1.0f32, 0.0f32, Vec::new(), 1.0f32);
            for step in 0..(rate as usize * 2) {
                let mut p = x + dt * v;
                p -= s * p;
                v = (p - x) / dt;
                x = p;
                if last * x < 0.0 {
                    // where the straight line between the two samples crosses zero
                    crossings.push((step as f32 + last / (last - x)) * dt);
                }
                last = x;
            }
            let measured = 0.5 * (crossings.len() - 1) as f32 / (crossings[crossings.len() - 1] - crossings[0]);
            assert!((measured - expected).abs() < 0.01, "{rate} Hz: {measured} against {expected}");
        }
    }
}
