//! Stiffness in hertz, the damping ratio, and the paper's bare share: what one constraint alone swings at.

use core::f64::consts::TAU;

use glam::Vec3A;
use polpo_solver::{ExplicitGroup, ExplicitGroups, Stiffness, quat_exp, quat_log};

use crate::body::{Body, POINT};
use crate::measure::Swing;
use crate::{Measurement, Reference};

pub(crate) const MEASUREMENTS: &[Measurement] = &[
    Measurement { name: "stiffness/hertz", run: hertz },
    Measurement { name: "stiffness/damping", run: damping },
    Measurement { name: "stiffness/bare", run: bare },
];

/// The four constraints that take a [`Stiffness`], each alone on two balls.
#[derive(Clone, Copy)]
enum Constraint {
    Group,
    Explicit,
    Edge,
    Torsion,
}

const ALL: [(Constraint, &str); 4] =
    [(Constraint::Group, "group"), (Constraint::Explicit, "explicit group"), (Constraint::Edge, "edge"), (Constraint::Torsion, "torsion")];

/// What the constraint's error does, step by step, from a start of 5 cm or 0.1 rad. Sampled `every` so many steps.
fn swing(constraint: Constraint, stiffness: Stiffness, rate: f64, every: u32) -> Swing {
    let radius = if matches!(constraint, Constraint::Torsion) { 0.05 } else { POINT };
    let mut body = Body::row(2, 0.1, Vec3A::X, radius);
    match constraint {
        Constraint::Group => (body.shape, body.only_groups_of) = (stiffness, Some(vec![0])),
        Constraint::Explicit => {
            let group = ExplicitGroup { stiffness, ..ExplicitGroup::rigid([0, 1]) };
            body.explicit = ExplicitGroups::new(&body.particles, &[group]).expect("a well-formed group");
        }
        Constraint::Edge => (body.tension, body.compression) = (stiffness, stiffness),
        Constraint::Torsion => body.torsion = stiffness,
    }
    body.particles.position[1].x += 0.05;
    body.particles.rotation[1] = quat_exp(Vec3A::X * 0.1);
    if !matches!(constraint, Constraint::Torsion) {
        body.particles.rotation[1] = body.particles.rotation[0];
    }
    let samples: Vec<f64> = (0..24)
        .map(|_| {
            let p = &body.particles;
            let error = match constraint {
                Constraint::Torsion => f64::from(quat_log(p.rotation[1] * p.rotation[0].inverse()).x),
                _ => p.position[1].as_dvec3().distance(p.position[0].as_dvec3()) - f64::from(body.edges.rest_length[0]),
            };
            for _ in 0..every {
                body.step(1.0 / rate, 1, 1);
            }
            error
        })
        .collect();
    let swing = Swing::of(&samples);
    Swing { angle: swing.angle / f64::from(every), decrement: swing.decrement / f64::from(every) }
}

/// Angle a step and decrement of the spring of `frequency` \[Hz\] and `ratio`, stepped by implicit Euler: z²·(1 + κ + d) − (2 + d)·z + 1 = 0 with κ = (ω₀Δt)², d = 2ζω₀Δt.
fn implicit_euler(frequency: f64, ratio: f64, rate: f64) -> Swing {
    let x = TAU * frequency / rate;
    let d = 2.0 * ratio * x;
    let size2 = 1.0 / (1.0 + x * x + d);
    Swing { angle: (0.5 * (2.0 + d) * size2.sqrt()).acos(), decrement: -0.5 * size2.ln() }
}

fn hertz() -> Vec<Reference> {
    let mut lines = Vec::new();
    for (constraint, name) in ALL {
        for (rate, every) in [(30.0, 1), (60.0, 3), (240.0, 16), (960.0, 64)] {
            let exact = implicit_euler(2.0, 0.0, rate).angle * rate / TAU;
            let got = swing(constraint, Stiffness::hertz(2.0), rate, every).angle * rate / TAU;
            lines.push(
                Reference::new(format!("{name} of 2 Hz: frequency [Hz]"), exact, got)
                    .after("method §2; atan(ω₀Δt)/(2πΔt)")
                    .at(format!("{rate} Hz"))
                    .within(6e-7, "a few bits of f32"),
            );
        }
    }
    lines
}

fn damping() -> Vec<Reference> {
    let mut lines = Vec::new();
    let ratio = |s: Swing| s.decrement / s.decrement.hypot(s.angle);
    for (constraint, name) in ALL {
        let (exact, got) = (implicit_euler(2.0, 0.2, 240.0), swing(constraint, Stiffness::damped(2.0, 0.2), 240.0, 16));
        let line = |what: &str, exact, got| {
            Reference::new(format!("{name} of 2 Hz, ζ = 0.2: {what}"), exact, got)
                .after("implicit Euler's characteristic polynomial")
                .at("240 Hz")
        };
        lines.push(line("frequency [Hz]", exact.angle * 240.0 / TAU, got.angle * 240.0 / TAU).within(4e-7, "a few bits of f32"));
        lines.push(
            line("logarithmic decrement a swing", TAU * exact.decrement / exact.angle, TAU * got.decrement / got.angle)
                .within(1e-6, "a few bits of f32"),
        );
        let got = ratio(swing(constraint, Stiffness::damped(2.0, 0.2), 3840.0, 256));
        lines.push(
            line("damping ratio", 0.2, got).after("method §2").at("3840 Hz").within(1.5e-2, "implicit Euler adds about ½·ω₀·Δt, 1.6e-3"),
        );
    }
    lines
}

fn bare() -> Vec<Reference> {
    let line = |(constraint, name): (Constraint, &str)| {
        let got = swing(constraint, Stiffness::Fraction(0.05), 60.0, 3).angle * 60.0 / TAU;
        Reference::new(format!("{name} of the bare share 0.05: frequency [Hz]"), 0.05f64.sqrt().asin() * 60.0 / TAU, got)
            .after("method §2; asin(√s)/(2πΔt)")
            .at("60 Hz")
            .within(1e-7, "a bit of f32")
    };
    ALL.into_iter().map(line).collect()
}
