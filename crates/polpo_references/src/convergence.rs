//! Where the answer goes as the time step, the iterations and the resolution get finer: to that of a very fine run, and how fast.

use glam::Vec3A;
use polpo_solver::{CalibratedEdges, Material, Section, Stiffness};

use crate::body::Body;
use crate::measure::order;
use crate::soft::lattice;
use crate::{Measurement, Reference};

pub(crate) const MEASUREMENTS: &[Measurement] = &[
    Measurement { name: "convergence/time", run: time_step },
    Measurement { name: "convergence/iterations", run: iterations },
    Measurement { name: "convergence/resolution", run: resolution },
];

/// A soft bar of a lattice, clamped at one end.
pub(crate) fn soft_bar(frequency: f32) -> Body {
    let mut body = lattice([8, 2, 2], 0.0);
    body.shape = Stiffness::hertz(frequency);
    (body.tension, body.compression) = (body.shape, body.shape);
    body.torsion = Stiffness::hertz(0.5 * frequency);
    body.fall();
    for i in 0..4 {
        body.particles.pin(8 * i, true, true);
    }
    body
}

/// How far the bar's end has fallen after a tenth of a second \[m\].
fn fallen(rate: f64) -> f64 {
    let mut body = soft_bar(5.0);
    for _ in 0..(0.1 * rate).round() as usize {
        body.step(1.0 / rate, 1, 1);
    }
    -body.place(7).y
}

fn time_step() -> Vec<Reference> {
    let limit = fallen(30_720.0);
    let [a, b, c] = [480.0, 960.0, 1920.0].map(fallen);
    let line = |what: &str, exact, got| Reference::new(format!("soft bar: {what}"), exact, got).after("method §7; a very fine run");
    vec![
        line("fall of its end in 0.1 s [m]", limit, c)
            .at("1920 Hz against 30720 Hz")
            .within(1.5e-2, "first order: symplectic Euler alone falls too far by Δt/t, 5e-3"),
        line("order in Δt", 1.0, order(a - b, b - c, 2.0)).at("480, 960 and 1920 Hz").within(1.5e-2, "the next order shows"),
    ]
}

/// Sag at rest \[m\].
fn sag(rate: f64, iterations: u32) -> f64 {
    let mut body = soft_bar(12.0);
    body.drag = 20.0;
    for _ in 0..(4.0 * rate) as usize {
        body.step(1.0 / rate, 1, iterations);
    }
    -body.place(7).y
}

fn iterations() -> Vec<Reference> {
    let limit = sag(60.0, 256);
    let line = |n: u32| {
        Reference::new("soft bar: sag [m]", limit, sag(60.0, n))
            .after("method §2; very many iterations")
            .at(format!("60 Hz × {n} iterations against 256"))
    };
    vec![
        line(16).within(8e-3, UNCONVERGED),
        line(64).within(1e-4, UNCONVERGED),
        line(128).within(3e-6, UNCONVERGED),
        Reference::new("soft bar: sag [m]", limit, sag(7680.0, 1))
            .after("method §2; very many iterations")
            .at("7680 Hz × 1 iteration against 60 Hz × 256")
            .within(8e-4, "an edge's multiplier acts along where the edge was in each iteration: of second order in a substep's way"),
    ]
}

const UNCONVERGED: &str = "Gauss–Seidel's own convergence, geometric";

/// Sag at rest of a rod of 1 m that bends by half its length.
fn deep_sag(n: u32) -> f64 {
    let mut body = Body::row(n, 1.0, Vec3A::X, 1e-2);
    let section = Section::square(0.02);
    let material = Material { youngs_modulus: 4e6, poissons_ratio: 0.3, density: 1000.0 };
    let rods = CalibratedEdges::rods(&mut body.particles, &body.edges, &material, &section, Some(0.0), &[]).expect("a real material");
    let rate = f64::from(rods.recommended_substeps(&body.particles, 1.0));
    body.rods = Some(rods);
    body.particles.pin(0, true, true);
    body.fall();
    body.drag = 12.0;
    for _ in 0..(4.0 * rate) as usize {
        body.step(1.0 / rate, 1, 1);
    }
    -body.place(n as usize - 1).y
}

fn resolution() -> Vec<Reference> {
    let limit = deep_sag(65);
    let line = |n: u32| {
        Reference::new(format!("rod of {n} that hangs down: fall of its end [m]"), limit, deep_sag(n))
            .after("method §3a; a very fine run")
            .at("against 65 particles")
    };
    let (a, b, c) = (deep_sag(5), deep_sag(9), deep_sag(17));
    vec![
        line(9).within(7e-2, "a sweep's compliance, of second order in h and in Δt"),
        line(17).within(2e-2, "a sweep's compliance, of second order in h and in Δt"),
        line(33).within(3e-3, "a sweep's compliance, of second order in h and in Δt"),
        Reference::new("rod that hangs down: order in the resolution", 2.0, order(a - b, b - c, 2.0))
            .after("method §3a")
            .at("5, 9 and 17 particles")
            .within(0.2, "5 are too few for the leading order"),
    ]
}
