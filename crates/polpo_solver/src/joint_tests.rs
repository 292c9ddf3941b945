//! Joints between explicit groups against conservation laws.

use glam::{Quat, Vec3A};

use crate::explicit_tests::{G, energy, points, rigid, step};
use crate::testing::{Random, blob, line};
use crate::{ExplicitGroup, ExplicitGroups, ParticleRest, Particles, Stiffness, momentum, quat_log};

/// Two rods with a ball joint, hung from a pin: energy, and the joint.
#[test]
fn a_double_pendulum_keeps_its_energy_and_its_joint() {
    for substeps in [5, 20] {
        let mut p = line(9, 0.125, 0.05);
        let mut groups = rigid(&p, &[&[0, 1, 2, 3, 4], &[4, 5, 6, 7, 8]]);
        p.pin(0, true, false);
        let dt = 1.0 / (60 * substeps) as f32;
        let start = energy(&p, G);
        let (mut low, mut high, mut gap, mut deepest) = (0.0f32, 0.0f32, 0.0f32, 0.0f32);
        for _ in 0..600 * substeps {
            step(&mut groups, &mut p, G, dt);
            let e = energy(&p, G) - start;
            (low, high) = (low.min(e), high.max(e));
            gap = gap.max((p.position[4].distance(p.position[3]) - 0.125).abs()).max((p.position[5].distance(p.position[4]) - 0.125).abs());
            deepest = deepest.min(p.position[8].y);
        }
        let scale = 9.81 * 9.0 * 0.5;
        println!("double pendulum × {substeps}: E {:.3} … {:.3} % of {scale}, gap {gap:.1e}", 100.0 * low / scale, 100.0 * high / scale);
        assert!(deepest < -0.8);
        assert!(gap < 1e-5, "{gap}");
        assert!(high < 0.03 * scale && low > -0.03 * scale, "{low} … {high} of {scale}");
    }
}

/// A chain of two-particle links whose masses go 1 : 10 : 1 … stays together, and in free flight keeps P and L, whatever the order of its links. (Every other one first, half of them carry nobody's spin:
/// needles without inertia about themselves.)
#[test]
fn jointed_links_keep_momentum_in_free_flight() {
    let rest: Vec<ParticleRest> = (0..9)
        .map(|i| ParticleRest {
            position: Vec3A::new(0.2 * i as f32, 0.05 * (i % 2) as f32, 0.0),
            frame: Quat::IDENTITY,
            radii: Vec3A::splat(0.06),
            mass: if i % 2 == 0 { 0.3 } else { 3.0 },
        })
        .collect();
    for (substeps, order) in [(5, [0, 1, 2, 3, 4, 5, 6, 7]), (20, [0, 1, 2, 3, 4, 5, 6, 7]), (5, [0, 2, 4, 6, 1, 3, 5, 7])] {
        let mut p = Particles::new(&rest).unwrap();
        let links: Vec<[u32; 2]> = order.iter().map(|&i| [i, i + 1]).collect();
        let mut groups = rigid(&p, &links.iter().map(|l| &l[..]).collect::<Vec<_>>());
        let mut random = Random(9);
        p.set_rigid_velocity(Vec3A::new(0.3, 0.2, -0.1), Vec3A::new(0.5, 1.0, 3.0));
        for v in &mut p.velocity {
            *v += random.vector();
        }
        let dt = 1.0 / (60 * substeps) as f32;
        // The first substep makes the motion one that the joints allow.
        step(&mut groups, &mut p, Vec3A::ZERO, dt);
        let before = momentum(&p);
        let (mut gap, mut low, mut high) = (0.0f32, f32::MAX, 0.0f32);
        for _ in 0..600 * substeps {
            step(&mut groups, &mut p, Vec3A::ZERO, dt);
            for &[i, j] in &links {
                let (i, j) = (i as usize, j as usize);
                gap = gap.max((p.position[i].distance(p.position[j]) - rest[i].position.distance(rest[j].position)).abs());
            }
            let e = momentum(&p).kinetic_energy;
            (low, high) = (low.min(e), high.max(e));
        }
        let after = momentum(&p);
        let (dp, dl) = (after.linear.distance(before.linear), after.angular.distance(before.angular));
        println!(
            "links × {substeps}: P {dp:.1e} of {}, L {dl:.1e} of {}, gap {gap:.1e}, E {low} … {high}",
            before.linear.length(),
            before.angular.length()
        );
        assert!(dp < 1e-5 * before.linear.length() && dl < 1e-5 * before.angular.length(), "P {dp}, L {dl}");
        assert!(gap < 1e-5);
        assert!(low > 0.95 * before.kinetic_energy && high < 1.05 * before.kinetic_energy);
    }
}

