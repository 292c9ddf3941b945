//! Joints between explicit groups in the whole step: a shared particle is a ball joint, two are a hinge. Against Lagrange's equations and conservation laws, with equal masses and with 1 : 100.

use bevy::math::Vec3A;
use bevy::prelude::*;
use polpo::prelude::*;
use polpo::{ExplicitGroup, ExplicitGroups, ExplicitState, Particles};
use polpo_rig::{MeshHash, Particle, Rig};
use polpo_solver::momentum;
use polpo_tests::{simulation, steps};

const G: f64 = 9.81;

/// Without edges: nothing but the groups holds it.
fn rig(at: &[Vec3], mass: impl Fn(usize) -> f32, radius: f32) -> Rig {
    let particle = |(i, &position)| Particle { position, frame: Quat::IDENTITY, radii: Vec3::splat(radius), mass: mass(i) };
    let particles = at.iter().enumerate().map(particle).collect();
    Rig { mesh_hash: MeshHash(0), particles, edges: vec![], ..Rig::default() }
}

fn rigid(groups: &[&[u32]]) -> ExplicitGroups {
    ExplicitGroups { list: groups.iter().map(|&members| ExplicitGroup::rigid(members)).collect() }
}

fn particles(app: &App, body: Entity) -> &Particles {
    app.world().get(body).unwrap()
}

fn place(app: &App, body: Entity, i: usize) -> Vec3 {
    app.world().get::<Transform>(body).unwrap().translation + Vec3::from(particles(app, body).position[i])
}

/// How far the distances of `pairs` are from those at rest, at most \[m\].
fn gap(app: &App, body: Entity, pairs: impl IntoIterator<Item = (usize, usize)>) -> f32 {
    let p = particles(app, body);
    let open = |(i, j): (usize, usize)| p.position[i].distance(p.position[j]) - p.rest_position[i].distance(p.rest_position[j]);
    pairs.into_iter().map(|pair| open(pair).abs()).fold(0.0, f32::max)
}

/// Two rods in a plane, hung on each other: angles from straight down and their rates, by Runge and Kutta's method.
struct DoublePendulum {
    length: f64,
    /// Per rod, moment of inertia about its upper end, Σm·d from there, mass.
    inertia: [f64; 2],
    moment: [f64; 2],
    lower_mass: f64,
    state: [f64; 4],
}

impl DoublePendulum {
    /// T = ½·I₁·a'² + ½·m·l²·a'² + S·l·a'·b'·cos(a − b) + ½·I₂·b'², V = −g·(S₁ + m·l)·cos a − g·S₂·cos b.
    fn rates(&self, [a, b, da, db]: [f64; 4]) -> [f64; 4] {
        let (l, [i1, i2], [s1, s2], m) = (self.length, self.inertia, self.moment, self.lower_mass);
        let (sin, cos) = (a - b).sin_cos();
        let (m11, m12, m22) = (i1 + m * l * l, s2 * l * cos, i2);
        let f1 = -s2 * l * db * db * sin - G * (s1 + m * l) * a.sin();
        let f2 = s2 * l * da * da * sin - G * s2 * b.sin();
        let det = m11 * m22 - m12 * m12;
        [da, db, (f1 * m22 - f2 * m12) / det, (f2 * m11 - f1 * m12) / det]
    }

    fn advance(&mut self, time: f64) {
        let count = 2000;
        let h = time / f64::from(count);
        let at = |s: [f64; 4], k: [f64; 4], h: f64| [0, 1, 2, 3].map(|i| s[i] + k[i] * h);
        for _ in 0..count {
            let s = self.state;
            let k1 = self.rates(s);
            let k2 = self.rates(at(s, k1, 0.5 * h));
            let k3 = self.rates(at(s, k2, 0.5 * h));
            let k4 = self.rates(at(s, k3, h));
            self.state = [0, 1, 2, 3].map(|i| s[i] + h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]));
        }
    }
}

