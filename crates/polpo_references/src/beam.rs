//! Calibrated edges against beam theory: sag, bending modes, torsion, twist.

use core::f64::consts::TAU;

use glam::Vec3A;
use polpo_solver::{CalibratedEdges, DirectEdges, Material, Section, quat_exp, quat_log};

use crate::body::{Body, G};
use crate::measure::{Crossings, order};
use crate::{Measurement, Reference};

pub(crate) const MEASUREMENTS: &[Measurement] = &[
    Measurement { name: "beam/sag", run: sags },
    Measurement { name: "beam/mode1", run: || modes(0, 2e-3, 1.2e-2) },
    Measurement { name: "beam/mode2", run: || modes(1, 1e-2, 5e-2) },
    Measurement { name: "beam/mode3", run: || modes(2, 2e-2, 7e-2) },
    Measurement { name: "beam/direct", run: solved_directly },
    Measurement { name: "beam/torsion", run: torsion },
    Measurement { name: "beam/twist", run: twist },
];

/// Roots of cos β·cosh β = −1.
const BETA: [f64; 3] = [1.875_104_068_711_961, 4.694_091_132_974_175, 7.854_757_438_237_613];
const DENSITY: f32 = 1000.0;
/// So thin \[m\] that neither shear nor rotary inertia shows: both are of the order of (side/length)², 2e-5.
const SIDE: f32 = 0.004;
/// What its own weight bends a metre of it by \[m\]: so little that its arc does not show.
const SAG: f64 = 0.01;

/// EI/ρA \[m⁴/s²\] of a beam of 1 m with δ = ρgA·L⁴/(8·EI).
const STIFFNESS: f64 = G / (8.0 * SAG);

/// A bar of 1 m along x of `n` particles, clamped at its first.
fn bar(n: u32, material: &Material, section: &Section, spin_radius: f32) -> Body {
    let mut body = Body::row(n, 1.0, Vec3A::X, 1e-2);
    let rods = CalibratedEdges::rods(&mut body.particles, &body.edges, material, section, Some(spin_radius), &[]);
    body.rods = Some(rods.expect("a real material"));
    body.particles.pin(0, true, true);
    body
}

fn cantilever(n: u32) -> Body {
    let section = Section::square(SIDE);
    let youngs_modulus = STIFFNESS as f32 * DENSITY * section.area / section.bending;
    bar(n, &Material { youngs_modulus, poissons_ratio: 0.3, density: DENSITY }, &section, 0.0)
}

/// The same, solved all at once.
fn direct(n: u32) -> Body {
    let mut body = cantilever(n);
    body.direct = body.rods.as_ref().map(|rods| DirectEdges::new(rods, n as usize).expect("a chain has no loops"));
    body
}

/// Substeps a second that the rule asks for.
fn rate(body: &Body) -> f64 {
    f64::from(body.rods.as_ref().map_or(0, |rods| rods.recommended_substeps(&body.particles, 1.0)))
}

/// Sag at rest, reached under almost critical drag.
fn sag(mut body: Body, rate: f64) -> f64 {
    body.fall();
    body.drag = (1.8 * TAU * frequency(0)) as f32;
    let steps = (0.6 * rate) as usize;
    let (mut sum, mut count) = (0.0, 0);
    for k in 0..steps {
        body.step(1.0 / rate, 1, 1);
        if k >= steps * 5 / 6 {
            sum -= body.place(body.particles.len() - 1).y;
            count += 1;
        }
    }
    sum / f64::from(count)
}

/// The sag of a swept bar of `n` particles at `finer` times the substeps that the rule asks for.
fn swept_sag(n: u32, finer: f64) -> f64 {
    let body = cantilever(n);
    let rate = (rate(&body) * finer).round();
    sag(body, rate)
}

