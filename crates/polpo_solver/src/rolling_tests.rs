//! Explicit groups on the ground, against closed forms: wheels that roll, slide, stumble and drive.

use core::f32::consts::PI;

use glam::{Quat, Vec3A};

use crate::explicit_tests::{G, energy, floor, points, rigid};
use crate::{
    Contact, Contacts, Drive, ExplicitGroup, ExplicitGroups, Motor, ParticleRest, Particles, Sweep, integrate, land_explicit_groups,
    match_explicit_groups, momentum, predict, predict_explicit, quat_exp, solve_contacts_beside,
};

fn step(groups: &mut ExplicitGroups, p: &mut Particles, contacts: &mut Contacts, dt: f32) {
    predict(p, G, dt);
    predict_explicit(groups, p, dt);
    match_explicit_groups(groups, p, Sweep::only(dt));
    solve_contacts_beside(groups, contacts, p, dt, 3.0);
    land_explicit_groups(groups, p, dt);
    integrate(p, dt, 0.0);
}

/// A ball of 0.5 m with six weights inside, on a slope of 20°: a = g·sin/(1 + k), k = J/(M·R²), if μ ≥ tan·k/(1 + k), else g·(sin − μ·cos). The errors go with the substep.
#[test]
fn a_weighted_ball_rolls_and_slides_down_a_slope() {
    for (friction, substeps, tolerance) in [(0.8, 1, 3e-3), (0.8, 5, 6e-4), (0.8, 20, 2e-4), (0.06, 5, 6e-4), (0.04, 5, 1e-4)] {
        let inner = [[0.2, 0.0, 0.0], [-0.2, 0.0, 0.0], [0.0, 0.2, 0.0], [0.0, -0.2, 0.0], [0.0, 0.0, 0.2], [0.0, 0.0, -0.2]];
        let mut rest = vec![ParticleRest { position: Vec3A::ZERO, frame: Quat::IDENTITY, radii: Vec3A::splat(0.5), mass: 1.0 }];
        rest.extend(inner.map(|x| ParticleRest { position: x.into(), radii: Vec3A::splat(0.1), ..rest[0] }));
        let mut p = Particles::new(&rest).unwrap();
        let mut groups = rigid(&p, &[&[0, 1, 2, 3, 4, 5, 6]]);
        let (sin, cos) = (libm::sinf(PI / 9.0), libm::cosf(PI / 9.0));
        let (normal, down) = (Vec3A::new(sin, cos, 0.0), Vec3A::new(cos, -sin, 0.0));
        p.place(Quat::IDENTITY, normal * 0.5);
        let k = (p.inertia.iter().sum::<f32>() + 4.0 * 0.04) / (7.0 * 0.25);
        let mut contacts = Contacts { list: (0..7).map(|i| Contact { normal, friction, ..floor(i) }).collect() };
        for _ in 0..60 * substeps {
            step(&mut groups, &mut p, &mut contacts, 1.0 / (60 * substeps) as f32);
        }
        let rolls = friction > sin / cos * k / (1.0 + k);
        assert_eq!(rolls, friction > 0.051);
        let expected = if rolls { 9.81 * sin / (1.0 + k) } else { 9.81 * (sin - friction * cos) };
        let got = p.velocity[0].dot(down);
        println!("slope, μ {friction} × {substeps}: {got} against {expected} m/s after 1 s");
        assert!((got / expected - 1.0).abs() < tolerance, "{got} against {expected}");
        assert!((normal.dot(p.position[0]) - 0.5).abs() < 1e-4);
    }
}

