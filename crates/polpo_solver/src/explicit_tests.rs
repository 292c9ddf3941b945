//! Explicit groups against closed forms and conservation laws.

use core::f32::consts::PI;

use glam::{Quat, Vec3A};

use crate::testing::{Random, blob, line, scramble};
use crate::{
    Contact, Contacts, Deformable, Drive, Edges, ExplicitGroup, ExplicitGroups, ImplicitGroups, Motor, ParticleRest, Particles, Plasticity,
    RestPose, Stiffness, Sweep, Turning, creep_shapes, fit_rigid, integrate, land_explicit_groups, match_explicit_groups, match_shapes,
    momentum, predict, predict_explicit, quat_exp, quat_log, solve_contacts_beside,
};

pub(crate) const G: Vec3A = Vec3A::new(0.0, -9.81, 0.0);

pub(crate) fn points(at: &[[f32; 3]], mass: f32, radius: f32) -> Particles {
    let rest: Vec<ParticleRest> =
        at.iter().map(|&x| ParticleRest { position: Vec3A::from(x), frame: Quat::IDENTITY, radii: Vec3A::splat(radius), mass }).collect();
    Particles::new(&rest).unwrap()
}

pub(crate) fn rigid(p: &Particles, groups: &[&[u32]]) -> ExplicitGroups {
    ExplicitGroups::new(p, &groups.iter().map(|&g| ExplicitGroup::rigid(g)).collect::<Vec<_>>()).unwrap()
}

pub(crate) fn step(groups: &mut ExplicitGroups, p: &mut Particles, gravity: Vec3A, dt: f32) {
    predict(p, gravity, dt);
    predict_explicit(groups, p, dt);
    match_explicit_groups(groups, p, Sweep::only(dt));
    land_explicit_groups(groups, p, dt);
    integrate(p, dt, 0.0);
}

pub(crate) fn energy(p: &Particles, gravity: Vec3A) -> f32 {
    momentum(p).kinetic_energy - (0..p.len()).map(|i| p.mass[i] * gravity.dot(p.position[i])).sum::<f32>()
}

/// Times at which a series crosses zero, by straight lines between samples.
struct Crossings(f32, Vec<f32>);

impl Crossings {
    fn sample(&mut self, k: usize, value: f32, dt: f32) {
        if self.0 * value < 0.0 {
            self.1.push((k as f32 + self.0 / (self.0 - value)) * dt);
        }
        self.0 = value;
    }
}

/// The free asymmetric top of six unit masses turns over when Euler's equations say.
#[test]
fn a_free_top_turns_over_in_time() {
    let at = [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.8, 0.0], [0.0, -0.8, 0.0], [0.0, 0.0, 0.5], [0.0, 0.0, -0.5]];
    for (omega, expected) in
        [(Vec3A::new(0.1, 5.0, 0.0), [3.31495, 9.9449, 16.5748]), (Vec3A::new(0.5, 5.0, 0.0), [2.2719, 6.81575, 11.3596])]
    {
        for (substeps, tolerance) in [(1, 0.05), (5, 0.002), (20, 2e-4)] {
            let mut p = points(&at, 1.0, 1e-3);
            let mut groups = rigid(&p, &[&[0, 1, 2, 3, 4, 5]]);
            p.set_rigid_velocity(Vec3A::ZERO, omega);
            let dt = 1.0 / (60 * substeps) as f32;
            let mut crossings = Crossings(1.0, Vec::new());
            let before = momentum(&p);
            for k in 0..(60 * substeps * 17) as usize {
                step(&mut groups, &mut p, Vec3A::ZERO, dt);
                let w = groups.rotation(0).unwrap().inverse() * p.angular_velocity[0];
                crossings.sample(k, w.y, dt);
            }
            let after = momentum(&p);
            let errors: Vec<f32> = crossings.1.iter().zip(expected).map(|(a, b)| a - b).collect();
            let drift = after.angular.distance(before.angular) / before.angular.length();
            let gain = after.kinetic_energy / before.kinetic_energy - 1.0;
            println!("top {omega} × {substeps}: {errors:?}, L {drift:.1e}, E {gain:.1e}");
            assert!(errors.len() >= 3 && errors.iter().all(|e| e.abs() < tolerance), "{omega} × {substeps}: {errors:?}");
            assert!(drift < 1e-5 && gain.abs() < 1e-2);
        }
    }
}

