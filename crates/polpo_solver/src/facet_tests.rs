//! Bodies of facets against beam theory: how well irregular cells are calibrated.

use glam::{DVec3, Vec3A};

use crate::facet_bodies::{Body, DENSITY, Solid, Stiff};
use crate::{CalibratedEdges, Material, Rings};

/// Timoshenko's beam, of squares of `side`, clamped at x = 0 and 1 m long, in stations.
struct Beam {
    side: fn(f64) -> f64,
    material: Material,
}

const STATIONS: usize = 1000;

impl Beam {
    fn sum(values: impl Iterator<Item = f64>) -> Vec<f64> {
        values
            .scan(0.0, |sum, v| {
                let middle = *sum + 0.5 * v / STATIONS as f64;
                *sum += v / STATIONS as f64;
                Some(middle)
            })
            .collect()
    }

    fn from_end(values: &[f64]) -> Vec<f64> {
        let mut sums = Self::sum(values.iter().rev().copied());
        sums.reverse();
        sums
    }

    fn sides(&self) -> impl Iterator<Item = f64> {
        (0..STATIONS).map(|k| (self.side)((k as f64 + 0.5) / STATIONS as f64))
    }

    fn weight(&self) -> Vec<f64> {
        self.sides().map(|a| f64::from(DENSITY) * 9.81 * a * a).collect()
    }

    /// How far it bends and shears under `load` \[N/m\].
    fn bend(&self, load: &[f64]) -> Vec<f64> {
        let [e, g] = [self.material.youngs_modulus, self.material.shear_modulus()].map(f64::from);
        let shear = Self::from_end(load);
        let moment = Self::from_end(&shear);
        let turn = Self::sum(moment.iter().zip(self.sides()).map(|(m, a)| m * 12.0 / (e * a * a * a * a)));
        Self::sum(turn.iter().zip(&shear).zip(self.sides()).map(|((turn, v), a)| turn + v / (5.0 / 6.0 * g * a * a)))
    }

    fn stretch(&self, load: &[f64]) -> Vec<f64> {
        let e = f64::from(self.material.youngs_modulus);
        Self::sum(Self::from_end(load).iter().zip(self.sides()).map(|(f, a)| f / (e * a * a)))
    }

    fn twist(&self, torque: f64) -> Vec<f64> {
        let g = f64::from(self.material.shear_modulus());
        Self::sum(self.sides().map(|a| torque / (g * 0.1406 * a * a * a * a)))
    }

    /// ω² of the first mode.
    fn first_mode(&self) -> f64 {
        let mut u: Vec<f64> = vec![1.0; STATIONS];
        let mut omega2 = 0.0;
        for _ in 0..20 {
            let load: Vec<f64> = u.iter().zip(self.weight()).map(|(u, w)| u * w / 9.81).collect();
            let next = self.bend(&load);
            omega2 = u.iter().zip(&load).map(|(u, f)| u * f).sum::<f64>() / next.iter().zip(&load).map(|(u, f)| u * f).sum::<f64>();
            let largest = next[STATIONS - 1];
            u = next.iter().map(|u| u / largest).collect();
        }
        omega2
    }

    fn at(values: &[f64], x: f32) -> f64 {
        values[((x * STATIONS as f32) as usize).min(STATIONS - 1)]
    }
}

/// `got` against `exact` by least squares over the cells.
fn fit(body: &Body, got: impl Fn(usize) -> f64, exact: impl Fn(usize) -> f64) -> f64 {
    let (mut above, mut below) = (0.0, 0.0);
    for i in 0..body.cells {
        above += got(i) * exact(i);
        below += exact(i) * exact(i);
    }
    above / below - 1.0
}

/// ω² of the first mode, by inverse iteration from `u`.
fn first_mode(body: &Body, k: &Stiff, mut u: Vec<[DVec3; 2]>) -> f64 {
    let mut omega2 = 0.0;
    for _ in 0..20 {
        let push = |i: usize| [u[i][0] * f64::from(body.p.mass[i]), u[i][1] * f64::from(body.p.inertia[i])];
        let next = k.respond(&push);
        let dot = |a: &[[DVec3; 2]]| a.iter().enumerate().map(|(i, a)| a[0].dot(push(i)[0]) + a[1].dot(push(i)[1])).sum::<f64>();
        omega2 = dot(&u) / dot(&next);
        let norm = next.iter().map(|v| v[0].length_squared()).sum::<f64>().sqrt();
        u = next.iter().map(|v| v.map(|v| v / norm)).collect();
    }
    omega2
}

