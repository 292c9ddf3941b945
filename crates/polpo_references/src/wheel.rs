//! A spinning wheel: what keeps its spin and what brakes it.

use glam::Vec3A;
use polpo_solver::{Stiffness, quat_exp};

use crate::body::{Body, POINT};
use crate::{Measurement, Reference};

pub(crate) const MEASUREMENTS: &[Measurement] = &[Measurement { name: "wheel", run: wheel }];

/// Spin after 1 s at 60 Hz, from 10 rad/s: a rim of 12 balls about a hub.
fn spin(rigid: bool, keep_momentum: bool) -> f64 {
    let rim = (0..12).map(|i| quat_exp(Vec3A::Z * (i as f32 * core::f32::consts::PI / 6.0)) * Vec3A::X * 0.4);
    let mut body = Body::balls([Vec3A::ZERO].into_iter().chain(rim), POINT);
    let all: Vec<u32> = (0..13).collect();
    if rigid {
        body.make_rigid([&all[..]]);
    } else {
        body.join(&all[1..].iter().map(|&i| [0, i]).collect::<Vec<_>>());
        body.only_groups_of = Some(vec![0]);
        body.shape = Stiffness::RIGID;
    }
    body.keep_momentum = keep_momentum;
    body.particles.set_rigid_velocity(Vec3A::ZERO, Vec3A::Z * 10.0);
    let inertia = body.carried().angular.z / 10.0;
    for _ in 0..60 {
        body.step(1.0 / 60.0, 1, 1);
    }
    body.carried().angular.z / inertia
}

/// What projection alone leaves of 10 rad/s after `steps` of 1/60 s.
///
/// A rim that has turned by θ moves on along the chord, half of θ outside its tangent, and is drawn back to its radius: tan θ′ = sin θ/(2 − cos θ), with the spin sin θ/Δt. For small θ that is
/// ω₀/√(1 + 2ω₀²Δt·t), here 4.80.
fn braked(steps: u32) -> f64 {
    let mut theta = (10.0f64 / 60.0).atan();
    for _ in 1..steps {
        theta = (theta.sin() / (2.0 - theta.cos())).atan();
    }
    60.0 * theta.sin()
}

fn wheel() -> Vec<Reference> {
    let line = |what: &str, exact, got| {
        Reference::new(format!("wheel at 10 rad/s: {what} after 1 s [rad/s]"), exact, got).after("method §2").at("60 Hz")
    };
    vec![
        line("rigid group's spin", 10.0, spin(true, false)).within(6e-8, "a bit of f32"),
        line("matched group's spin, L restored", 10.0, spin(false, true)).within(5e-6, "rounding in f32, sixty times"),
        line("matched group's spin, as in the paper", braked(60), spin(false, false))
            .within(1.5e-5, "rounding in f32, which each step that brakes hands on"),
    ]
}