/// A wheel of n round feet stumbles from foot to foot. At each the angular momentum about the new foot's point stays: ω′/ω = (J + M(H² − d²))/(J + M(H² + d²)), H the height of the hub over two feet, d half
/// their distance; at the very first, with the hub moving level, (J + M·H²)/(J + M(H² + d²)). In between nothing is lost. The errors go with the substep, and with the number of impacts.
#[test]
fn a_wheel_of_feet_loses_at_each_foot_what_it_must() {
    for (n, substeps, tolerance) in [(12, 20, 5e-3), (24, 1, 0.06), (24, 5, 0.013), (24, 20, 4e-3), (48, 5, 6e-3)] {
        let half = PI / n as f32;
        let foot = |i: u32| quat_exp(Vec3A::Z * ((2 * i + 1) as f32 * half)) * Vec3A::Y * 0.5;
        let mut p = points(&(0..n).map(|i| foot(i).to_array()).collect::<Vec<_>>(), 1.0, 0.05);
        let mut groups = rigid(&p, &[&(0..n).collect::<Vec<_>>()]);
        let (h, d) = (0.5 * libm::cosf(half) + 0.05, 0.5 * libm::sinf(half));
        let (omega, m) = (4.0, n as f32);
        p.place(Quat::IDENTITY, Vec3A::Y * h);
        p.set_rigid_velocity(Vec3A::X * (omega * h), Vec3A::Z * -omega);
        let mut contacts = Contacts { list: (0..n).map(floor).collect() };
        let dt = 1.0 / (60 * substeps) as f32;
        let (mut deepest, mut turned) = (0.0f32, 0.0);
        for _ in 0..60 * substeps * 10 {
            step(&mut groups, &mut p, &mut contacts, dt);
            deepest = p.position.iter().map(|x| 0.05 - x.y).fold(deepest, f32::max);
            turned -= p.angular_velocity[0].z * dt;
            if turned > 13.0 * half {
                break;
            }
        }
        let about = m * 0.25 + p.inertia.iter().sum::<f32>() + m * (h * h + d * d);
        let expected = omega * (1.0 - m * d * d / about) * libm::powf(1.0 - 2.0 * m * d * d / about, 6.0);
        // By the energy, as if the hub were at the height of two feet.
        let got = (2.0 * (energy(&p, G) - m * 9.81 * h) / about).sqrt();
        println!("{n} feet × {substeps}: {got} against {expected} rad/s after six, {deepest} m deep");
        assert!(turned > 13.0 * half && (got / expected - 1.0).abs() < tolerance && deepest < 1e-4, "{got} against {expected}");
    }
}

/// A cart on four driven wheels, hinged on two particles each: it starts by the motors' torque, F = 4·τ/r against M + 4·J/r², keeps the speed that they are set to, and the counter-torque lets it neither rear nor tip.
#[test]
fn a_cart_drives() {
    for (mass, substeps, tolerance) in [(4.0f32, 5, 8e-3), (40.0, 5, 8e-3), (40.0, 20, 3e-3)] {
        let (mut rest, mut groups) = (Vec::new(), vec![ExplicitGroup::rigid([])]);
        let mut put = |x: f32, y: f32, z: f32, radius: f32, mass: f32| {
            rest.push(ParticleRest { position: Vec3A::new(x, y, z), frame: Quat::IDENTITY, radii: Vec3A::splat(radius), mass });
            rest.len() as u32 - 1
        };
        let motor = Some(Motor { axis: Vec3A::Z, drive: Drive::Speed { target: -10.0, max_torque: 2.0 }, against: Some(0) });
        for (x, z) in [(-0.8, -0.5), (0.8, -0.5), (-0.8, 0.5), (0.8, 0.5)] {
            let axle = [put(x, 0.3, z - 0.05, 0.02, 0.05), put(x, 0.3, z + 0.05, 0.02, 0.05)];
            let wheel = put(x, 0.3, z, 0.3, 1.0);
            groups[0].members.extend(axle);
            groups[0].members.push(put(0.75 * x, 0.6, 0.6 * z, 0.02, mass / 4.0));
            groups.push(ExplicitGroup { motor, ..ExplicitGroup::rigid([axle[0], axle[1], wheel]) });
        }
        let mut p = Particles::new(&rest).unwrap();
        let mut groups = ExplicitGroups::new(&p, &groups).unwrap();
        let mut contacts = Contacts { list: (0..p.len() as u32).map(floor).collect() };
        let (mut deepest, mut early) = (0.0f32, 0.0);
        let speed = |p: &Particles| momentum(p).linear.x / p.total_mass();
        for k in 0..60 * substeps * 6 {
            step(&mut groups, &mut p, &mut contacts, 1.0 / (60 * substeps) as f32);
            if k + 1 == 30 * substeps {
                early = speed(&p);
            }
            deepest = (0..4).map(|w| 0.3 - p.position[4 * w + 2].y).fold(deepest, f32::max);
        }
        let (spin, r) = (4.0 * 0.4 * 0.09, 0.3);
        let expected = 0.5 * (4.0 * 2.0 / r) / (p.total_mass() + spin / (r * r));
        println!("cart of {mass} kg × {substeps}: {early} against {expected} m/s after 0.5 s, {} at last, {deepest} m deep", speed(&p));
        assert!((early / expected - 1.0).abs() < tolerance && (speed(&p) / 3.0 - 1.0).abs() < 1e-3);
        assert!(crate::quat_log(p.rotation[3]).length() < 1e-3 && deepest < 2e-3, "{} {deepest}", p.rotation[3]);
    }
}