#[test]
fn a_wheel_does_not_brake_itself() {
    for substeps in [1, 10] {
        let at: Vec<[f32; 3]> =
            (0..12).map(|i| quat_exp(Vec3A::Z * (i as f32 * PI / 6.0)) * Vec3A::X * 0.4).map(|x| x.to_array()).collect();
        let mut p = points(&at, 0.5, 0.05);
        let mut groups = rigid(&p, &[&[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11]]);
        p.set_rigid_velocity(Vec3A::X, Vec3A::Z * 10.0);
        let dt = 1.0 / (60 * substeps) as f32;
        for _ in 0..600 * substeps {
            step(&mut groups, &mut p, Vec3A::ZERO, dt);
        }
        let decay = p.angular_velocity[3].distance(Vec3A::Z * 10.0) / 10.0;
        println!("wheel × {substeps}: {decay:.1e}, P {:.1e}", momentum(&p).linear.x / 6.0 - 1.0);
        assert!(decay < 1e-4);
        assert!((momentum(&p).linear.x / 6.0 - 1.0).abs() < 1e-5);
    }
}

/// A rod of five balls pinned at its end is a compound pendulum.
#[test]
fn a_pinned_rod_swings_in_time() {
    for (angle, dt, tolerance) in [(0.1f32, 1.0 / 60.0, 0.002), (0.1, 1.0 / 300.0, 2e-4), (1.5, 1.0 / 300.0, 1e-3)] {
        let mut p = line(5, 0.25, 0.1);
        let mut groups = rigid(&p, &[&[0, 1, 2, 3, 4]]);
        p.place(quat_exp(Vec3A::Z * (angle - 0.5 * PI)), Vec3A::ZERO);
        p.pin(0, true, false);
        let mut crossings = Crossings(1.0, Vec::new());
        let start = energy(&p, G);
        let mut worst = 0.0f32;
        for k in 0..(10.0 / dt) as usize {
            step(&mut groups, &mut p, G, dt);
            crossings.sample(k, p.position[4].x, dt);
            worst = worst.max(p.position[0].length());
        }
        assert_eq!(p.position[0], Vec3A::ZERO);
        let inertia: f32 = (0..5).map(|i| (0.25 * i as f32).powi(2) + 0.4 * 0.01).sum();
        let moment = 9.81 * 2.5;
        // Period by the arithmetic-geometric mean: T = T₀/agm(1, cos(θ/2)).
        let (mut a, mut b) = (1.0, libm::cosf(0.5 * angle));
        for _ in 0..5 {
            (a, b) = (0.5 * (a + b), (a * b).sqrt());
        }
        let expected = 2.0 * PI * (inertia / moment).sqrt() / a;
        let n = crossings.1.len();
        let measured = 2.0 * (crossings.1[n - 1] - crossings.1[0]) / (n - 1) as f32;
        println!("pendulum {angle} at {dt}: {measured} against {expected}, E {:.1e}", energy(&p, G) - start);
        assert!((measured / expected - 1.0).abs() < tolerance, "{measured} against {expected}");
        let shape = fit_rigid(&p, groups.rotation(0).unwrap()).largest;
        assert!(shape < 1e-5 && worst == 0.0, "{shape}");
    }
}

/// Two pins are an axis, a pinned orientation does not turn, and what pins take up is booked.
#[test]
fn pins_take_what_they_pin() {
    let (rest, _) = blob();
    let all: Vec<u32> = (0..rest.len() as u32).collect();
    let dt = 1.0 / 300.0;
    let mut p = rest.clone();
    let mut groups = rigid(&p, &[&all]);
    p.pin(0, true, false);
    p.pin(7, true, false);
    let axis = (p.position[7] - p.position[0]).normalize();
    p.reaction = vec![Vec3A::ZERO; p.len()];
    let (start, mut fastest) = (energy(&p, G), 0.0f32);
    for _ in 0..900 {
        step(&mut groups, &mut p, G, dt);
        fastest = fastest.max(p.angular_velocity[3].length());
        assert!(p.angular_velocity[3].cross(axis).length() < 5e-3 * (1.0 + fastest), "{}", p.angular_velocity[3]);
    }
    println!("two pins: {fastest} rad/s, E {}", energy(&p, G) - start);
    assert!(fastest > 2.0 && p.position[0] == rest.position[0] && p.position[7] == rest.position[7]);
    assert!(fit_rigid(&p, groups.rotation(0).unwrap()).largest < 1e-4);
    assert!((energy(&p, G) - start).abs() < 0.05, "{}", energy(&p, G) - start);

    let mut p = rest.clone();
    let mut groups = rigid(&p, &[&all]);
    p.pin(4, false, true);
    p.velocity[0] = Vec3A::new(5.0, 1.0, 0.0);
    let total = momentum(&p).linear;
    for _ in 0..300 {
        step(&mut groups, &mut p, Vec3A::ZERO, dt);
    }
    assert!(quat_log(p.rotation[9]).length() < 1e-6, "{}", p.rotation[9]);
    assert!(momentum(&p).linear.distance(total) < 1e-4);

    // Four pins hold the weight.
    let mut p = rest;
    let mut groups = rigid(&p, &[&all]);
    for i in [0, 2, 6, 8] {
        p.pin(i, true, false);
    }
    for _ in 0..300 {
        p.reaction = vec![Vec3A::ZERO; p.len()];
        step(&mut groups, &mut p, G, dt);
    }
    let free: f32 = (0..p.len()).filter(|&i| p.inverse_mass[i] > 0.0).map(|i| p.mass[i]).sum();
    let held: Vec3A = p.reaction.iter().sum();
    assert!((held / dt - G * free).length() < 0.01 * 9.81 * free, "{} against {}", held / dt, G * free);
    assert!(p.velocity[17].length() < 1e-3);
}

