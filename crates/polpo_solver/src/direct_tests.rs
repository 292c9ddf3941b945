//! Calibrated edges solved directly, at the extremes.

use glam::{Quat, Vec3A};

use crate::edge_strain::EdgeStrain;
use crate::testing::Random;
use crate::{
    CalibratedEdges, CalibrationError, DirectEdges, Edges, Material, ParticleRest, Particles, Section, Sweep, integrate, momentum, predict,
    quat_exp, quat_log, solve_calibrated_edges,
};

const G: Vec3A = Vec3A::new(0.0, -9.81, 0.0);

struct Body {
    p: Particles,
    edges: CalibratedEdges,
    direct: DirectEdges,
}

impl Body {
    fn new(places: &[Vec3A], pairs: &[[u32; 2]], material: &Material, section: &Section) -> Self {
        let rest: Vec<ParticleRest> =
            places.iter().map(|&position| ParticleRest { position, frame: Quat::IDENTITY, radii: Vec3A::splat(0.02), mass: 1.0 }).collect();
        let mut p = Particles::new(&rest).unwrap();
        let edges = Edges::new(&p, pairs).unwrap();
        let edges = CalibratedEdges::rods(&mut p, &edges, material, section, None, &[]).unwrap();
        let direct = DirectEdges::new(&edges, p.len()).unwrap();
        Self { p, edges, direct }
    }

    fn chain(n: usize, length: f32, material: &Material, section: &Section) -> Self {
        let places: Vec<Vec3A> = (0..n).map(|i| Vec3A::X * (length * i as f32 / (n - 1) as f32)).collect();
        let pairs: Vec<[u32; 2]> = (1..n as u32).map(|i| [i - 1, i]).collect();
        Self::new(&places, &pairs, material, section)
    }

    fn step(&mut self, acceleration: Vec3A, dt: f32, drag: f32) -> usize {
        integrate(&mut self.p, dt, drag);
        predict(&mut self.p, acceleration, dt);
        self.direct.solve(&self.edges, &mut self.p, dt)
    }

    /// The longest of the edges, relative to its length at rest.
    fn longest(&self) -> f32 {
        let length = |(&[i, j], gap): (&[u32; 2], &Vec3A)| self.p.position[i as usize].distance(self.p.position[j as usize]) / gap.x;
        self.edges.pairs.iter().zip(&self.edges.rest_gap).map(length).fold(0.0, f32::max)
    }

    /// What the edges hold \[J\].
    fn energy(&self) -> f32 {
        let of = |(e, ends): (usize, &[u32; 2])| {
            let [i, j] = ends.map(|k| k as usize);
            let position = [i, j].map(|k| self.p.position[k].as_dvec3());
            EdgeStrain::new(&self.edges, e, position, [i, j].map(|k| self.p.rotation[k].as_dquat())).energy(&self.edges, e)
        };
        self.edges.pairs.iter().enumerate().map(of).sum::<f64>() as f32
    }
}

const RUBBER: Material = Material { youngs_modulus: 1e6, poissons_ratio: 0.45, density: 1000.0 };
const STEEL: Material = Material { youngs_modulus: 2e11, poissons_ratio: 0.3, density: 7800.0 };

/// Clamped at both ends, one of them twisted, under its own weight: ρgA(L⁴/(384EI) + L²/(8κGA)) in the middle, twist linear, and no longer than that makes it, at every step.
#[test]
fn a_chain_holds_bend_and_twist_and_length_at_every_time_step() {
    let section = Section::circle(0.02);
    let load = 1000.0 * 9.81 * section.area;
    let (bending, shear) = (RUBBER.youngs_modulus * section.bending, section.shear * RUBBER.shear_modulus() * section.area);
    let stiff = Material { youngs_modulus: 2e8, ..RUBBER };
    let exact = (load / (384.0 * bending) + load / (8.0 * shear)) * RUBBER.youngs_modulus / stiff.youngs_modulus;
    for (rate, n) in [15.0, 30.0, 60.0, 120.0, 240.0, 1000.0].into_iter().flat_map(|rate| [(rate, 9), (rate, 17), (rate, 33)]) {
        let mut body = Body::chain(n, 1.0, &stiff, &section);
        body.p.pin(0, true, true);
        body.p.pin(n - 1, true, true);
        body.p.rotation[n - 1] = quat_exp(Vec3A::X * 0.3);
        let mut longest = 0.0f32;
        for _ in 0..(3.0 * rate) as usize {
            body.step(G, 1.0 / rate, 8.0);
            longest = longest.max(body.longest());
        }
        let sag = -body.p.position[n / 2].y / exact - 1.0;
        let twist = (0..n).map(|i| (quat_log(body.p.rotation[i]).x - 0.3 * i as f32 / (n - 1) as f32).abs()).fold(0.0, f32::max);
        println!("{rate} Hz, {n}: sag {sag:+}, twist {twist}, length {longest}");
        let coarse = 1.0 / ((n - 1) * (n - 1)) as f32;
        // 4(h/L)²: of the middle of a parabola of moments that changes its sign, edges see no more.
        assert!((sag + 4.0 * coarse).abs() < 2e-3 && twist < 1e-4 && longest < 1.0001, "{rate} Hz: {sag} {twist} {longest}");
    }
}

