//! Which members of a group turn, and from what state: the paper's way, the conserving one, and the conserving one by Jacobi's method, side by side.

use core::fmt::Write;
use std::time::Instant;

use glam::{DVec3, Vec3A};
use polpo_solver::{Stiffness, Sweep, Turning, quat_exp, quat_log};

use crate::body::{Body, Matching};
use crate::jacobi::{Divisor, Jacobi};
use crate::soft::{Random, default_stiffness, lattice, octopus};

/// What makes a body of one of the columns.
type Way = fn() -> Matching;

const WAYS: [(&str, Way); 4] = [
    ("main only", || Matching::GaussSeidel(Turning::MainOnly)),
    ("all members", || Matching::GaussSeidel(Turning::AllMembers)),
    ("all, Jacobi over D", || Matching::Jacobi(Jacobi::new(Divisor::Most))),
    ("all, Jacobi implicit", || Matching::Jacobi(Jacobi::new(Divisor::Implicit))),
];

/// Measures both ways of [`Turning`] one group after the other, and Jacobi's method with both divisors, and tells the results as a table in Markdown. The last line of it depends on the machine.
pub fn orientation_table() -> String {
    let mut out = format!("| | {} |\n|---|---|---|---|---|\n", WAYS.map(|(name, _)| name).join(" | "));
    // Writing to a string cannot fail.
    let mut row = |what: &str, measure: &dyn Fn(Way) -> String| {
        let _ = writeln!(out, "| {what} | {} |", WAYS.map(|(_, way)| measure(way)).join(" | "));
    };
    for (name, share) in [("1", 1.0), ("0.1", 0.1)] {
        row(&format!("L that one projection of one group leaves unbalanced, share {name}, of what it moves"), &|t| {
            percent(residual(share, t))
        });
    }
    for (name, share) in [("share 1", Stiffness::Fraction(1.0)), ("25 Hz", Stiffness::hertz(25.0))] {
        row(&format!("chain of 10 let go deformed, at rest, {name}, `KeepMomentum` off: greatest \\|L\\| in 10 s \\[kg·m²/s\\]"), &|t| {
            format!("{:.3}", spun_up(t, share))
        });
    }
    for (name, body) in [("chain of 10", chain as fn() -> Body), ("octopus of 75", swimmer)] {
        for keep in [false, true] {
            let with = if keep { "on" } else { "off" };
            row(&format!("free {name}, 10 s, `KeepMomentum` {with}: L lost"), &|t| percent(flight(body(), t, keep).angular));
            row(&format!("its energy at the end and at most, of that at the start, `KeepMomentum` {with}"), &|t| {
                let flight = flight(body(), t, keep);
                format!("{}, {}", percent(flight.left), percent(flight.highest))
            });
        }
    }
    for (rate, iterations) in [(60.0, 1), (60.0, 4), (60.0, 16), (60.0, 64), (960.0, 1), (3840.0, 1)] {
        row(&format!("sag of a clamped bar of 8×2×2 at 12 Hz, {rate} Hz × {iterations} \\[m\\]"), &|t| sag(t, rate, iterations));
    }
    for (name, body) in [("a lattice of 8×8×8", lattice([8, 8, 8], 0.01)), ("an octopus of 75", swimmer())] {
        row(&format!("groups of {name} that may be solved side by side, on average"), &|t| {
            let sets = if matches!(t(), Matching::Jacobi(_)) { 1 } else { body.groups.batch_count() };
            format!("{:.0}", body.groups.len() as f64 / sets as f64)
        });
    }
    row("time a group of a lattice of 8×8×8 \\[ns\\]", &|t| format!("{:.0}", time(t)));
    out
}

fn percent(share: f64) -> String {
    if share < 1e-3 { format!("{:.1e}", share) } else { format!("{:.2} %", 100.0 * share) }
}