/// A motor between two groups on a common axle reaches its speed; what it gives the one it takes from the other.
#[test]
fn a_motor_reaches_its_speed_and_pushes_back() {
    let at = [[0.0, 0.0, -0.1], [0.0, 0.0, 0.1], [0.3, 0.0, 0.0], [-0.3, 0.0, 0.0], [0.0, 0.6, 0.0], [0.0, -0.5, 0.05]];
    for stiffness in [Stiffness::RIGID, Stiffness::hertz(30.0)] {
        let mut p = points(&at, 1.0, 0.08);
        let wheel = ExplicitGroup {
            motor: Some(Motor { axis: Vec3A::Z * 2.0, drive: Drive::Speed { target: 20.0, max_torque: 5.0 }, against: Some(1) }),
            ..ExplicitGroup::rigid([0, 1, 2, 3])
        };
        let chassis = ExplicitGroup { stiffness, ..ExplicitGroup::rigid([0, 1, 4, 5]) };
        let mut groups = ExplicitGroups::new(&p, &[wheel, chassis]).unwrap();
        let dt = 1.0 / 300.0;
        let speed = |p: &Particles| (p.rotation[2] * Vec3A::Z).dot(p.angular_velocity[2] - p.angular_velocity[4]);
        let mut early = 0.0;
        for k in 0..1500 {
            step(&mut groups, &mut p, Vec3A::ZERO, dt);
            if k == 29 {
                early = speed(&p);
            }
        }
        let m = momentum(&p);
        println!("motor: {} after 0.1 s, {} rad/s at last, P {}, L {}", early, speed(&p), m.linear, m.angular);
        if stiffness == Stiffness::RIGID {
            assert!((speed(&p) - 20.0).abs() < 0.02, "{}", speed(&p));
            assert!(early < 19.0);
            assert!(m.linear.length() < 1e-5 && m.angular.length() < 1e-5, "{} {}", m.linear, m.angular);
        } else {
            assert!((speed(&p) - 20.0).abs() < 2.0, "{}", speed(&p));
            assert!(m.linear.length() < 1e-4 && m.angular.length() < 0.02, "{} {}", m.linear, m.angular);
        }
    }
    // A torque against the world is L = τ·t.
    let mut p = points(&at, 1.0, 0.08);
    let motor = Some(Motor { axis: Vec3A::Z, drive: Drive::Torque(0.5), against: None });
    let mut groups = ExplicitGroups::new(&p, &[ExplicitGroup { motor, ..ExplicitGroup::rigid([0, 1, 2, 3]) }]).unwrap();
    for _ in 0..300 {
        step(&mut groups, &mut p, Vec3A::ZERO, 1.0 / 300.0);
    }
    assert!((momentum(&p).angular - Vec3A::Z * 0.5).length() < 1e-4, "{}", momentum(&p).angular);
}

pub(crate) fn floor(particle: u32) -> Contact {
    Contact {
        particle,
        friction: 0.8,
        point: Vec3A::ZERO,
        normal: Vec3A::Y,
        velocity: Vec3A::ZERO,
        angular_velocity: Vec3A::ZERO,
        impulse: 0.0,
    }
}