/// Relative errors of a bar or limb, as far as they are linear and without any solver: sag and stretch under gravity, the first frequency, and twist by the end.
fn errors(body: &Body, edges: &CalibratedEdges, rings: &Rings, beam: &Beam) -> [f64; 4] {
    let k = Stiff::new(body, edges, rings);
    let x = |i: usize| body.p.rest_position[i];
    let weight = |i: usize| f64::from(body.p.mass[i]) * 9.81;
    let exact = beam.bend(&beam.weight());
    let sagging = k.respond(&|i| [DVec3::Y * weight(i), DVec3::ZERO]);
    let sag = fit(body, |i| sagging[i][0].y, |i| Beam::at(&exact, x(i).x));
    let pulled = k.respond(&|i| [DVec3::X * weight(i), DVec3::ZERO]);
    let exact = beam.stretch(&beam.weight());
    let stretch = fit(body, |i| pulled[i][0].x, |i| Beam::at(&exact, x(i).x));
    // Shear that grows with the distance from the axis, over the end.
    let mut ends = vec![[DVec3::ZERO; 2]; body.cells];
    let mut torque = 0.0;
    for f in &body.end {
        let (area, c, i) = (f64::from(f.area.x), f.centroid.as_dvec3(), f.pair[0] as usize);
        let force = DVec3::X.cross(c) * area;
        let moment = DVec3::X * f64::from(f.moments.y_axis.y + f.moments.z_axis.z) + (c - x(i).as_dvec3()).cross(force);
        ends[i] = [ends[i][0] + force, ends[i][1] + moment];
        torque += moment.x + x(i).as_dvec3().cross(force).x;
    }
    let turned = k.respond(&|i| ends[i]);
    let exact = beam.twist(torque);
    let twist = fit(body, |i| turned[i][1].x, |i| Beam::at(&exact, x(i).x));
    [sag, (first_mode(body, &k, sagging) / beam.first_mode()).sqrt() - 1.0, stretch, twist]
}

/// The mean and the standard deviation of five random samples.
fn five(solid: &Solid, count: usize, beam: &Beam, with_rings: bool) -> ([f64; 4], [f64; 4]) {
    let all: Vec<[f64; 4]> = (0..5)
        .map(|seed| {
            let mut body = Body::new(solid, count, seed);
            let (mut edges, mut rings) = body.calibrate(&beam.material, 0.0);
            if !with_rings {
                edges = CalibratedEdges::from_facets_alone(&mut body.p, &body.facets, &body.volumes, &beam.material, 0.0).unwrap();
                rings = Rings::default();
            }
            errors(&body, &edges, &rings, beam)
        })
        .collect();
    let mean = [0, 1, 2, 3].map(|c| all.iter().map(|e| e[c]).sum::<f64>() / 5.0);
    let spread = [0, 1, 2, 3].map(|c| (all.iter().map(|e| (e[c] - mean[c]) * (e[c] - mean[c])).sum::<f64>() / 4.0).sqrt());
    let figures: Vec<String> = (0..4).map(|c| format!("{:+.1} ± {:.1}", 100.0 * mean[c], 100.0 * spread[c])).collect();
    let nu = beam.material.poissons_ratio;
    println!("{} m, nu {nu}, {count} cells: sag, f1, stretch, twist {} %", solid.unit, figures.join(", "));
    (mean, spread)
}

/// What is not within the bounds for the means and for the spread.
#[derive(Default)]
struct Off(Vec<String>);

impl Off {
    fn close(&mut self, what: String, got: ([f64; 4], [f64; 4]), mean: [f64; 4], spread: f64) {
        let good = got.0.iter().zip(mean).all(|(e, most)| e.abs() < most) && got.1.iter().all(|s| *s < spread);
        if !good {
            self.0.push(format!("{what}: {got:?}"));
        }
    }
}

