//! Bodies of facets, swept: substeps, momentum, energy, poses, and what is refused.

use glam::{DVec3, Vec3A};

use crate::facet_bodies::{Body, DENSITY, Solid, Stiff};
use crate::testing::Random;
use crate::{
    CalibratedEdges, Facet, Limb, Material, Particles, RestPose, Section, Sweep, integrate, momentum, predict, quat_exp, quat_log,
    restore_angular_momentum, solve_calibrated_edges, solve_rings,
};

/// The sag in one iteration a substep, with as many as the rule asks for and half of them, against the same cells without a solver.
#[test]
fn the_substeps_of_the_rule_are_enough_for_facets() {
    for (nu, count) in [(0.3, 20), (0.5, 20), (0.3, 60)] {
        let material = Material { youngs_modulus: 1e7, poissons_ratio: nu, density: DENSITY };
        let mut body = Body::new(&Solid::bar(0.2), count, 0);
        let (edges, rings) = body.calibrate(&material, 0.0);
        let still = Stiff::new(&body, &edges, &rings).respond(&|i| [DVec3::Y * (-9.81 * f64::from(body.p.mass[i])), DVec3::ZERO]);
        let enough = edges.recommended_substeps(&body.p, 1.0 / 60.0);
        let [few, right] = [enough / 2, enough].map(|substeps| {
            let mut p = body.p.clone();
            let dt = 1.0 / (60.0 * substeps as f32);
            let (mut above, mut below) = (0.0, 0.0);
            for step in 0..180 * substeps {
                let late = step >= 120 * substeps;
                integrate(&mut p, dt, if late { 0.5 } else { 6.0 });
                predict(&mut p, Vec3A::Y * -9.81, dt);
                solve_calibrated_edges(&edges, &mut p, Sweep::only(dt));
                solve_rings(&rings, &mut p, dt);
                if late {
                    for (i, [still, _]) in still.iter().take(count).enumerate() {
                        above += f64::from(p.position[i].y - p.rest_position[i].y) * still.y;
                        below += still.y * still.y;
                    }
                }
            }
            above / below - 1.0
        });
        let [told_few, told] = [enough / 2, enough].map(|n| edges.softness(&body.p, 1.0 / (60.0 * n as f32)));
        println!(
            "nu {nu}, {count} cells: {enough} substeps {:+.2} %, half {:+.1} %, told {:.0} % and {:.0} %",
            100.0 * right,
            100.0 * few,
            100.0 * told,
            100.0 * told_few
        );
        assert!(told < 0.03 && told_few > 0.1 && told_few < 1.0, "told {told} and, with half of the substeps, {told_few}");
        assert!(right.abs() < 0.03 && few > 0.1 && few < 1.0, "nu {nu}, {count} cells: {right} with {enough} substeps, {few} with half");
    }
}