/// A box of many particles lands on few of them without sinking in, comes to rest and stays.
#[test]
fn a_group_lands_on_its_feet() {
    let at: Vec<[f32; 3]> = (0..125).map(|i| [(i % 5) as f32 * 0.1, (i / 5 % 5) as f32 * 0.1 + 0.6, (i / 25) as f32 * 0.1]).collect();
    let mut p = points(&at, 0.2, 0.05);
    let all: Vec<u32> = (0..125).collect();
    let mut groups = rigid(&p, &[&all]);
    p.place(quat_exp(Vec3A::new(0.1, 0.0, 0.2)), Vec3A::ZERO);
    p.set_rigid_velocity(Vec3A::new(1.0, -4.0, 0.0), Vec3A::new(0.0, 1.0, 0.5));
    let mut contacts = Contacts { list: (0..125).map(floor).collect() };
    let dt = 1.0 / 300.0;
    let mut deepest = 0.0f32;
    for _ in 0..1500 {
        predict(&mut p, G, dt);
        predict_explicit(&mut groups, &mut p, dt);
        match_explicit_groups(&mut groups, &mut p, Sweep::only(dt));
        solve_contacts_beside(&groups, &mut contacts, &mut p, dt, 3.0);
        land_explicit_groups(&mut groups, &mut p, dt);
        integrate(&mut p, dt, 0.0);
        deepest = p.position.iter().map(|x| 0.05 - x.y).fold(deepest, f32::max);
    }
    let m = momentum(&p);
    println!(
        "landing: {deepest} m deep at worst, ends at {} with {} m/s, {} rad/s",
        m.center,
        m.linear.length() / 25.0,
        p.angular_velocity[0]
    );
    assert!(deepest < 0.01, "{deepest} m deep");
    assert!(p.angular_velocity[0].length() < 0.05 && m.linear.length() / 25.0 < 0.02);
    assert!((m.center.y - 0.25).abs() < 0.01);
}

/// Momentum that other constraints give single members is all the group's, and the pose follows.
#[test]
fn blows_on_members_move_the_whole_group() {
    let (mut p, _) = blob();
    let all: Vec<u32> = (0..p.len() as u32).collect();
    let mut groups = rigid(&p, &[&all]);
    let dt = 1.0 / 300.0;
    let mut random = Random(3);
    let (mut worst, mut travelled) = (0.0f32, 0.0);
    for _ in 0..200 {
        predict(&mut p, Vec3A::ZERO, dt);
        predict_explicit(&mut groups, &mut p, dt);
        for i in 0..4 {
            p.displace(i, random.vector() * 0.002 + Vec3A::X * 1e-4, 1.0 / dt);
            p.turn(i + 3, random.vector() * 0.05, 1.0 / dt);
        }
        let before = momentum(&p);
        match_explicit_groups(&mut groups, &mut p, Sweep::only(dt));
        let after = momentum(&p);
        worst = worst.max(after.linear.distance(before.linear)).max(after.angular.distance(before.angular));
        assert!(fit_rigid(&p, groups.rotation(0).unwrap()).largest < 1e-6);
        travelled = p.position[0].x;
    }
    println!("blows: {worst:.1e}, travelled {travelled}");
    assert!(worst < 2e-5 && travelled > 0.1);
}

