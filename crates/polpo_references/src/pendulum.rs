//! The pendulum: a rigid group of two points, one of them pinned, against the elliptic integral.

use glam::Vec3A;
use polpo_solver::{Stiffness, quat_exp};

use crate::body::{Body, G, POINT};
use crate::measure::{Crossings, agm, drift, order};
use crate::{Measurement, Reference};

pub(crate) const MEASUREMENTS: &[Measurement] = &[
    Measurement { name: "pendulum/10", run: || pendulum(10, 2e-7, 9e-7) },
    Measurement { name: "pendulum/45", run: || pendulum(45, 8e-7, 6e-7) },
    Measurement { name: "pendulum/90", run: || pendulum(90, 5e-6, 1.5e-6) },
    Measurement { name: "pendulum/150", run: || pendulum(150, 2.4e-6, 4e-6) },
    Measurement { name: "pendulum/edge", run: edge },
];

/// T = 2π·√(L/g)/agm(1, cos(θ/2)) for the length L = 1 m.
fn exact(degrees: u32) -> f64 {
    core::f64::consts::TAU / G.sqrt() / agm(1.0, (0.5 * f64::from(degrees).to_radians()).cos())
}

struct Run {
    crossings: Crossings,
    /// Of energy over ten seconds, as a share of what swings.
    drift: f64,
}

fn run(degrees: u32, rate: f64, rigid: bool) -> Run {
    let angle = (degrees as f32).to_radians();
    let mut body = Body::row(2, 1.0, quat_exp(Vec3A::Z * angle) * -Vec3A::Y, POINT);
    body.fall();
    if rigid {
        body.make_links();
    } else {
        (body.tension, body.compression) = (Stiffness::RIGID, Stiffness::RIGID);
    }
    body.particles.pin(0, true, false);
    let (mut crossings, mut energy) = (Crossings::default(), Vec::new());
    let swing = G * (body.place(1).y + 1.0);
    for k in 1..=(10.0 * rate) as usize {
        let (v, y) = (body.particles.velocity[1].as_dvec3(), body.place(1).y);
        body.step(1.0 / rate, 1, 1);
        crossings.sample(k as f64 / rate, body.place(1).x);
        // A substep's velocity is that of its middle; the place before it lies between two of them.
        let between = (v + body.particles.velocity[1].as_dvec3()) * 0.5;
        energy.push((0.5 * between.length_squared() + G * y) / swing);
    }
    Run { crossings, drift: drift(&energy) }
}

/// `period` and `energy` are tolerances.
fn pendulum(degrees: u32, period: f64, energy: f64) -> Vec<Reference> {
    let exact = exact(degrees);
    let line = |what: &str, exact, got| {
        Reference::new(format!("pendulum from {degrees}°: {what}"), exact, got).after("method §7; elliptic integral by the agm")
    };
    let fine = run(degrees, 960.0, true);
    let error = |rate| run(degrees, rate, true).crossings.period() - exact;
    vec![
        line("period of a rigid link [s]", exact, fine.crossings.period())
            .at("960 Hz")
            .within(period, "second order in ω·Δt, which at the fastest is 7e-3 to 1e-2"),
        line("order in Δt", 2.0, order(error(60.0), error(120.0), 2.0)).at("60 and 120 Hz").within(1.5e-2, "at 60 Hz the next order shows"),
        line("energy gained in 10 s", 0.0, fine.drift)
            .at("960 Hz")
            .within(energy, "rounding of the bob in f32; impulses at joints lose none"),
    ]
}

const LOSS: &str = "a projection loses energy to first order in Δt, the more the farther it swings";

fn edge() -> Vec<Reference> {
    let first = |degrees, rate| {
        let crossings = run(degrees, rate, false).crossings;
        crossings.time(2) - crossings.time(0)
    };
    let line = |degrees: u32| {
        Reference::new(format!("pendulum from {degrees}°: first period of a stiff edge [s]"), exact(degrees), first(degrees, 3840.0))
            .after("method §7")
            .at("3840 Hz")
    };
    let order = order(first(45, 1920.0) - exact(45), first(45, 3840.0) - exact(45), 2.0);
    vec![
        line(45).within(4e-4, LOSS),
        line(90).within(4e-3, LOSS),
        line(150).within(5e-2, LOSS),
        Reference::new("pendulum from 45°: a stiff edge's order in Δt", 1.0, order)
            .after("method §7")
            .at("1920 and 3840 Hz")
            .within(6e-2, "the next order shows"),
    ]
}