fn sags() -> Vec<Reference> {
    let line = |n: u32| {
        let setting = format!("{} Hz, as recommended", rate(&cantilever(n)));
        Reference::new(format!("cantilever of {n}: sag [m]"), SAG, swept_sag(n, 1.0)).after("method §7; ρgA·L⁴/(8EI)").at(setting)
    };
    let error = |n, finer| swept_sag(n, finer) - SAG;
    vec![
        line(5).within(0.1, SWEEP),
        line(9).within(3e-2, SWEEP),
        line(17).within(8e-3, SWEEP),
        line(33).within(2e-3, SWEEP),
        line(65).within(6e-4, SWEEP),
        Reference::new("cantilever: sag's order in Δt", 2.0, order(error(9, 1.0), error(9, 2.0), 2.0))
            .after("method §3a")
            .at("9 particles, once and twice the recommended substeps")
            .within(3e-2, "the next order shows"),
        Reference::new("cantilever: sag's order in the resolution", 2.0, order(error(9, 1.0), error(17, 1.0), 2.0))
            .after("method §3a")
            .at("9 and 17 particles")
            .within(8e-2, "the next order shows"),
    ]
}

const SWEEP: &str = "a sweep's compliance, of second order in h and in Δt";

/// Shape of mode `k` at `x` of 1 m: cosh βx − cos βx − σ·(sinh βx − sin βx), and its slope.
fn shape(k: usize, x: f64) -> (f64, f64) {
    let b = BETA[k];
    let sigma = (b.cosh() + b.cos()) / (b.sinh() + b.sin());
    let (s, c) = ((b * x).sin(), (b * x).cos());
    let (sh, ch) = ((b * x).sinh(), (b * x).cosh());
    (ch - c - sigma * (sh - s), b * (sh + s - sigma * (ch - c)))
}

/// Frequency of mode `k`, from how often a bar pushed in its shape crosses the axis in that shape.
fn mode(mut body: Body, k: usize, rate: f64) -> f64 {
    let n = body.particles.len() as u32;
    let exact = frequency(k);
    let push = 2e-3 / BETA[k] * TAU * exact;
    let shapes: Vec<(f64, f64)> = (0..n).map(|i| shape(k, f64::from(i) / f64::from(n - 1))).collect();
    for (i, (y, slope)) in shapes.iter().enumerate().skip(1) {
        body.particles.velocity[i] = Vec3A::Y * (push * y) as f32;
        body.particles.angular_velocity[i] = Vec3A::Z * (push * slope) as f32;
    }
    let mut crossings = Crossings::default();
    for step in 1..=(5.0 / exact * rate) as usize {
        body.step(1.0 / rate, 1, 1);
        let amplitude: f64 = shapes.iter().enumerate().map(|(i, (y, _))| y * body.place(i).y * f64::from(body.particles.mass[i])).sum();
        crossings.sample(step as f64 / rate, amplitude);
    }
    1.0 / crossings.period()
}

/// f = β²/(2π)·√(EI/(ρA·L⁴))
fn frequency(k: usize) -> f64 {
    BETA[k] * BETA[k] / TAU * STIFFNESS.sqrt()
}

/// The last two are tolerances.
fn modes(k: usize, tolerance: f64, order_tolerance: f64) -> Vec<Reference> {
    let exact = frequency(k);
    let swept = |n: u32| {
        let body = cantilever(n);
        let rate = 2.0 * rate(&body);
        mode(body, k, rate)
    };
    let (coarse, fine) = (swept(17), swept(33));
    let line = |what: &str, exact, got| {
        Reference::new(format!("cantilever: f{}{what}", k + 1), exact, got).after("method §7; β²/(2π)·√(EI/(ρA·L⁴))")
    };
    let mut lines = vec![
        line(" [Hz]", exact, fine)
            .at("33 particles, twice the recommended substeps")
            .within(tolerance, "a particle's spin inertia, m·h²/4, is more than its piece's: of second order in h"),
        line("'s order in the resolution", 2.0, order(coarse - exact, fine - exact, 2.0))
            .at("17 and 33 particles")
            .within(order_tolerance, "the next order shows"),
    ];
    if k == 0 {
        let got = swept_sag(33, 2.0) * (TAU * fine).powi(2) / G;
        lines.push(
            Reference::new("cantilever: δ·ω₁²/g", BETA[0].powi(4) / 8.0, got)
                .after("method §7; β₁⁴/8")
                .at("33 particles, twice the recommended substeps")
                .within(3e-3, "twice f₁'s error"),
        );
    }
    lines
}

