//! Rigs of a material against beam theory and finite elements: how well the rigger calibrates.

use core::f64::consts::TAU;
use core::fmt::Write;

use glam::{DVec3, Quat, Vec3, Vec3A};
use polpo_rig::{Amount, Fidelity, Recipe, RecipeMaterial, build_rig};

use crate::body::Body;
use crate::bricks::Bricks;
use crate::cell_body::{Calibrated, CellBody};
use crate::measure::Crossings;
use crate::solids::{ANGLE, BLOCK, SLENDER, STOUT, Solid, TAPERED, WIRE};
use crate::statics::{Motion, Stiff};
use crate::timoshenko::Beam;
use crate::{Measurement, Reference};

const YOUNG: f32 = 1e7;
const DENSITY: f32 = 1000.0;

/// What is right.
pub(crate) enum Exact {
    Beam(Beam),
    /// The fields under gravity of 1 m/s² along x, y and z, and under a torque of 1 N·m at the far face; and ω².
    Bricks(Box<Bricks>, Vec<Vec<f64>>, f64),
}

impl Exact {
    pub(crate) fn beam(side: fn(f64) -> f64, nu: f32) -> Self {
        let (e, nu) = (f64::from(YOUNG), f64::from(nu));
        Self::Beam(Beam { side, moduli: [e, e / (2.0 * (1.0 + nu))], density: f64::from(DENSITY) })
    }

    /// `cuts` elements a cube.
    pub(crate) fn bricks(solid: &Solid, cuts: i32, nu: f32) -> Self {
        let low = (solid.place)(Vec3::ZERO).as_dvec3();
        let side = ((solid.place)(Vec3::X) - (solid.place)(Vec3::ZERO)).x.abs();
        let size = f64::from(side) / f64::from(cuts);
        let has = |x: DVec3| (solid.has)(((x - low) / f64::from(side)).floor().as_ivec3());
        let counts = solid.counts.map(|n| (n * cuts) as usize);
        let bricks = Bricks::new(counts, low, size, has, f64::from(YOUNG), f64::from(nu), f64::from(DENSITY));
        let mut fields: Vec<Vec<f64>> = DVec3::AXES.map(|a| bricks.respond(|n| a * bricks.mass[n], Vec::new())).into();
        let area = bricks.far_face();
        let middle = middle_of((0..area.len()).map(|n| (bricks.place(n), area[n])));
        let push = |n: usize| DVec3::X.cross(bricks.place(n) - middle) * area[n];
        let torque: f64 = (0..area.len()).map(|n| DVec3::X.cross(bricks.place(n) - middle).dot(push(n))).sum();
        fields.push(bricks.respond(|n| push(n) / torque, Vec::new()));
        let soft = if solid.counts[2] < solid.counts[1] { fields[2].clone() } else { fields[1].clone() };
        let omega2 = bricks.first_mode(soft);
        Self::Bricks(Box::new(bricks), fields, omega2)
    }
}

fn middle_of(squares: impl Iterator<Item = (DVec3, f64)>) -> DVec3 {
    let (mut sum, mut area) = (DVec3::ZERO, 0.0);
    for (x, a) in squares {
        sum += x * a;
        area += a;
    }
    sum / area
}

/// Ways to lie: the rigger has no seed, but voxels lie along the axes.
pub(crate) const TURNS: [[f32; 4]; 5] =
    [[0.0, 0.0, 0.0, 1.0], [0.3, 0.1, -0.2, 0.9], [-0.1, 0.4, 0.35, 0.8], [0.2, -0.5, 0.1, 0.85], [0.05, 0.03, 0.38, 0.92]];

/// The solid in cells, clamped, in its own axes.
pub(crate) fn body(solid: &Solid, count: usize, nu: f32, sample: usize) -> CellBody {
    let turn = Quat::from_array(TURNS[sample]).normalize();
    let material = RecipeMaterial { youngs_modulus: YOUNG, poissons_ratio: nu, retardation: 0.0, fidelity: Fidelity::Cells };
    let recipe = Recipe { amount: Amount::Particles(count), density: DENSITY, material: Some(material), ..Recipe::default() };
    let rig = build_rig(&solid.mesh(turn, Vec3::new(0.0, 0.013, 0.0)), &recipe).expect("a solid can be rigged");
    let cells = rig.cells.clone().expect("it has a material");
    let mut body = CellBody::new(&rig, &cells, turn.inverse(), turn.inverse() * Vec3::new(0.0, -0.013, 0.0));
    body.hold(&solid.face(false));
    body
}