/// Two rods of half a metre with a ball joint, let go level from a pin: for as long as they are not chaotic they move as Lagrange's equations say, and the joint holds for ten seconds, whichever of the two
/// is a hundred times heavier.
#[test]
fn a_double_pendulum_swings_as_two_rods_do() {
    for (upper, lower) in [(0.1, 0.1), (0.01, 1.0), (1.0, 0.01)] {
        let mass = |i: usize| if i <= 4 { upper } else { lower };
        let mut app = simulation();
        app.insert_resource(SolverSettings { substeps: 20, iterations: 1, ..default() });
        let at: Vec<Vec3> = (0..9).map(|i| Vec3::X * (0.125 * i as f32)).collect();
        let body = app.world_mut().spawn((SoftBody::new(rig(&at, mass, 0.03)), rigid(&[&[0, 1, 2, 3, 4], &[4, 5, 6, 7, 8]]))).id();
        let nail = place(&app, body, 0);
        app.world_mut().entity_mut(body).insert(Pins { list: vec![Pin::at(0, nail)] });

        let p = particles(&app, body);
        let sum = |of: core::ops::Range<usize>, from: usize, power: i32| -> f64 {
            of.map(|i| f64::from(p.mass[i]) * (0.125 * (i - from) as f64).powi(power)).sum()
        };
        let spin = |of: core::ops::Range<usize>| -> f64 { of.map(|i| f64::from(p.inertia[i])).sum() };
        let mut exact = DoublePendulum {
            length: 0.5,
            inertia: [sum(0..5, 0, 2) + spin(0..5), sum(5..9, 4, 2) + spin(5..9)],
            moment: [sum(0..5, 0, 1), sum(5..9, 4, 1)],
            lower_mass: sum(5..9, 4, 0),
            state: [core::f64::consts::FRAC_PI_2, core::f64::consts::FRAC_PI_2, 0.0, 0.0],
        };
        let (mut worst, mut open) = (0.0f64, 0.0f32);
        for step in 0..600 {
            steps(&mut app, 1);
            open = open.max(gap(&app, body, [(0, 4), (3, 4), (4, 5), (4, 8)]));
            if step < 60 {
                exact.advance(1.0 / 60.0);
                let [a, b, ..] = exact.state;
                let joint = Vec2::new(a.sin() as f32, -a.cos() as f32) * 0.5;
                let tip = joint + Vec2::new(b.sin() as f32, -b.cos() as f32) * 0.5;
                for (i, there) in [(4, joint), (8, tip)] {
                    worst = worst.max(f64::from((place(&app, body, i) - nail).distance(there.extend(0.0))));
                }
            }
        }
        println!("double pendulum {upper} : {lower}: {worst:.1e} m from Lagrange's in 1 s, gap {open:.1e} m, ends at {:?}", exact.state);
        assert!(open < 1e-5, "the joint opens by {open} m");
        assert!(worst < 0.01, "{worst} m from where Lagrange's equations have it");
        assert!(place(&app, body, 0).distance(nail) < 1e-6);
    }
}

/// A door on two hinges, its axis leaning by 30° from upright: it swings about it as a compound pendulum does and about nothing else, from 40° on. The frame is clamped in the wall; the door's outer edge is as heavy as the rest, or a
/// hundred times heavier, or the frame is.
#[test]
fn a_door_swings_about_its_hinges() {
    let lean = 30f32.to_radians();
    let upright = Quat::from_rotation_x(lean);
    let axis = upright * Vec3::Y;
    for (frame, edge) in [(1.0, 1.0), (1.0, 100.0), (100.0, 1.0)] {
        let mut app = simulation();
        app.insert_resource(SolverSettings { substeps: 20, iterations: 1, ..default() });
        // Hinges at 0 and 1; the frame; the door, which hangs down to +z where the axis leans.
        let start = Quat::from_axis_angle(axis, 40f32.to_radians());
        let frame_at = [[0.0, -1.0, 0.0], [0.0, 1.0, 0.0], [-0.3, -1.0, 0.0], [-0.3, 1.0, 0.0]].map(|x| upright * Vec3::from(x));
        let door_at = [[0.0, -1.0, 0.4], [0.0, 1.0, 0.4], [0.0, -1.0, 0.8], [0.0, 1.0, 0.8]].map(|x| start * upright * Vec3::from(x));
        let at: Vec<Vec3> = frame_at.into_iter().chain(door_at).collect();
        let mass = |i: usize| [1.0, 1.0, frame, frame, 1.0, 1.0, edge, edge][i];
        let body = app.world_mut().spawn((SoftBody::new(rig(&at, mass, 0.05)), rigid(&[&[0, 1, 2, 3], &[0, 1, 4, 5, 6, 7]]))).id();
        let list = [2, 3].map(|i| Pin::at(i, place(&app, body, i as usize)).clamped()).to_vec();
        app.world_mut().entity_mut(body).insert(Pins { list });
        let hinges = [0, 1].map(|i| place(&app, body, i));

        let p = particles(&app, body);
        let (mut inertia, mut moment) = (0.0f64, 0.0f64);
        for (i, d) in [(4, 0.4), (5, 0.4), (6, 0.8), (7, 0.8)] {
            inertia += f64::from(p.mass[i]) * d * d + f64::from(p.inertia[i]);
            moment += f64::from(p.mass[i]) * d;
        }
        // Gravity across the axis pulls; from the angle θ₀ the period is longer by 1/agm(1, cos ½θ₀), the complete elliptic integral.
        let omega = (G * f64::from(lean).sin() * moment / inertia).sqrt();
        let (mut a, mut b) = (1.0f64, (0.5 * 40f64.to_radians()).cos());
        for _ in 0..5 {
            (a, b) = (0.5 * (a + b), (a * b).sqrt());
        }
        let exact = core::f64::consts::TAU / omega / a;

        let (mut last, mut open, mut crossings) = (1.0f32, 0.0f32, Vec::new());
        for step in 1..=600 {
            steps(&mut app, 1);
            open = open.max(gap(&app, body, [(0, 2), (1, 3), (0, 4), (1, 5), (0, 6), (1, 7), (0, 7), (4, 7)]));
            for (i, hinge) in hinges.iter().enumerate() {
                open = open.max(place(&app, body, i).distance(*hinge));
            }
            // Sideways, to the left and right of where it would hang.
            let x = (place(&app, body, 6) - hinges[0]).x;
            if x * last < 0.0 {
                crossings.push((step as f32 - 1.0 + last / (last - x)) / 60.0);
            }
            last = x;
        }
        let turned = |app: &App, g| app.world().get::<ExplicitState>(body).unwrap().rotation(g).unwrap();
        let relative = turned(&app, 0).inverse() * turned(&app, 1);
        let off = (relative * axis).distance(axis);
        let period = f64::from(crossings[crossings.len() - 1] - crossings[0]) * 2.0 / (crossings.len() - 1) as f64;
        println!(
            "door {frame} : {edge}: period {period} s, exact {exact} s, first at {} of {}, axis {off:.1e}, gap {open:.1e} m",
            crossings[0],
            exact / 4.0
        );
        assert!((period / exact - 1.0).abs() < 1e-5, "{period} s against {exact} s");
        assert!(off < 1e-5, "the axis turns by {off} rad");
        assert!(open < 1e-5, "the hinges open by {open} m");
    }
}