/// |Σ m·r×Δx + I·θ| over the sum of the terms' lengths, about the places where the group found its members; the mean over random states.
fn residual(share: f32, way: Way) -> f64 {
    let mut random = Random(3);
    let (mut sum, count) = (0.0, 200);
    for _ in 0..count {
        let mut body = lattice([3, 3, 3], 0.01);
        body.matching = way();
        (body.shape, body.only_groups_of) = (Stiffness::Fraction(share), Some(vec![13]));
        let p = &mut body.particles;
        for i in 0..p.len() {
            p.position[i] += random.vector() * 0.02;
            p.rotation[i] = quat_exp(random.vector() * 0.3);
        }
        let before = p.clone();
        body.sweep(Sweep::only(0.01));
        let (mut total, mut size) = (DVec3::ZERO, 0.0);
        for i in 0..before.len() {
            let x = before.position[i].as_dvec3();
            let way = (body.particles.position[i] - before.position[i]).as_dvec3() * f64::from(before.mass[i]);
            let turn = quat_log(body.particles.rotation[i] * before.rotation[i].inverse()).as_dvec3() * f64::from(before.inertia[i]);
            total += x.cross(way) + turn;
            // Lengths about the group's own middle.
            size += (x - before.position[13].as_dvec3()).cross(way).length() + turn.length();
        }
        sum += total.length() / size;
    }
    sum / f64::from(count)
}

fn chain() -> Body {
    Body::row(10, 0.9, Vec3A::X, 0.05)
}

fn swimmer() -> Body {
    octopus()
}

struct Flight {
    angular: f64,
    left: f64,
    highest: f64,
}

/// Ten seconds of a body that is thrown, spun and shaken, 60 steps a second of 5 substeps.
fn flight(mut body: Body, way: Way, keep: bool) -> Flight {
    default_stiffness(&mut body);
    (body.matching, body.keep_momentum) = (way(), keep);
    let mut random = Random(7);
    body.particles.set_rigid_velocity(Vec3A::X, Vec3A::new(1.0, 3.0, 2.0));
    for v in &mut body.particles.velocity {
        *v += random.vector() * 0.2;
    }
    let before = body.carried();
    let mut highest = 0.0f64;
    for _ in 0..600 {
        body.step(1.0 / 60.0, 5, 1);
        highest = highest.max(body.carried().energy);
    }
    let after = body.carried();
    // Of the motion about the centre of mass: that of the centre is kept anyhow.
    let inner = |c: &crate::body::Carried, energy: f64| energy - 0.5 * c.linear.length_squared() / c.mass;
    let start = inner(&before, before.energy);
    Flight {
        angular: after.angular.distance(before.angular) / before.angular.length(),
        left: inner(&after, after.energy) / start,
        highest: inner(&before, highest) / start,
    }
}

/// The greatest |L| \[kg·m²/s\] in ten seconds of a body that has none: a chain, bent at random by a third of its spacing and let go, with nothing but shape matching. The mean of ten.
fn spun_up(way: Way, share: Stiffness) -> f64 {
    let mut random = Random(11);
    let mut sum = 0.0;
    for _ in 0..10 {
        let mut body = chain();
        (body.shape, body.matching, body.keep_momentum) = (share, way(), false);
        for x in &mut body.particles.position {
            *x += random.vector() * 0.03;
        }
        let mut greatest = 0.0f64;
        for _ in 0..600 {
            body.step(1.0 / 60.0, 5, 1);
            greatest = greatest.max(body.carried().angular.length());
        }
        sum += greatest;
    }
    sum / 10.0
}

fn sag(way: Way, rate: f64, iterations: u32) -> String {
    let mut body = crate::convergence::soft_bar(12.0);
    (body.matching, body.drag) = (way(), 20.0);
    (body.tension, body.compression, body.torsion) = (Stiffness::OFF, Stiffness::OFF, Stiffness::OFF);
    for _ in 0..(4.0 * rate) as usize {
        body.step(1.0 / rate, 1, iterations);
    }
    format!("{:.4}", -body.place(7).y)
}

/// The fastest of many rounds \[ns\].
fn time(way: Way) -> f64 {
    let mut body = lattice([8, 8, 8], 0.01);
    (body.shape, body.matching) = (Stiffness::hertz(25.0), way());
    let mut random = Random(5);
    for x in &mut body.particles.position {
        *x += random.vector() * 0.002;
    }
    let mut best = f64::INFINITY;
    for _ in 0..500 {
        let start = Instant::now();
        for _ in 0..2 {
            body.sweep(Sweep::only(1.0 / 300.0));
        }
        best = best.min(start.elapsed().as_secs_f64());
    }
    best * 1e9 / (2 * body.groups.len()) as f64
}