/// By how much of `exact` the motion is too large, by least squares.
fn excess(got: &[DVec3], exact: &[DVec3]) -> f64 {
    let dot = |a: &[DVec3]| a.iter().zip(exact).map(|(a, b)| a.dot(*b)).sum::<f64>();
    dot(got) / dot(exact) - 1.0
}

/// Relative errors: sag, sag across, first frequency, stretch, twist.
pub(crate) fn errors(solid: &Solid, body: &CellBody, exact: &Exact, capped: bool) -> [f64; 5] {
    let Calibrated { particles, edges, rings } = body.calibrate(capped).expect("a real material");
    let k = Stiff::new(&particles, &edges, &rings, body.cells);
    let x = |i: usize| particles.rest_position[i].as_dvec3();
    let each = |f: &dyn Fn(usize) -> DVec3| (0..body.cells).map(f).collect::<Vec<DVec3>>();
    let fall = |a: DVec3| k.respond(&(0..body.cells).map(|i| [a * f64::from(particles.mass[i]), DVec3::ZERO]).collect::<Vec<Motion>>());
    let [along, down, across] = DVec3::AXES.map(fall);
    let squares = solid.face(true);
    let middle = middle_of(squares.iter().copied());
    let mut loads = vec![[DVec3::ZERO; 2]; body.cells];
    let mut torque = 0.0;
    for (cell, facet) in body.on_face(&squares, DVec3::X) {
        let (area, c) = (f64::from(facet.area.x), facet.centroid.as_dvec3());
        let force = DVec3::X.cross(c - middle) * area;
        let own = DVec3::X * f64::from(facet.moments.y_axis.y + facet.moments.z_axis.z);
        loads[cell as usize] = [force, own + (c - x(cell as usize)).cross(force)];
        torque += own.x + (c - middle).cross(force).x;
    }
    loads.iter_mut().for_each(|l| *l = l.map(|v| v / torque));
    let twisted = k.respond(&loads);
    let omega2 = |mut u: Vec<Motion>| {
        let mut omega2 = 0.0;
        for _ in 0..20 {
            let push: Vec<Motion> =
                u.iter().enumerate().map(|(i, u)| [u[0] * f64::from(particles.mass[i]), u[1] * f64::from(particles.inertia[i])]).collect();
            let next = k.respond(&push);
            let dot = |a: &[Motion]| a.iter().zip(&push).map(|(a, p)| a[0].dot(p[0]) + a[1].dot(p[1])).sum::<f64>();
            omega2 = dot(&u) / dot(&next);
            let norm = dot(&next).sqrt();
            u = next.iter().map(|v| v.map(|v| v / norm)).collect();
        }
        omega2
    };
    let moved = |m: &[Motion]| each(&|i| m[i][0]);
    match exact {
        Exact::Beam(beam) => {
            let along_beam = |field: &[f64], axis: DVec3| each(&|i| axis * Beam::at(field, x(i).x));
            let (sag, stretch, twist) = (beam.bend(&beam.weight()), beam.stretch(&beam.weight()), beam.twist());
            let only = |m: &[Motion], axis: DVec3| each(&|i| axis * m[i][0].dot(axis));
            [
                excess(&only(&down, DVec3::Y), &along_beam(&sag, DVec3::Y)),
                excess(&only(&across, DVec3::Z), &along_beam(&sag, DVec3::Z)),
                (omega2(down) / beam.first_mode()).sqrt() - 1.0,
                excess(&only(&along, DVec3::X), &along_beam(&stretch, DVec3::X)),
                excess(&each(&|i| DVec3::X * twisted[i][1].x), &along_beam(&twist, DVec3::X)),
            ]
        }
        Exact::Bricks(bricks, fields, first) => {
            let at = |k: usize| each(&|i| bricks.at(&fields[k], x(i)));
            let mode = if solid.counts[2] < solid.counts[1] { across.clone() } else { down.clone() };
            [
                excess(&moved(&down), &at(1)),
                excess(&moved(&across), &at(2)),
                (omega2(mode) / first).sqrt() - 1.0,
                excess(&moved(&along), &at(0)),
                excess(&moved(&twisted), &at(3)),
            ]
        }
    }
}