/// A bar of 0.1 m, ten times as long, that its own weight bends by 5 cm: sag and first frequency with as many substeps as the rule asks for, and about two thirds of them.
#[test]
fn a_slender_bar_takes_two_fifths_of_the_substeps_when_its_stretch_is_capped() {
    let (side, material) = (0.1, Material { youngs_modulus: 2.943e7, poissons_ratio: 0.3, density: DENSITY });
    let limb = Limb { axis: Vec3A::NEG_X, section: Section::square(side) };
    let bending = 12.0 / (material.youngs_modulus * side * side);
    let load = DENSITY * 9.81;
    let sag = |x: f32| load * (bending / 24.0 * x * x * (6.0 - 4.0 * x + x * x) + 1.2 / material.shear_modulus() * (x - 0.5 * x * x));
    let first_mode = (1.5453 * 9.81 / sag(1.0)).sqrt();
    for (count, few, seeds) in [(20, 13, 2), (60, 17, 2), (150, 24, 1)] {
        for seed in 0..seeds {
            let mut body = Body::new(&Solid::bar(side), count, seed);
            let (mut edges, mut rings) = body.calibrate(&material, 0.12);
            let all = edges.recommended_substeps(&body.p, 1.0 / 60.0);
            let share = edges.cap_stretch(&mut rings, &body.p, &material, &limb).unwrap();
            assert!((share / 0.1505 - 1.0).abs() < 1e-3, "2(1 + ν)·I/(A·r²) is 0.1505, and c {share}");
            let enough = edges.recommended_substeps(&body.p, 1.0 / 60.0);
            assert!(enough * 100 < all * 42, "{enough} substeps of {all}");
            let [few_is, enough_is] = [few, enough].map(|substeps| {
                let mut p = body.p.clone();
                let dt = 1.0 / (60.0 * substeps as f32);
                let step = |p: &mut Particles, gravity: f32, drag: f32| {
                    integrate(p, dt, drag);
                    predict(p, Vec3A::Y * -gravity, dt);
                    solve_calibrated_edges(&edges, p, Sweep::only(dt));
                    solve_rings(&rings, p, dt);
                };
                let hung: Vec<f32> = (0..count).map(|i| sag(body.p.rest_position[i].x)).collect();
                // How much of the exact sag, by least squares.
                let shape = |p: &Particles| {
                    let dot = |of: &dyn Fn(usize) -> f32| (0..count).map(|i| of(i) * hung[i]).sum::<f32>();
                    dot(&|i| p.rest_position[i].y - p.position[i].y) / dot(&|i| hung[i])
                };
                for _ in 0..120 * substeps {
                    step(&mut p, 9.81, 6.0);
                }
                let sagged = shape(&p) - 1.0;
                // It swings up and down from there: the time between the first and the last way up through the middle.
                let (mut ups, mut before) = (Vec::new(), 1.0);
                for k in 0..90 * substeps {
                    step(&mut p, 0.0, 0.0);
                    let now = shape(&p);
                    if before > 0.0 && now <= 0.0 {
                        ups.push((k as f32 - now / (now - before)) * dt);
                    }
                    before = now;
                }
                let period = (ups[ups.len() - 1] - ups[0]) / (ups.len() - 1) as f32;
                [sagged, core::f32::consts::TAU / period / first_mode - 1.0]
            });
            let figures = [few_is, enough_is].map(|f| f.map(|e| format!("{:+.1} %", 100.0 * e)).join(", "));
            println!("{count} cells: c {share:.3}; sag, f1 {} with {few} substeps, {} with {enough}, of {all}", figures[0], figures[1]);
            let [[sag, mode], [true_sag, true_mode]] = [few_is, enough_is];
            assert!(sag < 0.12 && mode > -0.08, "{count} cells, {few} substeps: {sag} {mode}");
            assert!(true_sag.abs() < 0.055 && true_mode.abs() < 0.055, "{count} cells, {enough} substeps: {true_sag} {true_mode}");
        }
    }
}

/// Capped or not, a block is no limb: nothing is won, and nothing changes; nor for what cannot be.
#[test]
fn only_limbs_are_capped() {
    let material = Material { youngs_modulus: 1e6, poissons_ratio: 0.3, density: DENSITY };
    let mut body = Body::new(&Solid { size: Vec3A::splat(0.2), unit: 0.2, inside: |_| true }, 20, 0);
    let (mut edges, mut rings) = body.calibrate(&material, 0.0);
    let before = (edges.clone(), rings.clone());
    let section = Section::square(0.2);
    assert_eq!(edges.cap_stretch(&mut rings, &body.p, &material, &Limb { axis: Vec3A::Y, section }), Ok(1.0));
    let mut refused =
        |axis: Vec3A, section: Section| edges.cap_stretch(&mut rings, &body.p, &material, &Limb { axis, section }).unwrap_err().to_string();
    assert_eq!(refused(Vec3A::ZERO, section), "the length of the limb's axis is 0, not positive and normal");
    assert_eq!(refused(Vec3A::NAN, section), "the length of the limb's axis is NaN, not positive and normal");
    assert_eq!(refused(Vec3A::X, Section { area: 0.0, ..section }), "the area is 0, not positive and normal");
    assert_eq!((edges, rings), before);
}

/// Capped as far as bending allows, a noodle of 40 kPa would hang a seventh longer than it is.
#[test]
fn a_soft_limb_keeps_its_stretch() {
    let side = 0.05;
    let caps = [4e7, 2e6, 4e4].map(|youngs_modulus| {
        let material = Material { youngs_modulus, poissons_ratio: 0.3, density: DENSITY };
        let mut body = Body::new(&Solid::bar(side), 20, 0);
        let (mut edges, mut rings) = body.calibrate(&material, 0.12);
        edges.cap_stretch(&mut rings, &body.p, &material, &Limb { axis: Vec3A::X, section: Section::square(side) }).unwrap()
    });
    let of_bending = 2.6 * side * side / 12.0 / (0.12 * 0.12);
    // Particles reach from the middle of the first cell to that of the last.
    assert!((caps[0] / of_bending - 1.0).abs() < 1e-3, "{caps:?}");
    assert!((0.22..0.25).contains(&caps[1]), "half a hundredth of 0.05 or so: {caps:?}");
    assert_eq!(caps[2], 1.0);
}

