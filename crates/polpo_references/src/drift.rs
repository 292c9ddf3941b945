//! Ten seconds of free flight: momentum, angular momentum and energy.

use glam::Vec3A;
use polpo_solver::{CalibratedEdges, Material, Section};

use crate::body::Body;
use crate::soft::{Random, default_stiffness, lattice};
use crate::{Measurement, Reference};

pub(crate) const MEASUREMENTS: &[Measurement] = &[
    Measurement { name: "drift/soft", run: soft },
    Measurement { name: "drift/rods", run: rods },
    Measurement { name: "drift/links", run: links },
];

const ROUNDING: &str = "sums of f32, thousands of substeps long";

/// Throws, spins and shakes the body for 10 s at 60 Hz, and tells what has become of P, L and the highest E. The last are the tolerances of the three.
fn fly(name: &str, mut body: Body, substeps: u32, [p, l, e]: [f64; 3]) -> Vec<Reference> {
    let mut random = Random(7);
    body.particles.set_rigid_velocity(Vec3A::new(1.0, 0.5, -0.3), Vec3A::new(1.0, 3.0, 2.0));
    for v in &mut body.particles.velocity {
        *v += random.vector() * 0.3;
    }
    // The first step makes the motion one that rigid links allow.
    body.step(1.0 / 60.0, substeps, 1);
    let before = body.carried();
    let mut highest = f64::MIN;
    for _ in 0..600 {
        body.step(1.0 / 60.0, substeps, 1);
        highest = highest.max(body.carried().energy);
    }
    let after = body.carried();
    let scale = (2.0 * before.energy * before.mass).sqrt();
    let line = |what: &str, got: f64| {
        Reference::new(format!("{name}, 10 s free: {what}"), 0.0, got).after("method §7; conservation").at(format!("60 Hz × {substeps}"))
    };
    vec![
        line("drift of P, of √(2Em)", after.linear.distance(before.linear) / scale).within(p, ROUNDING),
        line("drift of L, of L", after.angular.distance(before.angular) / before.angular.length()).within(l, ROUNDING),
        line("kinetic energy gained, of E", (highest / before.energy - 1.0).max(0.0))
            .within(e, "rounding in f32; the method itself only loses"),
    ]
}

fn soft() -> Vec<Reference> {
    let mut body = lattice([3, 3, 3], 0.01);
    default_stiffness(&mut body);
    fly("soft body", body, 5, [2.5e-6, 2.5e-5, 1e-6])
}

fn rods() -> Vec<Reference> {
    let mut body = Body::row(9, 1.0, Vec3A::X, 0.02);
    let material = Material { youngs_modulus: 1e6, poissons_ratio: 0.3, density: 1000.0 };
    body.rods = Some(
        CalibratedEdges::rods(&mut body.particles, &body.edges, &material, &Section::square(0.05), Some(0.12), &[])
            .expect("a real material"),
    );
    fly("rod", body, 16, [4e-6, 2e-5, 1e-7])
}

fn links() -> Vec<Reference> {
    let mut body = Body::row(9, 1.0, Vec3A::X, 0.02);
    body.make_links();
    fly("chain of rigid links", body, 10, [6e-8, 1e-7, 8e-7])
}