/// A fast blow opens the group; while it is open the implicit groups act, and when it closes the dent stays.
#[test]
fn a_dent_stays() {
    let (rest, pairs) = blob();
    let all: Vec<u32> = (0..rest.len() as u32).collect();
    let edges = Edges::new(&rest, &pairs).unwrap();
    let dt = 1.0 / 300.0;
    let mut results = Vec::new();
    for (dent, speed) in [(0.3, 8.0f32), (0.0, 8.0), (0.3, 2.0)] {
        let mut p = rest.clone();
        let group = ExplicitGroup { deformable: Some(Deformable { speed: 4.0, time: 0.1, dent }), ..ExplicitGroup::rigid(all.clone()) };
        let mut groups = ExplicitGroups::new(&p, &[group]).unwrap();
        let mut implicit = ImplicitGroups::beside(&p, &edges, &groups);
        assert_eq!(implicit.len(), p.len());
        p.place(Quat::IDENTITY, Vec3A::Y * (0.3 - 0.0));
        p.set_rigid_velocity(Vec3A::Y * -speed, Vec3A::ZERO);
        let mut contacts = Contacts { list: (0..p.len() as u32).map(floor).collect() };
        let (mut revision, mut opened) = (groups.revision(), false);
        let share = Stiffness::hertz(8.0).share(dt);
        for _ in 0..400 {
            predict(&mut p, G, dt);
            predict_explicit(&mut groups, &mut p, dt);
            if groups.revision() != revision {
                implicit.rest_where_held(&groups);
                revision = groups.revision();
            }
            match_shapes(&mut implicit, &mut p, share.into(), Turning::AllMembers, Sweep::only(dt));
            creep_shapes(&mut implicit, &p, &RestPose::default(), Plasticity { yield_strain: 0.05, creep: 200.0, maximum: 0.5 }, dt);
            match_explicit_groups(&mut groups, &mut p, Sweep::only(dt));
            groups.strike_all(&p, &contacts, dt);
            if groups.revision() != revision {
                implicit.rest_where_held(&groups);
                revision = groups.revision();
            }
            opened |= groups.is_open(0);
            solve_contacts_beside(&groups, &mut contacts, &mut p, dt, 3.0);
            land_explicit_groups(&mut groups, &mut p, dt);
            integrate(&mut p, dt, 0.5);
        }
        assert!(p.is_finite() && !groups.is_open(0));
        results.push((opened, fit_rigid(&p, groups.rotation(0).unwrap()).largest));
    }
    println!("dents: {results:?}");
    assert!(results[0].0 && results[0].1 > 0.02 && results[0].1 < 0.3);
    assert!(results[1].0 && results[1].1 < 1e-4);
    assert!(!results[2].0 && results[2].1 < 1e-4);
}

/// Whatever the members are made to look like, the group finds its shape again, without speed from nowhere.
#[test]
fn collapsed_and_inverted_groups_recover() {
    let (rest, _) = blob();
    let all: Vec<u32> = (0..rest.len() as u32).collect();
    for collapse in [Vec3A::ZERO, Vec3A::new(1.0, 1.0, 0.0), Vec3A::new(1.0, 1.0, -1.0), -Vec3A::ONE] {
        let mut p = rest.clone();
        let mut groups = rigid(&p, &[&all]);
        for x in &mut p.position {
            *x *= collapse;
        }
        for _ in 0..10 {
            step(&mut groups, &mut p, Vec3A::ZERO, 1.0 / 60.0);
        }
        assert!(fit_rigid(&p, groups.rotation(0).unwrap()).largest < 1e-5, "{collapse}");
        assert!(momentum(&p).kinetic_energy < 1e-6);
    }
    // Joints torn apart close without a bang.
    let mut p = line(9, 0.125, 0.05);
    let mut groups = rigid(&p, &[&[0, 1, 2, 3, 4], &[4, 5, 6, 7, 8]]);
    scramble(&mut p, 8);
    for i in 5..9 {
        p.position[i] += Vec3A::new(0.5, 0.3, 0.0);
    }
    for _ in 0..60 {
        step(&mut groups, &mut p, Vec3A::ZERO, 1.0 / 60.0);
    }
    assert!(
        (p.position[4].distance(p.position[5]) - 0.125).abs() < 1e-4 && momentum(&p).kinetic_energy < 0.1,
        "{}",
        momentum(&p).kinetic_energy
    );
}

#[test]
fn small_and_flat_groups_are_right() {
    let dt = 1.0 / 120.0;
    let mut p = line(6, 0.5, 0.1);
    // One, two and three on a line.
    let mut groups = rigid(&p, &[&[0], &[1, 2], &[3, 4, 5]]);
    for i in 0..6 {
        p.velocity[i] = Vec3A::new(0.1, 0.5, i as f32);
        p.angular_velocity[i] = Vec3A::new(1.0, 2.0, 3.0);
    }
    step(&mut groups, &mut p, Vec3A::ZERO, dt);
    let before = momentum(&p);
    let single = p.position[0];
    for _ in 0..1200 {
        step(&mut groups, &mut p, Vec3A::ZERO, dt);
    }
    let after = momentum(&p);
    assert!(p.is_finite());
    assert!(p.position[0].distance(single + Vec3A::new(1.0, 5.0, 0.0)) < 1e-3, "{}", p.position[0]);
    assert!(p.angular_velocity[0].distance(Vec3A::new(1.0, 2.0, 3.0)) < 1e-4);
    assert!((p.position[1].distance(p.position[2]) - 0.5).abs() < 1e-5 && (p.position[3].distance(p.position[5]) - 1.0).abs() < 1e-5);
    assert!(after.linear.distance(before.linear) < 1e-4 && after.angular.distance(before.angular) < 1e-3);
    // A spin about the row's own axis stays, too.
    let mut p = line(3, 0.5, 0.1);
    let mut groups = rigid(&p, &[&[0, 1, 2]]);
    p.set_rigid_velocity(Vec3A::ZERO, Vec3A::X * 7.0);
    for _ in 0..1200 {
        step(&mut groups, &mut p, Vec3A::ZERO, dt);
    }
    assert!(p.angular_velocity[1].distance(Vec3A::X * 7.0) < 1e-4, "{}", p.angular_velocity[1]);
}

