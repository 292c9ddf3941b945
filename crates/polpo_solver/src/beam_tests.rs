//! Rods against beam theory, swept and solved directly.

use glam::Vec3A;

use crate::testing::{Random, line};
use crate::{
    CalibratedEdges, CalibrationError, DirectEdges, Edges, Material, Particles, Section, Sweep, integrate, momentum, predict, quat_exp,
    quat_log, restore_angular_momentum, solve_calibrated_edges,
};

const DENSITY: f32 = 1000.0;
const SIDE: f32 = 0.075;
const NU: f32 = 0.3;
const G: Vec3A = Vec3A::new(0.0, -9.81, 0.0);

/// Of a bar of 1 m that its own weight bends by 5 cm without shear.
fn rubber() -> Material {
    let section = Section::square(SIDE);
    let e = DENSITY * 9.81 * section.area / (8.0 * section.bending * 0.05);
    Material { youngs_modulus: e, poissons_ratio: NU, density: DENSITY }
}

/// How the edges of a body are solved.
enum Solver {
    Sweep,
    Direct(Box<DirectEdges>),
}

/// A bar of 1 m along x, clamped at its first particle.
struct Bar {
    p: Particles,
    edges: CalibratedEdges,
    solver: Solver,
}

impl Bar {
    fn of(material: &Material, n: usize, spin_radius: Option<f32>, direct: bool) -> Self {
        let mut p = line(n, 1.0 / (n - 1) as f32, 0.02);
        let pairs: Vec<[u32; 2]> = (1..n as u32).map(|i| [i - 1, i]).collect();
        let edges = Edges::new(&p, &pairs).unwrap();
        let edges = CalibratedEdges::rods(&mut p, &edges, material, &Section::square(SIDE), spin_radius, &[]).unwrap();
        p.pin(0, true, true);
        let solver = if direct { Solver::Direct(Box::new(DirectEdges::new(&edges, n).unwrap())) } else { Solver::Sweep };
        Self { p, edges, solver }
    }

    fn swept(n: usize) -> Self {
        Self::of(&rubber(), n, Some(0.12), false)
    }

    fn direct(n: usize) -> Self {
        Self::of(&rubber(), n, None, true)
    }

    fn free(mut self) -> Self {
        self.p.pin(0, false, false);
        self
    }

    /// The constraints of a substep.
    fn solve(&mut self, dt: f32) -> usize {
        match &mut self.solver {
            Solver::Sweep => solve_calibrated_edges(&self.edges, &mut self.p, Sweep::only(dt)),
            Solver::Direct(direct) => return direct.solve(&self.edges, &mut self.p, dt),
        }
        1
    }

    fn step(&mut self, acceleration: Vec3A, dt: f32, drag: f32) -> usize {
        integrate(&mut self.p, dt, drag);
        predict(&mut self.p, acceleration, dt);
        self.solve(dt)
    }

    fn tip(&self) -> Vec3A {
        self.p.position[self.p.len() - 1]
    }

    /// How far the tip hangs down once it has come to rest, the mean over a second.
    fn sag(&mut self, rate: f32, substeps: u32) -> f32 {
        let dt = 1.0 / (rate * substeps as f32);
        let (mut sum, mut count) = (0.0, 0);
        for step in 0..(6.0 * rate) as usize {
            let late = step as f32 > 3.0 * rate;
            for _ in 0..substeps {
                // Damped on the way down, all but free at the end.
                self.step(G, dt, if late { 0.5 } else { 6.0 });
            }
            if step as f32 > 5.0 * rate {
                sum -= self.tip().y;
                count += 1;
            }
        }
        sum / count as f32
    }
}

/// ρgAL⁴/(8EI) + ρgL²/(2κG)
fn exact_sag(material: &Material) -> f32 {
    let section = Section::square(SIDE);
    DENSITY * 9.81 * section.area / (8.0 * material.youngs_modulus * section.bending)
        + DENSITY * 9.81 / (2.0 * section.shear * material.shear_modulus())
}