/// Rods have no facets; a limb of them is capped all the same.
#[test]
fn a_limb_of_rods_is_capped_too() {
    let material = Material { youngs_modulus: 1e8, poissons_ratio: 0.3, density: DENSITY };
    let section = Section::square(0.05);
    let mut body = Body::new(&Solid::bar(0.05), 20, 0);
    let pairs: Vec<[u32; 2]> = body.facets.iter().map(|facet| facet.pair).collect();
    let edges = crate::Edges::new(&body.p, &pairs).unwrap();
    let seam = vec![false; body.p.len()];
    let mut rods = CalibratedEdges::rods(&mut body.p, &edges, &material, &section, Some(0.12), &seam).unwrap();
    let cap = rods.cap_stretch(&mut crate::Rings::default(), &body.p, &material, &Limb { axis: Vec3A::X, section }).unwrap();
    assert!(cap > 0.0 && cap < 1.0, "{cap}");
    assert!(rods.bend_compliance.iter().chain(&rods.stretch_compliance).all(|c| c.is_finite() && c.min_element() > 0.0));
}

/// Bent, twisted and swollen to a rest pose, moved and turned as a whole: nothing pulls there, and it is where the body goes from the shape that it was made in.
#[test]
fn cells_follow_a_rest_pose() {
    let material = Material { youngs_modulus: 1e6, poissons_ratio: 0.3, density: DENSITY };
    let mut body = Body::new(&Solid::bar(0.2), 20, 2).free();
    let (mut edges, mut rings) = body.calibrate(&material, 0.0);
    let made = (edges.clone(), rings.clone());
    let mut pose = RestPose { size: vec![1.2; body.cells], ..RestPose::default() };
    for x in &body.p.rest_position {
        // An arc of 0.8 m about z and a twist about it.
        let arc = quat_exp(Vec3A::Z * (x.x / 0.8));
        pose.rotation.push((arc * quat_exp(Vec3A::X * (0.7 * x.x))).normalize());
        let place = Vec3A::Y * 0.8 + arc * (Vec3A::NEG_Y * 0.8);
        pose.position.push(place + pose.rotation[pose.rotation.len() - 1] * Vec3A::new(0.0, x.y, x.z));
    }
    pose.check(body.cells).unwrap();
    edges.pose(&body.p, &pose);
    rings.pose(&body.p, &pose);
    let turn = quat_exp(Vec3A::new(0.5, -1.2, 0.7));
    let mut p = body.p.clone();
    for i in 0..body.cells {
        p.position[i] = turn * (pose.position[i] * 1.2) + Vec3A::new(1.0, 2.0, -1.0);
        p.rotation[i] = (turn * pose.rotation[i]).normalize();
    }
    let there = p.clone();
    solve_calibrated_edges(&edges, &mut p, Sweep::only(0.01));
    solve_rings(&rings, &mut p, 0.01);
    for i in 0..body.cells {
        assert!(p.position[i].distance(there.position[i]) < 3e-6, "{i}: {}", p.position[i].distance(there.position[i]));
        assert!(quat_log(p.rotation[i] * there.rotation[i].inverse()).length() < 2e-5, "{i}");
    }
    let mut p = body.p.clone();
    let dt = 1.0 / 600.0;
    for _ in 0..1200 {
        integrate(&mut p, dt, 6.0);
        predict(&mut p, Vec3A::ZERO, dt);
        solve_calibrated_edges(&edges, &mut p, Sweep::only(dt));
        solve_rings(&rings, &mut p, dt);
    }
    for i in 0..body.cells {
        for j in 0..i {
            let wanted = 1.2 * pose.position[i].distance(pose.position[j]);
            assert!((p.position[i].distance(p.position[j]) / wanted - 1.0).abs() < 1e-3, "{i} {j}");
        }
    }
    edges.pose(&body.p, &RestPose::default());
    rings.pose(&body.p, &RestPose::default());
    assert_eq!((&edges.frame, &edges.rest_gap, &edges.contact), (&made.0.frame, &made.0.rest_gap, &made.0.contact));
    assert!(edges.rest_turn.is_empty() && rings == made.1);
}