/// A group twice as large turns four times slower, less the spin of its balls.
#[test]
fn inflation_keeps_spin() {
    let mut p = points(&[[0.5, 0.0, 0.0], [-0.5, 0.0, 0.0], [0.0, 0.5, 0.0], [0.0, -0.5, 0.0]], 1.0, 1e-3);
    let mut groups = rigid(&p, &[&[0, 1, 2, 3]]);
    p.set_rigid_velocity(Vec3A::ZERO, Vec3A::Z * 8.0);
    for k in 0..100 {
        groups.set_scale(0, 1.0 + 0.01 * (k + 1) as f32).unwrap();
        step(&mut groups, &mut p, Vec3A::ZERO, 0.005);
    }
    step(&mut groups, &mut p, Vec3A::ZERO, 0.005);
    assert!((p.position[0].distance(p.position[1]) - 2.0).abs() < 1e-5);
    assert!((p.angular_velocity[0].z - 2.0).abs() < 1e-3, "{}", p.angular_velocity[0]);
}

/// A soft group swings about its shape, and its members have no implicit group.
#[test]
fn a_soft_group_pulls_by_its_stiffness() {
    let (mut p, pairs) = blob();
    let edges = Edges::new(&p, &pairs).unwrap();
    let soft = ExplicitGroup { stiffness: Stiffness::damped(5.0, 0.3), ..ExplicitGroup::rigid([0, 1, 2, 3, 4, 9, 10]) };
    let mut groups = ExplicitGroups::new(&p, &[soft]).unwrap();
    let implicit = ImplicitGroups::beside(&p, &edges, &groups);
    assert_eq!(implicit.len(), p.len() - 7);
    p.position[10].y += 0.1;
    let dt = 1.0 / 240.0;
    let mut largest = 0.0f32;
    for k in 0..480 {
        step(&mut groups, &mut p, Vec3A::ZERO, dt);
        if k == 2 {
            largest = p.position[10].y;
        }
    }
    assert!(momentum(&p).linear.length() < 1e-5 && p.velocity[10].length() < 0.05);
    assert!(largest > p.position[10].y + 0.05, "{largest} {}", p.position[10]);
    assert!(p.velocity[17] == Vec3A::ZERO);
}

/// A kinematic pin and a kinematic orientation take their group along, and several sweeps change nothing in free flight.
#[test]
fn moving_pins_carry_and_sweeps_agree() {
    let dt = 1.0 / 240.0;
    let mut p = line(3, 0.3, 0.1);
    let mut groups = rigid(&p, &[&[0, 1, 2]]);
    p.pin(1, true, true);
    for k in 0..480 {
        p.velocity[1] = Vec3A::new(libm::cosf(k as f32 * 0.02), 0.5, 0.0);
        p.angular_velocity[1] = Vec3A::new(0.3, 2.0, 1.0);
        step(&mut groups, &mut p, G, dt);
    }
    for i in [0, 2] {
        let expected = p.position[1] + p.rotation[1] * (p.rest_position[i] - p.rest_position[1]);
        assert!(p.position[i].distance(expected) < 1e-5, "{i}");
    }
    let mut p = line(9, 0.125, 0.05);
    let mut groups = rigid(&p, &[&[0, 1, 2, 3, 4], &[4, 5, 6, 7, 8]]);
    p.velocity[8] = Vec3A::new(0.0, 4.0, 1.0);
    let (mut q, mut twice) = (p.clone(), groups.clone());
    for _ in 0..240 {
        step(&mut groups, &mut p, Vec3A::ZERO, dt);
        predict(&mut q, Vec3A::ZERO, dt);
        predict_explicit(&mut twice, &mut q, dt);
        for index in 0..3 {
            match_explicit_groups(&mut twice, &mut q, Sweep { index, count: 3, ..Sweep::only(dt) });
        }
        land_explicit_groups(&mut twice, &mut q, dt);
        integrate(&mut q, dt, 0.0);
    }
    assert_eq!(p, q);
}