/// Slender bars: sag, first frequency, stretch and twist, the mean of five random bars. Where twist is too small, it is because Saint-Venant's warping takes many cells across the section.
#[test]
fn irregular_slender_bars_are_as_stiff_as_their_material() {
    let mut off = Off::default();
    for (nu, count, mean) in [
        (0.0, 20, [0.015, 0.015, 0.01, 0.095]),
        (0.0, 60, [0.01, 0.01, 0.01, 0.08]),
        (0.3, 20, [0.05, 0.035, 0.01, 0.07]),
        (0.3, 60, [0.035, 0.03, 0.01, 0.09]),
        (0.3, 150, [0.02, 0.015, 0.01, 0.06]),
        (0.45, 20, [0.06, 0.045, 0.01, 0.07]),
        (0.45, 60, [0.03, 0.03, 0.02, 0.11]),
    ] {
        let material = Material { youngs_modulus: 1e7, poissons_ratio: nu, density: DENSITY };
        let got = five(&Solid::bar(0.1), count, &Beam { side: |_| 0.1, material }, true);
        off.close(format!("nu {nu}, {count} cells"), got, mean, 0.055);
    }
    assert!(off.0.is_empty(), "{:#?}", off.0);
}

/// The same with more cells than a quick test has time for.
#[test]
#[ignore = "takes ten seconds"]
fn an_irregular_slender_bar_of_300_cells_is_as_stiff_as_its_material() {
    let mut off = Off::default();
    let material = Material { youngs_modulus: 1e7, poissons_ratio: 0.3, density: DENSITY };
    let got = five(&Solid::bar(0.1), 300, &Beam { side: |_| 0.1, material }, true);
    off.close("300 cells".into(), got, [0.01, 0.01, 0.01, 0.045], 0.015);
    assert!(off.0.is_empty(), "{:#?}", off.0);
}

/// Half as slender, which takes twice the cells across for as many.
#[test]
fn irregular_stout_bars_are_as_stiff_as_their_material() {
    let mut off = Off::default();
    for (nu, count, mean, spread) in [
        (0.3, 20, [0.055, 0.045, 0.015, 0.10], 0.09),
        (0.3, 60, [0.01, 0.02, 0.015, 0.05], 0.025),
        (0.3, 150, [0.01, 0.015, 0.015, 0.05], 0.015),
        (0.45, 20, [0.06, 0.055, 0.015, 0.12], 0.09),
        (0.45, 60, [0.03, 0.01, 0.025, 0.07], 0.025),
    ] {
        let material = Material { youngs_modulus: 1e7, poissons_ratio: nu, density: DENSITY };
        let got = five(&Solid::bar(0.2), count, &Beam { side: |_| 0.2, material }, true);
        off.close(format!("nu {nu}, {count} cells"), got, mean, spread);
    }
    assert!(off.0.is_empty(), "{:#?}", off.0);
}

/// From 0.12 to 0.06 m thick.
#[test]
fn a_tapered_limb_is_as_stiff_as_its_material() {
    let mut off = Off::default();
    let inside = |x: Vec3A| x.y.abs().max(x.z.abs()) < 0.06 - 0.03 * x.x;
    let solid = Solid { size: Vec3A::new(1.0, 0.12, 0.12), unit: 0.04, inside };
    for (count, mean) in [(20, [0.055, 0.045, 0.02, 0.06]), (60, [0.035, 0.03, 0.015, 0.08]), (150, [0.02, 0.015, 0.01, 0.06])] {
        let material = Material { youngs_modulus: 1e7, poissons_ratio: 0.3, density: DENSITY };
        let got = five(&solid, count, &Beam { side: |x| 0.12 - 0.06 * x, material }, true);
        off.close(format!("{count} cells"), got, mean, 0.055);
    }
    assert!(off.0.is_empty(), "{:#?}", off.0);
}

/// The cheap form.
#[test]
fn bars_without_rings_are_about_as_stiff_as_their_material() {
    let mut off = Off::default();
    let material = Material { youngs_modulus: 1e7, poissons_ratio: 0.3, density: DENSITY };
    for (side, count, mean) in
        [(0.1, 20, [0.06, 0.05, 0.07, 0.08]), (0.1, 60, [0.05, 0.04, 0.08, 0.12]), (0.2, 60, [0.06, 0.04, 0.09, 0.1])]
    {
        let beam = if side < 0.15 { Beam { side: |_| 0.1, material } } else { Beam { side: |_| 0.2, material } };
        off.close(format!("{side} m, {count} cells"), five(&Solid::bar(side), count, &beam, false), mean, 0.06);
    }
    assert!(off.0.is_empty(), "{:#?}", off.0);
}