/// A load a thousand times as heavy as the steel wire it hangs from: it neither swings across nor stretches beyond F/EA, and the pin bears the weight.
#[test]
fn a_light_rope_carries_a_heavy_load() {
    let section = Section::circle(0.002);
    for rate in [15.0, 60.0, 240.0] {
        let n = 17;
        let mut body = Body::chain(n, 1.0, &STEEL, &section);
        body.p.place(quat_exp(Vec3A::Z * -1.3), Vec3A::ZERO);
        body.p.pin(0, true, false);
        body.p.set_mass(n - 1, 100.0);
        for step in 0..(20.0 * rate) as usize {
            body.p.reaction.clear();
            body.p.reaction.resize(n, Vec3A::ZERO);
            body.step(G, 1.0 / rate, if step as f32 > 2.0 * rate { 1.0 } else { 0.0 });
            // Falling through the arc, three times the weight.
            assert!(body.longest() < 1.0 + 3.5 * 100.0 * 9.81 / (2e11 * section.area), "{}", body.longest());
        }
        let weight = body.p.total_mass() * 9.81;
        let pull = body.p.reaction[0] * rate;
        assert!((pull.length() / weight - 1.0).abs() < 0.01 && pull.y < -0.99 * weight, "{rate} Hz: {pull} of {weight} N");
    }
}

/// A hand that jerks one end about and turns it: everything follows and comes to rest where it should.
#[test]
fn a_moving_clamp_is_followed() {
    for rate in [15.0, 60.0, 1000.0] {
        let mut body = Body::chain(9, 1.0, &RUBBER, &Section::circle(0.02));
        body.p.pin(0, true, true);
        for step in 0..(12.0 * rate) as usize {
            let moving = (step as f32) < 2.0 * rate;
            body.p.velocity[0] = if moving { Vec3A::new(5.0, 2.0, -3.0) } else { Vec3A::ZERO };
            body.p.angular_velocity[0] = if moving { Vec3A::Z * 6.0 } else { Vec3A::ZERO };
            body.step(Vec3A::ZERO, 1.0 / rate, if moving { 0.0 } else { 2.2 });
            assert!(body.longest() < 1.2, "{rate} Hz: {}", body.longest());
        }
        for i in 0..9 {
            let there = body.p.position[0] + body.p.rotation[0] * body.p.rest_position[i];
            assert!(body.p.position[i].distance(there) < 2e-3, "{rate} Hz: {i} {} {there}", body.p.position[i]);
        }
    }
}

/// From random velocities up to 30 m/s and spins of 300 rad/s, at steps at which a particle turns by several turns: it never has more than it began with.
#[test]
fn nothing_makes_energy() {
    for (material, radius) in [(RUBBER, 0.02), (STEEL, 0.002), (STEEL, 0.02), (Material { youngs_modulus: 1e4, ..RUBBER }, 0.01)] {
        for rate in [15.0, 30.0, 60.0, 240.0, 1000.0] {
            let mut body = Body::chain(17, 1.0, &material, &Section::circle(radius));
            let mut random = Random(3);
            for i in 0..17 {
                body.p.velocity[i] = random.vector() * 30.0;
                body.p.angular_velocity[i] = random.vector() * 300.0;
            }
            let before = momentum(&body.p);
            for step in 0..(2.0 * rate) as usize {
                body.step(Vec3A::ZERO, 1.0 / rate, 0.0);
                let energy = momentum(&body.p).kinetic_energy + body.energy();
                assert!(energy < before.kinetic_energy, "{material:?} at {rate} Hz, step {step}: {energy} of {} J", before.kinetic_energy);
            }
            let after = momentum(&body.p);
            let scale = (2.0 * before.kinetic_energy * before.mass).sqrt();
            assert!(after.linear.distance(before.linear) < 1e-5 * scale, "{} → {}", before.linear, after.linear);
        }
    }
}