/// Where the tip of the clamped bar comes to rest at any load, (x, y): the equations of the plane beam that bends, shears and stretches (Reissner 1972), shot from the wall.
///
/// The cut at s carries the force F = (0, −ρgA(L − s)); θ′ = M/EI, r′ = (1 + F·t/EA)·t + F·n/κGA·n, M′ = −r′×F, and M(L) = 0 is found by bisection of M(0).
fn exact_tip(material: &Material) -> [f64; 2] {
    let section = Section::square(SIDE);
    let [area, bending, shear, e, g] =
        [section.area, section.bending, section.shear, material.youngs_modulus, material.shear_modulus()].map(f64::from);
    let weight = f64::from(DENSITY) * 9.81 * area;
    let slope = |s: f64, [theta, moment, ..]: [f64; 4]| {
        let (sin, cos) = (libm::sin(theta), libm::cos(theta));
        let pull = -weight * (1.0 - s);
        let (axial, across) = (1.0 + pull * sin / (e * area), pull * cos / (shear * g * area));
        let (x, y) = (axial * cos - across * sin, axial * sin + across * cos);
        [moment / (e * bending), -x * pull, x, y]
    };
    let shoot = |moment: f64| {
        let steps = 1000;
        let h = 1.0 / f64::from(steps);
        let mut state = [0.0, moment, 0.0, 0.0];
        for k in 0..steps {
            let s = h * f64::from(k);
            let along = |from: [f64; 4], by: [f64; 4], h: f64| [0, 1, 2, 3].map(|i| from[i] + h * by[i]);
            let k1 = slope(s, state);
            let k2 = slope(s + 0.5 * h, along(state, k1, 0.5 * h));
            let k3 = slope(s + 0.5 * h, along(state, k2, 0.5 * h));
            let k4 = slope(s + h, along(state, k3, h));
            state = along(state, [0, 1, 2, 3].map(|i| (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]) / 6.0), h);
        }
        state
    };
    let (mut low, mut high) = (-weight, 0.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if shoot(middle)[1] > 0.0 { high = middle } else { low = middle }
    }
    let end = shoot(0.5 * (low + high));
    [end[2], end[3]]
}

#[test]
fn a_cantilever_sags_as_timoshenko_says_at_every_resolution_and_time_step() {
    for n in [5, 9, 17, 33] {
        for rate in [30.0, 60.0, 120.0, 240.0] {
            let mut bar = Bar::swept(n);
            let substeps = bar.edges.recommended_substeps(&bar.p, 1.0 / rate);
            let got = bar.sag(rate, substeps);
            let error = got / exact_sag(&rubber()) - 1.0;
            println!("{n:2} particles, {rate:3} Hz × {substeps:3}: {got:.4} m, {:+.1} %", 100.0 * error);
            assert!(error.abs() < 0.05, "{n} particles, {rate} Hz × {substeps}: {got} m");
        }
    }
}

/// One substep a step at every rate. Lumping the weights and taking the moment at an edge's middle err by ±½(h/L)², which cancels: what is left is f32, and 0.2 % against the linear theory.
#[test]
fn solved_directly_it_sags_so_with_a_single_substep() {
    let exact = -exact_tip(&rubber())[1] as f32;
    for n in [5, 9, 17, 33] {
        for rate in [15.0, 30.0, 60.0, 120.0, 240.0, 1000.0] {
            let got = Bar::direct(n).sag(rate, 1);
            let error = got / exact - 1.0;
            println!("{n:2} particles, {rate:4} Hz: {got:.4} m, {:+.3} %", 100.0 * error);
            assert!(error.abs() < 5e-4 && (got / exact_sag(&rubber()) - 1.0).abs() < 3e-3, "{n} particles, {rate} Hz: {got} m");
        }
    }
}

/// With a quarter of the substeps it is stable and much too soft: what the rule is there to tell.
#[test]
fn too_few_substeps_are_stable() {
    let mut bar = Bar::swept(17);
    let enough = bar.edges.recommended_substeps(&bar.p, 1.0 / 60.0);
    let got = bar.sag(60.0, enough / 8);
    assert!(got.is_finite() && got > 1.2 * exact_sag(&rubber()) && got < 1.1, "{got} m");
}