/// The mean of all samples and the worst, of each figure.
fn all(solid: &Solid, exact: &Exact, samples: &[CellBody], fidelity: Fidelity, capped: bool) -> [(f64, f64); 5] {
    let errors = |sample: &CellBody| errors(solid, &CellBody { fidelity, ..sample.clone() }, exact, capped);
    let all: Vec<[f64; 5]> = samples.iter().map(errors).collect();
    core::array::from_fn(|c| (all.iter().map(|e| e[c]).sum::<f64>() / all.len() as f64, all.iter().map(|e| e[c].abs()).fold(0.0, f64::max)))
}

/// A solid, its reference for a Poisson's ratio, and how many cells it comes in.
type Case = (Solid, fn(&Solid, f32) -> Exact, &'static [usize]);

const CASES: [Case; 6] = [
    (WIRE, |_, nu| Exact::beam(|_| 0.03, nu), &[5, 9, 17, 33]),
    (SLENDER, |_, nu| Exact::beam(|_| 0.1, nu), &[20, 60, 150, 300]),
    (STOUT, |_, nu| Exact::beam(|_| 0.2, nu), &[20, 60, 150, 300]),
    (TAPERED, |_, nu| Exact::beam(|x| 0.12 - 0.06 * x, nu), &[20, 60, 150, 300]),
    (ANGLE, |solid, nu| Exact::bricks(solid, 8, nu), &[20, 60, 150, 300]),
    (BLOCK, |solid, nu| Exact::bricks(solid, 4, nu), &[20, 60, 150, 300]),
];

/// How far rigs of a material are from beam theory, or from finite elements where there is none, without a solver: per cent too much, the mean of five samples and in brackets the worst, in Markdown. Takes minutes.
///
/// `only`: those whose name contains it.
pub fn material_table(only: &str) -> String {
    let nu = NU;
    let mut out = String::from("| solid | cells | form | sag | sag across | f₁ | stretch | twist |\n|---|---|---|---|---|---|---|---|\n");
    for (solid, exact, counts) in CASES.iter().filter(|c| c.0.name.contains(only)) {
        let exact = exact(solid, nu);
        for &count in *counts {
            let samples: Vec<CellBody> = (0..TURNS.len()).map(|sample| body(solid, count, nu, sample)).collect();
            for (form, fidelity, capped) in
                [("cells", Fidelity::Cells, false), ("edges", Fidelity::Edges, false), ("limb", Fidelity::Cells, true)]
            {
                if capped && samples.iter().any(|sample| sample.limb.is_none()) {
                    continue;
                }
                let figures = all(solid, &exact, &samples, fidelity, capped);
                let figures = figures.map(|(mean, worst)| format!("{:+.1} ({:.1})", 100.0 * mean, 100.0 * worst));
                // Writing to a string cannot fail.
                let _ = writeln!(out, "| {} | {count} | {form} | {} |", solid.name, figures.join(" | "));
            }
        }
    }
    out
}

pub(crate) const MEASUREMENTS: &[Measurement] = &[
    Measurement { name: "material/bar", run: || swept(&SLENDER, |_| 0.1, 60, false) },
    Measurement { name: "material/limb", run: || swept(&SLENDER, |_| 0.1, 60, true) },
    Measurement { name: "material/chain", run: || swept(&WIRE, |_| 0.03, 9, false) },
    Measurement { name: "material/taper", run: || swept(&TAPERED, |x| 0.12 - 0.06 * x, 20, false) },
    Measurement { name: "material/five chains", run: || held(&WIRE, &Exact::beam(|_| 0.03, NU), 5, 0.05, "a chain of few links") },
    Measurement { name: "material/five stout bars", run: || held(&STOUT, &Exact::beam(|_| 0.2, NU), 20, 0.1, IRREGULAR) },
    Measurement { name: "material/five angles", run: || held(&ANGLE, &Exact::bricks(&ANGLE, 4, NU), 20, 0.1, IRREGULAR) },
    Measurement { name: "material/five blocks", run: || held(&BLOCK, &Exact::bricks(&BLOCK, 3, NU), 20, 0.1, IRREGULAR) },
];

/// Poisson's ratio.
const NU: f32 = 0.3;

/// The mean of all samples, without a solver.
fn held(solid: &Solid, exact: &Exact, count: usize, tolerance: f64, why: &'static str) -> Vec<Reference> {
    let samples: Vec<CellBody> = (0..TURNS.len()).map(|sample| body(solid, count, NU, sample)).collect();
    let figures = all(solid, exact, &samples, Fidelity::Cells, false);
    let source = match exact {
        Exact::Beam(_) => "Timoshenko's beam; method §3b",
        Exact::Bricks(..) => "finite elements with incompatible modes; method §3b",
    };
    let line = |(what, (mean, _)): (&str, (f64, f64))| {
        let name = format!("rigged {} of {count}: {what}, of the exact", solid.name);
        Reference::new(name, 1.0, 1.0 + mean).after(source).at("without a solver, the mean of five").within(tolerance, why)
    };
    ["sag", "sag across", "f1", "stretch", "twist"].into_iter().zip(figures).map(line).collect()
}

/// A rigged bar, clamped and swept with the substeps that the rule asks for: sag and first frequency. Stretch and twist without a solver.
fn swept(solid: &Solid, side: fn(f64) -> f64, count: usize, capped: bool) -> Vec<Reference> {
    let nu = NU;
    let exact = Exact::beam(side, nu);
    let Exact::Beam(beam) = &exact else { return Vec::new() };
    let cells = body(solid, count, nu, 1);
    let [.., stretch, twist] = errors(solid, &cells, &exact, capped);
    let Calibrated { particles, edges, rings } = cells.calibrate(capped).expect("a real material");
    let substeps = edges.recommended_substeps(&particles, 1.0 / 60.0);
    let (sag, omega2) = (beam.bend(&beam.weight()), beam.first_mode());
    let mut body = Body::balls([Vec3A::ZERO], 1e-3);
    (body.particles, body.rods, body.rings) = (particles, Some(edges), rings);
    // The share of the exact sag by least squares, in a field that bends it little.
    let gravity = 0.005 / sag[sag.len() - 1];
    let hung: Vec<f64> = (0..count).map(|i| gravity * Beam::at(&sag, f64::from(body.particles.rest_position[i].x))).collect();
    let shape = |body: &Body| {
        let fallen = |i: usize| f64::from(body.particles.rest_position[i].y - body.particles.position[i].y);
        (0..count).map(|i| fallen(i) * hung[i]).sum::<f64>() / hung.iter().map(|h| h * h).sum::<f64>()
    };
    let frequency = omega2.sqrt() / TAU;
    body.gravity = Vec3A::NEG_Y * gravity as f32;
    body.drag = (1.8 * TAU * frequency) as f32;
    let (mut sum, mut number) = (0.0, 0);
    let frames = (60.0 * 3.0 / frequency).max(60.0) as usize;
    for k in 0..frames {
        body.step(1.0 / 60.0, substeps, 1);
        if k * 6 >= frames * 5 {
            sum += shape(&body);
            number += 1;
        }
    }
    body.gravity = Vec3A::ZERO;
    body.drag = 0.0;
    let mut crossings = Crossings::default();
    for k in 1..=(5.0 / frequency * 60.0 * f64::from(substeps)) as usize {
        body.step(1.0 / (60.0 * f64::from(substeps)), 1, 1);
        crossings.sample(k as f64 / (60.0 * f64::from(substeps)), shape(&body));
    }
    let form = if capped { ", as a limb" } else { "" };
    let line = |what: &str, got: f64| {
        Reference::new(format!("rigged {} of {count}{form}: {what}", solid.name), 1.0, got).after("Timoshenko's beam; method §3b")
    };
    let solved = format!("{substeps} substeps at 60 Hz, as recommended");
    let mut lines = vec![
        line("sag, of the exact", sum / f64::from(number)).at(solved.as_str()).within(0.1, IRREGULAR),
        line("f1, of the exact", 1.0 / (crossings.period() * frequency)).at(solved.as_str()).within(0.1, IRREGULAR),
        line("twist, of the exact", 1.0 + twist).at("without a solver").within(0.1, "cells of less than two across cannot warp"),
    ];
    if !capped {
        lines.push(line("stretch, of the exact", 1.0 + stretch).at("without a solver").within(0.05, IRREGULAR));
    }
    lines
}

const IRREGULAR: &str = "few irregular cells across, and a sweep's compliance";