/// A rope on two pins, a ring with a spoke and a fork come to rest where sweeps with many substeps put them.
#[test]
fn trees_and_loops_hang_as_they_do_when_swept() {
    let v = |x: f32, y: f32| Vec3A::new(x, y, 0.0);
    let fork = (
        vec![v(0.0, 0.0), v(0.1, 0.0), v(0.2, 0.05), v(0.3, 0.1), v(0.2, -0.05), v(0.3, -0.1)],
        vec![[0, 1], [1, 2], [2, 3], [1, 4], [4, 5]],
    );
    let ring = (
        vec![v(0.0, 0.0), v(0.1, 0.05), v(0.2, 0.0), v(0.2, -0.1), v(0.1, -0.15), v(0.0, -0.1)],
        vec![[0, 1], [1, 2], [2, 3], [3, 4], [4, 5], [5, 0], [1, 4]],
    );
    for (places, pairs) in [fork, ring] {
        let mut body = Body::new(&places, &pairs, &RUBBER, &Section::circle(0.008));
        body.p.pin(0, true, true);
        let mut swept = body.p.clone();
        for _ in 0..300 {
            body.step(G, 1.0 / 60.0, 6.0);
        }
        let substeps = body.edges.recommended_substeps(&swept, 1.0 / 60.0) * 6;
        let dt = 1.0 / (60.0 * substeps as f32);
        for _ in 0..300 * substeps {
            integrate(&mut swept, dt, 6.0);
            predict(&mut swept, G, dt);
            solve_calibrated_edges(&body.edges, &mut swept, Sweep::only(dt));
        }
        let sag = swept.position.iter().zip(&places).map(|(x, rest)| x.distance(*rest)).fold(0.0, f32::max);
        let apart = swept.position.iter().zip(&body.p.position).map(|(a, b)| a.distance(*b)).fold(0.0, f32::max);
        println!("sag {sag}, apart {apart}, {substeps} substeps");
        assert!(sag > 0.005 && apart < 0.01 * sag, "{sag} {apart}");
    }
}

#[test]
fn too_many_loops_are_refused() {
    let mut random = Random(4);
    let places: Vec<Vec3A> = (0..150).map(|_| random.vector()).collect();
    let pairs: Vec<[u32; 2]> = (0..150).flat_map(|i| (0..i).map(move |j| [j, i])).collect();
    let rest: Vec<ParticleRest> =
        places.iter().map(|&position| ParticleRest { position, frame: Quat::IDENTITY, radii: Vec3A::splat(0.02), mass: 1.0 }).collect();
    let mut p = Particles::new(&rest).unwrap();
    let edges = Edges::new(&p, &pairs).unwrap();
    let edges = CalibratedEdges::rods(&mut p, &edges, &RUBBER, &Section::circle(0.01), None, &[]).unwrap();
    assert_eq!(DirectEdges::new(&edges, 150), Err(CalibrationError::Loops { particles: 150 }));
}

/// All in one point, inside out, and not numbers: it ends, and only what is not a number stays so.
#[test]
fn the_worst_starts_end() {
    for material in [RUBBER, STEEL] {
        for rate in [15.0, 1000.0] {
            for start in 0..3 {
                let mut body = Body::chain(9, 1.0, &material, &Section::circle(0.01));
                for i in 0..9 {
                    let x = body.p.position[i];
                    body.p.position[i] = [Vec3A::ZERO, -x, x * 1e3][start];
                }
                let before = body.energy();
                let mut most = 0.0f32;
                for _ in 0..200 {
                    body.step(Vec3A::ZERO, 1.0 / rate, 0.5);
                    most = most.max(momentum(&body.p).kinetic_energy + body.energy());
                }
                assert!(body.p.is_finite() && most <= before, "{material:?} {rate} {start}: {most} of {before} J");
            }
        }
    }
    let mut body = Body::chain(9, 1.0, &RUBBER, &Section::circle(0.01));
    body.p.position[4].x = f32::NAN;
    body.step(G, 0.01, 0.0);
    assert!(!body.p.is_finite());
}