/// A tenth of the stiffness: the tip hangs 43 cm down and comes 11 cm nearer to the wall. The error is of second order in the bend of an edge, θ: 4·tan(θ/4) is stiffer than θ by θ²/12.
#[test]
fn large_deflections_are_those_of_the_elastica() {
    let soft = Material { youngs_modulus: 0.1 * rubber().youngs_modulus, ..rubber() };
    let exact = exact_tip(&soft);
    for (n, tolerance) in [(9, 2e-3), (17, 5e-4), (33, 2e-4)] {
        for rate in [30.0, 240.0] {
            let mut bar = Bar::of(&soft, n, None, true);
            let sag = bar.sag(rate, 1);
            let error = [f64::from(bar.tip().x) / exact[0] - 1.0, f64::from(-sag) / exact[1] - 1.0];
            println!("{n} at {rate} Hz: {} {sag}, {exact:?}, {error:?}", bar.tip().x);
            assert!(error.iter().all(|e| e.abs() < tolerance), "{n} at {rate} Hz: {error:?}");
        }
    }
}

/// A single edge at random: impulses and their moments cancel.
#[test]
fn an_edge_keeps_linear_and_angular_momentum() {
    let mut random = Random(5);
    for _ in 0..200 {
        let mut bar = Bar::swept(3).free();
        let p = &mut bar.p;
        p.set_mass(1, 1.0 + 100.0 * random.signed().abs());
        bar.edges.pairs.truncate(1);
        bar.edges.contact = vec![[random.vector() * 0.2, random.vector() * 0.2]];
        for i in 0..2 {
            p.position[i] += random.vector() * 0.2;
            p.rotation[i] = quat_exp(random.vector());
            p.velocity[i] = Vec3A::ZERO;
        }
        solve_calibrated_edges(&bar.edges, p, Sweep::only(0.01));
        let (mut linear, mut angular, mut scale) = (Vec3A::ZERO, Vec3A::ZERO, 0.0f32);
        // The impulses, at the places where they acted.
        let back = |i: usize| p.position[i] - p.velocity[i] * 0.01;
        for i in 0..2 {
            linear += p.velocity[i] * p.mass[i];
            angular += back(i).cross(p.velocity[i] * p.mass[i]) + p.angular_velocity[i] * p.inertia[i];
            scale += p.velocity[i].length() * p.mass[i] + p.angular_velocity[i].length() * p.inertia[i];
        }
        assert!(linear.length() < 1e-6 * scale, "{linear} of {scale}");
        assert!(angular.length() < 2e-6 * scale, "{angular} of {scale}");
    }
}

#[test]
fn an_undeformed_bar_is_left_alone_wherever_it_is() {
    for direct in [false, true] {
        let mut bar = Bar::of(&rubber(), 5, Some(0.12), direct);
        bar.p.place(quat_exp(Vec3A::new(0.5, -1.2, 0.7)), Vec3A::new(0.3, -0.2, 0.9));
        let before = bar.p.position.clone();
        bar.solve(1e-3);
        assert!(before.iter().zip(&bar.p.position).all(|(a, b)| a.distance(*b) < 1e-6));
    }
}

/// A twisted bar untwists evenly and, free of gravity, loses neither its length nor its straightness.
#[test]
fn twist_is_linear_along_a_bar() {
    let n = 9;
    for (mut bar, dt, tolerance) in [(Bar::swept(n), 2.5e-4, 5e-3), (Bar::direct(n), 1.0 / 60.0, 1e-5)] {
        bar.p.pin(n - 1, true, true);
        bar.p.rotation[n - 1] = quat_exp(Vec3A::X * 1.2);
        for _ in 0..(4.0 / dt) as usize {
            bar.step(Vec3A::ZERO, dt, 3.0);
        }
        for i in 0..n {
            let expected = 1.2 * i as f32 / (n - 1) as f32;
            let twist = quat_log(bar.p.rotation[i]).x;
            assert!((twist - expected).abs() < tolerance, "{i}: {twist} against {expected}");
            assert!((bar.p.position[i] - bar.p.rest_position[i]).length() < 1e-3);
        }
    }
}