/// A long heavy-ended chain hangs without stretch and swings as its rigid links do.
#[test]
fn a_chain_holds_a_heavy_end() {
    let mut rest: Vec<ParticleRest> = (0..21)
        .map(|i| ParticleRest { position: Vec3A::X * (0.1 * i as f32), frame: Quat::IDENTITY, radii: Vec3A::splat(0.03), mass: 0.1 })
        .collect();
    rest[20].mass = 1.0;
    let mut p = Particles::new(&rest).unwrap();
    let links: Vec<[u32; 2]> = (0..20).map(|i| [i, i + 1]).collect();
    let mut groups = rigid(&p, &links.iter().map(|l| &l[..]).collect::<Vec<_>>());
    p.pin(0, true, false);
    let start = energy(&p, G);
    let (mut gap, mut high) = (0.0f32, 0.0f32);
    for _ in 0..3000 {
        step(&mut groups, &mut p, G, 1.0 / 600.0);
        for i in 0..20 {
            gap = gap.max((p.position[i].distance(p.position[i + 1]) - 0.1).abs());
        }
        high = high.max(energy(&p, G) - start);
    }
    println!("heavy end: gap {gap:.1e}, energy +{high} of {}", 3.0 * 9.81 * 2.0);
    assert!(gap < 1e-4, "{gap}");
    assert!(p.is_finite() && high < 0.05 * 60.0, "{high}");
}

/// Two shared particles are a hinge: the groups turn against each other about the line through them, and about nothing else.
#[test]
fn a_hinge_keeps_its_axis() {
    let at = [[0.0, 0.0, -0.2], [0.0, 0.0, 0.2], [0.5, 0.0, -0.2], [0.5, 0.1, 0.2], [-0.5, 0.0, -0.2], [-0.5, -0.1, 0.2]];
    let mut p = points(&at, 1.0, 0.1);
    let mut groups = rigid(&p, &[&[0, 1, 2, 3], &[0, 1, 4, 5]]);
    for i in [2, 3] {
        p.velocity[i] = Vec3A::new(0.0, 3.0, 0.5);
    }
    let dt = 1.0 / 300.0;
    step(&mut groups, &mut p, Vec3A::ZERO, dt);
    let before = momentum(&p);
    let (mut bend, mut worst, mut joint) = (0.0f32, 0.0f32, 0.0f32);
    for _ in 0..3000 {
        step(&mut groups, &mut p, Vec3A::ZERO, dt);
        let relative = groups.rotation(0).unwrap().inverse() * groups.rotation(1).unwrap();
        worst = worst.max((relative * Vec3A::Z).distance(Vec3A::Z));
        bend = bend.max(quat_log(relative).length());
        joint =
            joint.max((p.position[0].distance(p.position[2]) - 0.5).abs()).max((p.position[1].distance(p.position[4]) - 0.640_312_4).abs());
    }
    let after = momentum(&p);
    let drift = after.angular.distance(before.angular) / before.angular.length();
    println!(
        "hinge: axis {worst:.1e} rad, joint {joint:.1e} m, turned {bend}, L {drift:.1e}, E {}",
        after.kinetic_energy / before.kinetic_energy
    );
    assert!(bend > 1.0 && worst < 1e-4 && joint < 1e-4 && drift < 1e-5);
    assert!((after.kinetic_energy / before.kinetic_energy - 1.0).abs() < 0.02);
}