/// Two leaves on a hinge thrown through the air, with a tip that weighs as much or a hundred times as much as the rest: centre on its parabola, angular momentum kept, the hinge closed and its axis where it was in both.
#[test]
fn a_thrown_hinge_keeps_its_axis() {
    for heavy in [1.0, 100.0] {
        let mut app = simulation();
        let at =
            [[0.0, 0.0, -0.2], [0.0, 0.0, 0.2], [0.5, 0.0, -0.2], [0.5, 0.1, 0.2], [-0.5, 0.0, -0.2], [-0.5, -0.1, 0.2]].map(Vec3::from);
        let mass = |i: usize| if i == 3 { heavy } else { 1.0 };
        let body = app.world_mut().spawn((SoftBody::new(rig(&at, mass, 0.05)), rigid(&[&[0, 1, 2, 3], &[0, 1, 4, 5]]))).id();
        for i in [2, 3] {
            app.world_mut().get_mut::<Particles>(body).unwrap().velocity[i] = Vec3A::new(0.0, 3.0, 0.5);
        }
        // The first step makes the motion one that the hinge allows.
        steps(&mut app, 1);
        let before = momentum(particles(&app, body));
        let (mut bend, mut off, mut open) = (0.0f32, 0.0f32, 0.0f32);
        for _ in 0..600 {
            steps(&mut app, 1);
            let turned = |g| app.world().get::<ExplicitState>(body).unwrap().rotation(g).unwrap();
            let relative = turned(0).inverse() * turned(1);
            off = off.max((relative * Vec3::Z).distance(Vec3::Z));
            bend = bend.max(relative.angle_between(Quat::IDENTITY));
            open = open.max(gap(&app, body, [(0, 2), (1, 3), (0, 3), (0, 4), (1, 5), (0, 5)]));
        }
        let after = momentum(particles(&app, body));
        let spin = after.angular.distance(before.angular) / before.angular.length();
        let fall = (after.linear - before.linear).y / (-9.81 * 10.0 * after.mass) - 1.0;
        println!("thrown hinge 1 : {heavy}: axis {off:.1e}, gap {open:.1e} m, turned {bend}, L {spin:.1e}, P {fall:.1e}");
        assert!(bend > 0.5, "the leaves turn against each other: {bend}");
        assert!(off < 1e-5, "the axis turns by {off} rad");
        assert!(open < 1e-5, "the hinge opens by {open} m");
        assert!(spin < 5e-5 && fall.abs() < 5e-5, "L {spin}, P {fall}");
    }
}