/// A free bar that wobbles neither drifts nor gains energy.
#[test]
fn a_free_bar_does_not_drift() {
    for (bar, dt) in [(Bar::swept(9), 1e-3), (Bar::direct(9), 1e-3), (Bar::direct(9), 1.0 / 60.0)] {
        let mut bar = bar.free();
        let mut random = Random(2);
        for v in &mut bar.p.velocity {
            *v = random.vector();
        }
        let before = momentum(&bar.p);
        let mut most = 0;
        for _ in 0..(5.0 / dt) as usize {
            predict(&mut bar.p, Vec3A::ZERO, dt);
            let angular = momentum(&bar.p).angular;
            most = most.max(bar.solve(dt));
            restore_angular_momentum(&mut bar.p, angular, dt);
        }
        let after = momentum(&bar.p);
        let scale = (2.0 * before.kinetic_energy * before.mass).sqrt();
        println!("P {:e} L {:e} of {:e}, most {most}", after.linear.distance(before.linear), after.angular.distance(before.angular), scale);
        assert!(after.linear.distance(before.linear) < 1e-5 * scale, "{} → {}", before.linear, after.linear);
        assert!(after.angular.distance(before.angular) < 1e-5 * scale, "{} → {}", before.angular, after.angular);
        assert!(after.kinetic_energy < before.kinetic_energy);
    }
}

#[test]
fn bad_materials_are_named() {
    let mut p = line(3, 1.0, 0.1);
    let mut edges = Edges::new(&p, &[[0, 1], [1, 2]]).unwrap();
    let good = Material { youngs_modulus: 1e6, poissons_ratio: 0.3, density: 1000.0 };
    let mut rods = |material: Material| CalibratedEdges::rods(&mut p, &edges, &material, &Section::circle(0.1), None, &[]);
    assert!(rods(good).is_ok());
    let error = rods(Material { youngs_modulus: f32::NAN, ..good }).unwrap_err();
    assert_eq!(error.to_string(), "Young's modulus is NaN, not positive and normal");
    let error = rods(Material { poissons_ratio: 0.6, ..good }).unwrap_err();
    assert_eq!(error.to_string(), "Poisson's ratio is 0.6, not above -1 and at most 0.5");
    edges.rest_length[0] = 0.0;
    let error = CalibratedEdges::rods(&mut p, &edges, &good, &Section::circle(0.1), None, &[]);
    assert!(matches!(error, Err(CalibrationError::Length { .. })));
}

/// Swings freely from a small push; the mean of the periods between upward zero crossings of `coordinate` about its mean, as a frequency \[Hz\].
fn frequency(bar: &mut Bar, dt: f32, seconds: f32, coordinate: impl Fn(&Particles) -> f32) -> f32 {
    let mut crossings = Vec::new();
    let mut last = 0.0;
    for step in 0..(seconds / dt) as usize {
        bar.step(Vec3A::ZERO, dt, 0.0);
        let now = coordinate(&bar.p);
        if last < 0.0 && now >= 0.0 {
            crossings.push((step as f32 + last / (last - now)) * dt);
        }
        last = now;
    }
    (crossings.len() - 1) as f32 / (crossings[crossings.len() - 1] - crossings[0])
}

/// The first mode of the clamped bar, δω1²/g = 1.5453 with δ the sag: β₁²/(2π)·√(EI/ρAL⁴) of Euler and Bernoulli, less what shear and spin slow it (the sag's own share of shear, ½·1.3 %).
#[test]
fn the_first_mode_has_the_frequency_of_the_books() {
    let material = rubber();
    let sag = exact_sag(&material);
    let exact = (1.5453 * 9.81 / sag).sqrt() / core::f32::consts::TAU;
    for (n, tolerance) in [(5, 0.02), (9, 0.007), (17, 0.003), (33, 0.0025)] {
        let mut bar = Bar::direct(n);
        for i in 0..n {
            let x = bar.p.rest_position[i].x;
            bar.p.velocity[i].y = 0.3 * x * x;
        }
        let got = frequency(&mut bar, 1e-3, 4.0, |p| p.position[n - 1].y);
        println!("{n}: {got} Hz of {exact}, {:+.2} %", 100.0 * (got / exact - 1.0));
        assert!((got / exact - 1.0).abs() < tolerance, "{n}: {got} Hz of {exact}");
    }
}