/// Four rods with hinges at all corners: a loop, whose joints ask for more than there is. It keeps its shape, P and L.
#[test]
fn a_loop_of_hinges_stays_together() {
    // Two particles at each corner of a square, one behind the other.
    let at: Vec<[f32; 3]> = (0..8).map(|i| [[0.0, 1.0, 1.0, 0.0][i / 2], [0.0, 0.0, 1.0, 1.0][i / 2], 0.3 * (i % 2) as f32]).collect();
    let mut p = points(&at, 1.0, 0.1);
    let mut groups = rigid(&p, &[&[0, 1, 2, 3], &[2, 3, 4, 5], &[4, 5, 6, 7], &[6, 7, 0, 1]]);
    for i in [4, 5] {
        p.velocity[i] = Vec3A::new(1.0, 1.0, 0.2);
    }
    let dt = 1.0 / 300.0;
    step(&mut groups, &mut p, Vec3A::ZERO, dt);
    let before = momentum(&p);
    let (mut gap, mut thinnest) = (0.0f32, f32::MAX);
    for _ in 0..3000 {
        step(&mut groups, &mut p, Vec3A::ZERO, dt);
        for i in 0..8 {
            gap = gap.max((p.position[i].distance(p.position[(i + 2) % 8]) - 1.0).abs());
        }
        thinnest = thinnest.min(p.position[0].distance(p.position[4]));
    }
    let after = momentum(&p);
    let (dp, dl) = (after.linear.distance(before.linear), after.angular.distance(before.angular));
    println!(
        "loop: gap {gap:.1e}, diagonal down to {thinnest}, P {dp:.1e}, L {dl:.1e}, E {}",
        after.kinetic_energy / before.kinetic_energy
    );
    assert!(gap < 1e-4 && thinnest < 1.2);
    assert!(dp < 1e-5 * before.linear.length() && dl < 1e-5 * (before.angular.length() + 1.0));
    assert!((after.kinetic_energy / before.kinetic_energy - 1.0).abs() < 0.05);
}

/// Whatever overlaps, hangs together in loops or contradicts itself: nothing but motors and pins that move gives it energy, P and L stay in free flight, and it stays finite.
#[test]
fn random_groups_neither_explode_nor_drift() {
    let mut random = Random(77);
    let (mut drift, mut gain) = (0.0f32, 0.0f32);
    for case in 0..120 {
        let (mut p, _) = blob();
        let n = p.len();
        let mut pick = |most: u32| ((random.signed() + 1.0) * 0.5 * most as f32) as u32 % most;
        let groups: Vec<ExplicitGroup> = (0..1 + pick(6))
            .map(|_| {
                let mut members: Vec<u32> = (0..1 + pick(7)).map(|_| pick(n as u32)).collect();
                members.sort_unstable();
                members.dedup();
                ExplicitGroup {
                    stiffness: if pick(4) == 0 { Stiffness::damped(10.0, 0.5) } else { Stiffness::RIGID },
                    ..ExplicitGroup::rigid(members)
                }
            })
            .collect();
        let mut explicit = ExplicitGroups::new(&p, &groups).unwrap();
        let (pins, dt) = (if case % 2 == 0 { 0 } else { pick(4) }, [1.0 / 30.0, 1.0 / 300.0][case / 2 % 2]);
        for _ in 0..pins {
            let i = pick(n as u32) as usize;
            p.pin(i, pick(3) > 0, pick(2) > 0);
        }
        // Collapsed onto a line, a point or a plane in some.
        let squeeze = [Vec3A::ONE, Vec3A::ONE, Vec3A::new(1.0, 0.0, 0.0), Vec3A::ZERO, Vec3A::new(1.0, 1.0, 0.0)][case % 5];
        for i in 0..n {
            p.position[i] *= squeeze;
            if p.inverse_mass[i] > 0.0 {
                p.velocity[i] = random.vector() * 3.0;
            }
            if p.inverse_inertia[i] > 0.0 {
                p.angular_velocity[i] = random.vector() * 20.0;
            }
        }
        // The first substeps close what was apart.
        for _ in 0..5 {
            step(&mut explicit, &mut p, Vec3A::ZERO, dt);
        }
        let before = momentum(&p);
        for _ in 0..200 {
            step(&mut explicit, &mut p, Vec3A::ZERO, dt);
        }
        let after = momentum(&p);
        assert!(p.is_finite(), "case {case}: {groups:?}");
        let more = after.kinetic_energy / before.kinetic_energy - 1.0;
        gain = gain.max(more);
        assert!(more < 0.1, "case {case}: energy +{more}, {} {groups:?}", before.kinetic_energy);
        if pins == 0 {
            let (dp, dl) = (after.linear.distance(before.linear), after.angular.distance(before.angular));
            let scale = (2.0 * before.kinetic_energy * before.mass).sqrt();
            drift = drift.max(dp / scale).max(dl / (0.3 * scale));
            // P to f32. L is the groups', each with its part of a joint; where joints contradict each other and stay open, the sum over particles, which have one place each, sees it differently.
            assert!(dp < 2e-5 * scale && dl < 2e-3 * 0.3 * scale, "case {case}: P {dp}, L {dl} of {scale}, {groups:?}");
        }
    }
    println!("random groups: drift {drift:.1e}, energy {gain:+.1e} at most");
}