/// Scrambled and thrown, at steps for which it is far too stiff: no drift, no gain.
#[test]
fn a_free_body_of_facets_neither_drifts_nor_gains_energy() {
    for (nu, dt) in [(0.3, 1.0 / 1000.0), (0.3, 1.0 / 60.0), (0.5, 1.0 / 60.0), (0.45, 1.0 / 15.0)] {
        let material = Material { youngs_modulus: 1e6, poissons_ratio: nu, density: DENSITY };
        let mut body = Body::new(&Solid::bar(0.2), 20, 5).free();
        let (edges, rings) = body.calibrate(&material, 0.0);
        let mut p = body.p;
        let mut random = Random(7);
        for i in 0..body.cells {
            p.velocity[i] = random.vector() * 3.0 + Vec3A::X;
            p.angular_velocity[i] = random.vector() * 10.0;
        }
        let before = momentum(&p);
        for _ in 0..(3.0 / dt) as usize {
            predict(&mut p, Vec3A::ZERO, dt);
            let angular = momentum(&p).angular;
            solve_calibrated_edges(&edges, &mut p, Sweep::only(dt));
            solve_rings(&rings, &mut p, dt);
            restore_angular_momentum(&mut p, angular, dt);
            let now = momentum(&p).kinetic_energy;
            assert!(now < before.kinetic_energy, "nu {nu} at {dt} s: {now} of {} J", before.kinetic_energy);
        }
        let (linear, after) = (before.linear, momentum(&p).linear);
        let scale = (2.0 * before.kinetic_energy * before.mass).sqrt();
        assert!(after.distance(linear) < 1e-5 * scale, "nu {nu} at {dt} s: {linear} → {after}");
    }
}

/// One ring at random: its pulls cancel, and so do their moments.
#[test]
fn a_ring_keeps_linear_and_angular_momentum() {
    let material = Material { youngs_modulus: 1e6, poissons_ratio: 0.4, density: DENSITY };
    let mut body = Body::new(&Solid::bar(0.2), 20, 1).free();
    let (_, mut rings) = body.calibrate(&material, 0.0);
    rings.middle.truncate(1);
    let mut random = Random(3);
    for _ in 0..50 {
        let mut p = body.p.clone();
        for x in &mut p.position {
            *x += random.vector() * 0.05;
        }
        let before = p.position.clone();
        solve_rings(&rings, &mut p, 0.01);
        let (mut linear, mut angular, mut scale) = (Vec3A::ZERO, Vec3A::ZERO, 0.0);
        for (i, x) in before.iter().enumerate() {
            let impulse = p.velocity[i] * p.mass[i];
            linear += impulse;
            angular += x.cross(impulse);
            scale += impulse.length();
        }
        assert!(scale > 0.0 && linear.length() < 1e-6 * scale && angular.length() < 1e-6 * scale, "{linear} {angular} of {scale}");
    }
}

#[test]
fn bad_facets_are_named() {
    let mut body = Body::new(&Solid::bar(0.2), 8, 0);
    let material = Material { youngs_modulus: 1e6, poissons_ratio: 0.3, density: DENSITY };
    let Body { p, facets, volumes, .. } = &mut body;
    let mut refuse = |facets: &[Facet], volumes: &[f32], material: &Material| {
        CalibratedEdges::from_facets(p, facets, volumes, material, 0.0).unwrap_err().to_string()
    };
    let with = |change: &dyn Fn(&mut Facet)| {
        let mut list = facets.clone();
        change(&mut list[2]);
        list
    };
    let auxetic = Material { poissons_ratio: -0.2, ..material };
    assert_eq!(refuse(facets, volumes, &auxetic), "Poisson's ratio is -0.2, not 0 or more");
    let count = volumes.len();
    assert_eq!(
        refuse(&with(&|f| f.pair[1] = 900), volumes, &material),
        format!("facet 2: {} and 900 are not two of {count} particles", facets[2].pair[0])
    );
    assert_eq!(refuse(&with(&|f| f.area = -f.area), volumes, &material), "facet 2: it does not face from its first particle to its second");
    assert_eq!(refuse(&with(&|f| f.centroid.z = f32::NAN), volumes, &material), "facet 2: it is not finite");
    assert_eq!(refuse(facets, &volumes[1..], &material), format!("the volume of particle {} of {count} is not 0 or more", count - 1));
    volumes[3] = f32::INFINITY;
    assert_eq!(refuse(facets, volumes, &material), format!("the volume of particle 3 of {count} is not 0 or more"));
}