fn solved_directly() -> Vec<Reference> {
    let line = |what: &str, exact, got| Reference::new(format!("cantilever solved directly: {what}"), exact, got).after("method §3a");
    let arc = "its arc, of the order of (δ/L)²";
    vec![
        line("sag [m]", SAG, sag(direct(5), 60.0)).at("5 particles, 60 Hz").within(1.5e-4, arc),
        line("sag [m]", SAG, sag(direct(33), 60.0)).at("33 particles, 60 Hz").within(1.5e-4, arc),
        line("f1 [Hz]", frequency(0), mode(direct(33), 0, 960.0))
            .at("33 particles, 960 Hz")
            .within(3e-3, "a particle's spin inertia and implicit Euler's frequency, both of second order"),
    ]
}

/// A stout bar of rubber, clamped at its first particle, whose particles have the spin inertia of its section: radius of gyration √(I_p/A) = side/√6.
fn stout(n: u32) -> (Body, f64) {
    let section = Section::square(0.12);
    let material = Material { youngs_modulus: 1e5, poissons_ratio: 0.3, density: DENSITY };
    let radius = (2.0 * section.bending / section.area).sqrt();
    let shear_modulus = f64::from(material.youngs_modulus) / 2.6;
    let wave = (shear_modulus * f64::from(section.torsion) / f64::from(DENSITY * 2.0 * section.bending)).sqrt();
    (bar(n, &material, &section, radius), wave)
}

/// Exact and measured frequency of the first torsion mode, from the twist in its shape, sin(πx/2).
fn torsion_frequency(n: u32) -> (f64, f64) {
    let rate = 3840.0;
    let (mut body, wave) = stout(n);
    let exact = wave / 4.0;
    let shapes: Vec<f64> = (0..n).map(|i| (0.25 * TAU * f64::from(i) / f64::from(n - 1)).sin()).collect();
    for (w, s) in body.particles.angular_velocity.iter_mut().zip(&shapes) {
        *w = Vec3A::X * (0.1 * TAU * exact * s) as f32;
    }
    let mut crossings = Crossings::default();
    for step in 1..=(10.0 / exact * rate) as usize {
        body.step(1.0 / rate, 1, 1);
        let amplitude: f64 =
            shapes.iter().enumerate().map(|(i, s)| s * f64::from(quat_log(body.particles.rotation[i]).x * body.particles.mass[i])).sum();
        crossings.sample(step as f64 / rate, amplitude);
    }
    (exact, 1.0 / crossings.period())
}

fn torsion() -> Vec<Reference> {
    let ((exact, coarse), (_, fine)) = (torsion_frequency(21), torsion_frequency(41));
    let line = |what: &str, exact, got| Reference::new(format!("bar: torsion f1{what}"), exact, got).after("method §7; √(GJ/ρI_p)/(4L)");
    vec![
        line(" [Hz]", exact, fine).at("41 particles, 3840 Hz").within(2e-4, "lumped inertia: (π·h/(2L))²/24"),
        line("'s order in the resolution", 2.0, order(coarse - exact, fine - exact, 2.0))
            .at("21 and 41 particles")
            .within(1e-2, "the next order shows"),
    ]
}

/// How far from linear the twist is along a bar whose ends are clamped 1.2 rad apart, as a share of that.
fn unevenness(rate: f64) -> f64 {
    let n = 11;
    let (mut body, _) = stout(n);
    let last = n as usize - 1;
    body.particles.pin(last, true, true);
    body.particles.rotation[last] = quat_exp(Vec3A::X * 1.2);
    body.drag = 10.0;
    for _ in 0..(5.0 * rate) as usize {
        body.step(1.0 / rate, 1, 1);
    }
    let off = |i: usize| f64::from(quat_log(body.particles.rotation[i]).x) - 1.2 * i as f64 / last as f64;
    (0..=last).map(|i| off(i).abs()).fold(0.0, f64::max) / 1.2
}

fn twist() -> Vec<Reference> {
    let line = |what: &str, exact, got| Reference::new(format!("bar twisted by 1.2 rad: {what}"), exact, got).after("method §7");
    vec![
        line("farthest from linear, of its twist", 0.0, unevenness(3840.0))
            .at("11 particles, 3840 Hz")
            .within(3e-5, "every other edge is solved later: of second order in Δt"),
        line("order of that in Δt", 2.0, order(unevenness(480.0), unevenness(960.0), 2.0))
            .at("480 and 960 Hz")
            .within(6e-3, "the next order shows"),
    ]
}