/// √(GJ/ρI_p)/(4L), with I_p = A·r² = I, half of the square's own: the particles' spin inertia is a scalar.
#[test]
fn the_first_mode_of_torsion_has_the_frequency_of_the_books() {
    let (material, section) = (rubber(), Section::square(SIDE));
    for (n, tolerance) in [(9, 0.01), (33, 0.005)] {
        let mut bar = Bar::direct(n);
        let r = (section.bending / section.area).sqrt();
        let exact = (material.shear_modulus() * section.torsion / (DENSITY * section.area * r * r)).sqrt() / 4.0;
        for i in 0..n {
            bar.p.angular_velocity[i].x = 0.5 * libm::sinf(core::f32::consts::FRAC_PI_2 * bar.p.rest_position[i].x);
        }
        let got = frequency(&mut bar, 1e-4, 0.5, |p| quat_log(p.rotation[n - 1]).x);
        println!("{n}: {got} Hz of {exact}, {:+.2} %", 100.0 * (got / exact - 1.0));
        assert!((got / exact - 1.0).abs() < tolerance, "{n}: {got} Hz of {exact}");
    }
}

/// How fast the first mode dies \[1/s\]: the amplitude √(y² + (v/ω)²) of the tip, over `seconds`.
fn decay(bar: &mut Bar, dt: f32, seconds: f32, omega: f32) -> f32 {
    let n = bar.p.len();
    for i in 0..n {
        let x = bar.p.rest_position[i].x;
        bar.p.velocity[i].y = 0.3 * x * x * (1.0 - x / 3.0);
    }
    let amplitude = |p: &Particles| libm::hypotf(p.position[n - 1].y, p.velocity[n - 1].y / omega);
    let mut start = 0.0;
    let steps = (seconds / dt) as usize;
    for step in 0..=steps {
        bar.step(Vec3A::ZERO, dt, 0.0);
        if step == steps / 4 {
            start = amplitude(&bar.p);
        }
    }
    libm::logf(start / amplitude(&bar.p)) / (0.75 * seconds)
}

/// ζ = π·f·τ, so it dies as e^(−½ω²τ·t), besides what implicit Euler and the sweeps take without τ.
#[test]
fn retardation_damps_as_kelvin_and_voigt_say() {
    let tau = 4e-3;
    for (direct, n, tolerance) in [(true, 9, 0.02), (true, 17, 0.02), (false, 9, 0.05)] {
        let make = |tau: f32| {
            let mut bar = if direct { Bar::direct(n) } else { Bar::swept(n) };
            bar.edges.retardation = tau;
            bar
        };
        let bar = make(tau);
        let dt = if direct { 5e-4 } else { 1.0 / bar.edges.recommended_substeps(&bar.p, 1.0) as f32 };
        // Its own frequency: spins made large for the sweep's sake slow it.
        let mut bar = make(0.0);
        for i in 0..n {
            let x = bar.p.rest_position[i].x;
            bar.p.velocity[i].y = 0.3 * x * x;
        }
        let omega = core::f32::consts::TAU * frequency(&mut bar, dt, 4.0, |p| p.position[n - 1].y);
        let got = decay(&mut make(tau), dt, 2.0, omega) - decay(&mut make(0.0), dt, 2.0, omega);
        let exact = 0.5 * omega * omega * tau;
        println!("direct {direct}, {n}: {got} of {exact} 1/s, {:+.2} %", 100.0 * (got / exact - 1.0));
        assert!((got / exact - 1.0).abs() < tolerance, "direct {direct}, {n}: {got} of {exact} 1/s");
    }
}

/// It slows what moves and leaves what hangs where it hangs.
#[test]
fn retardation_does_not_change_the_sag() {
    for direct in [false, true] {
        for tau in [1e-3, 1e-2] {
            let mut bar = if direct { Bar::direct(9) } else { Bar::swept(9) };
            bar.edges.retardation = tau;
            let substeps = if direct { 1 } else { bar.edges.recommended_substeps(&bar.p, 1.0 / 60.0) };
            let error = bar.sag(60.0, substeps) / exact_sag(&rubber()) - 1.0;
            println!("direct {direct}, τ {tau}: {substeps} substeps, {:+.2} %", 100.0 * error);
            assert!(error.abs() < if direct { 0.003 } else { 0.05 }, "direct {direct}, τ {tau}: {substeps} substeps, {error}");
        }
    }
}
