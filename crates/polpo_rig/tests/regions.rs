//! Regions take what their rules say, no more and no less, and cells end where they do.

mod common;

use std::collections::BTreeSet;

use common::{assemble, block, pieces, settings, truck};
use glam::Vec3;
use polpo_rig::{Built, GroupKind, Mesh, Note, Recipe, RegionRule, Rig, Spring, Within, build_rig, build_rig_with};

fn rule(name: &str) -> RegionRule {
    RegionRule { name: name.into(), ..RegionRule::default() }
}

fn wheels() -> RegionRule {
    RegionRule { node: Some("Wheel*".into()), density: Some(400.0), group: Some(GroupKind::Rigid), ..rule("wheels") }
}

fn built(mesh: &Mesh, particles: usize, regions: Vec<RegionRule>) -> Built {
    let recipe = Recipe { regions, ..settings(particles) };
    build_rig_with(mesh, &recipe, &mut |_| {}).expect("the shape can be rigged")
}

fn mass(rig: &Rig, particles: &[u32]) -> f32 {
    particles.iter().map(|&p| rig.particles[p as usize].mass).sum()
}

#[test]
fn every_wheel_is_a_group_of_its_own() {
    let Built { rig, notes } = built(&truck(), 80, vec![wheels()]);
    assert_eq!(notes, []);
    assert_eq!(rig.particles.len(), 80);
    assert_eq!(pieces(&rig), 1);
    let names: Vec<&str> = rig.regions.iter().map(|r| r.name.as_str()).collect();
    assert_eq!(names, ["wheels", "wheels 2", "wheels 3", "wheels 4"]);
    let mut all = BTreeSet::new();
    // In the order of the file, and each in its own box.
    for (region, place) in rig.regions.iter().zip(common::WHEELS) {
        assert_eq!(region.group, Some(GroupKind::Rigid));
        assert!(region.particles.len() >= 2, "{region:?}");
        for &p in &region.particles {
            let at = rig.particles[p as usize].position - Vec3::from(place);
            assert!(at.cmpge(Vec3::splat(-0.01)).all() && at.cmple(Vec3::new(0.5, 0.5, 0.3) + 0.01).all(), "{}: {at}", region.name);
        }
        let expected = 400.0 * 0.5 * 0.5 * 0.3;
        let got = mass(&rig, &region.particles);
        assert!((got / expected - 1.0).abs() < 0.1, "{}: {got} kg, not {expected}", region.name);
        all.extend(region.particles.iter().copied());
    }
    // And what is in no wheel is the chassis.
    for (p, particle) in (0..).zip(&rig.particles) {
        assert_eq!(all.contains(&p), particle.position.y < 0.5, "{}", particle.position);
    }
    let chassis: Vec<u32> = (0..80).filter(|p| !all.contains(p)).collect();
    assert!((mass(&rig, &chassis) / 1500.0 - 1.0).abs() < 0.05);
}

/// Wheels in the chassis: each keeps what it shares with it, or that is the chassis's, as the last rule says.
#[test]
fn parts_that_overlap_are_told_apart() {
    let deep = common::WHEELS.map(|[x, y, z]| [x, y + 0.2, if z < 0.5 { z + 0.1 } else { z - 0.1 }]);
    let Built { rig, notes } = built(&common::truck_on(deep), 80, vec![wheels()]);
    assert_eq!(notes, []);
    assert_eq!(rig.particles.len(), 80);
    assert_eq!(rig.regions.len(), 4);
    for (region, place) in rig.regions.iter().zip(deep) {
        for &p in &region.particles {
            let at = rig.particles[p as usize].position - Vec3::from(place);
            assert!(at.cmpge(Vec3::ZERO).all() && at.cmple(Vec3::new(0.5, 0.5, 0.3)).all(), "{}: {at}", region.name);
        }
        assert!((mass(&rig, &region.particles) / (400.0 * 0.075) - 1.0).abs() < 0.1);
    }
    let chassis = RegionRule { node: Some("Chassis".into()), ..rule("chassis") };
    let Built { rig, notes } = built(&common::truck_on(deep), 80, vec![wheels(), chassis]);
    assert_eq!((notes.len(), rig.regions.len()), (0, 5));
    for region in rig.regions.iter().filter(|r| r.name != "chassis") {
        assert!(region.particles.iter().all(|&p| rig.particles[p as usize].position.y < 0.5));
        assert!((mass(&rig, &region.particles) / (400.0 * 0.5 * 0.3 * 0.3) - 1.0).abs() < 0.1);
    }
}

/// Specks far smaller than a cell get no particle, or a clumsy brush would cost one a stroke; but a region that is nothing else has one.
#[test]
fn scraps_are_no_regions() {
    let beam = block([1, 1, 1], 1, Vec3::new(2.0, 0.4, 0.4));
    let speck = |x: f32| {
        let within = Within { min: [x, 0.3, 0.1], max: [x + 0.06, 9.0, 0.16] };
        RegionRule { within: Some(within), ..rule("red") }
    };
    let specks: Vec<RegionRule> = [0.1, 0.3, 0.5, 0.7, 0.9].map(speck).into();
    let end = RegionRule { within: Some(Within { min: [1.4, -1.0, -1.0], max: [9.0; 3] }), ..rule("red") };
    let Built { rig, notes } = built(&beam, 4, [&specks[..], &[end]].concat());
    assert_eq!((notes.len(), rig.particles.len()), (0, 4));
    assert!(rig.regions[0].particles.iter().all(|&p| rig.particles[p as usize].position.x > 1.4));
    let Built { rig, notes } = built(&beam, 4, specks);
    assert_eq!((notes.len(), rig.particles.len(), rig.regions[0].particles.len()), (0, 4, 1));
}

/// Twelve triangles, all of which reach from end to end: the box cuts them, and what is inside follows the skin.
#[test]
fn a_box_cuts_triangles_and_cells() {
    let beam = block([1, 1, 1], 1, Vec3::new(2.0, 0.4, 0.4));
    let within = Within { min: [0.7, -1.0, -1.0], max: [9.0; 3] };
    let soft = Spring { hertz: 4.0, damping_ratio: 0.1 };
    let Built { rig, notes } = built(&beam, 40, vec![RegionRule { within: Some(within), stiffness: Some(soft), ..rule("tail") }]);
    assert_eq!((notes.len(), rig.regions.len(), rig.particles.len()), (0, 1, 40));
    let tail = &rig.regions[0];
    assert_eq!((tail.stiffness, tail.group), (Some(soft), None));
    for (p, particle) in (0..).zip(&rig.particles) {
        assert_eq!(tail.particles.contains(&p), particle.position.x > 0.7, "{}", particle.position);
    }
    // A cell that straddled would weigh on one side: a tenth and more.
    let share = mass(&rig, &tail.particles) / mass(&rig, &(0..40).collect::<Vec<_>>());
    assert!((share - 1.3 / 2.0).abs() < 0.01, "{share}");
}

#[test]
fn names_materials_and_colours_choose() {
    let cube = || block([1, 1, 1], 2, Vec3::ONE);
    let place = |x: f32| move |p: Vec3| p + Vec3::X * x;
    let mut mesh = assemble(&[
        ("Body", "Cube", "skin", cube(), &place(0.0)),
        ("Hat", "Cube", "felt", cube(), &place(1.0)),
        ("Hat", "Brim", "skin", cube(), &place(2.0)),
    ]);
    let third = mesh.positions.len() / 3;
    mesh.colors = (0..3 * third).map(|v| if v < third { [0.95, 0.05, 0.0, 1.0] } else { [0.0, 0.0, 0.8, 1.0] }).collect();
    let cases: [(RegionRule, &[usize]); 7] = [
        (RegionRule { node: Some("H*t".into()), ..rule("r") }, &[1, 2]),
        (RegionRule { part: Some("Cube".into()), ..rule("r") }, &[0, 1]),
        (RegionRule { material: Some("*kin".into()), ..rule("r") }, &[0, 2]),
        (RegionRule { material: Some("skin".into()), node: Some("Hat".into()), ..rule("r") }, &[2]),
        (RegionRule { color: Some([1.0, 0.0, 0.0]), ..rule("r") }, &[0]),
        (RegionRule { color: Some([0.0, 0.0, 0.8]), part: Some("Cube".into()), ..rule("r") }, &[1]),
        (rule("r"), &[0, 1, 2]),
    ];
    for (rule, cubes) in cases {
        let Built { rig, notes } = built(&mesh, 12, vec![rule.clone()]);
        assert_eq!(notes, []);
        for (p, particle) in (0..).zip(&rig.particles) {
            let cube = particle.position.x as usize;
            assert_eq!(rig.regions[0].particles.contains(&p), cubes.contains(&cube), "{rule:?}: {}", particle.position);
        }
    }
}

#[test]
fn the_last_rule_counts_and_same_names_are_one() {
    let mesh = truck();
    let first = RegionRule { node: Some("Wheel 1".into()), friction: Some(0.9), ..rule("tyre") };
    let second = RegionRule { node: Some("Wheel 3".into()), density: Some(2000.0), ..rule("tyre") };
    let Built { rig, notes } = built(&mesh, 60, vec![RegionRule { density: Some(50.0), ..rule("all") }, first, second]);
    assert_eq!(notes, []);
    assert_eq!(rig.regions.iter().map(|r| r.name.as_str()).collect::<Vec<_>>(), ["all", "tyre"]);
    let tyre = &rig.regions[1];
    assert_eq!((tyre.friction, tyre.group), (Some(0.9), None));
    // Both wheels take the friction of one rule and the density of the other; all else is as light as cork.
    assert!((mass(&rig, &tyre.particles) / (2.0 * 2000.0 * 0.075) - 1.0).abs() < 0.1);
    assert!((mass(&rig, &rig.regions[0].particles) / (50.0 * (1.5 + 2.0 * 0.075)) - 1.0).abs() < 0.1);
}

#[test]
fn a_rule_that_takes_nothing_is_told() {
    let mesh = truck();
    let nowhere = RegionRule { node: Some("Propeller".into()), ..rule("propeller") };
    // One name, two rules, one of them mistyped; and one that another overrides wholly.
    let mistyped = RegionRule { node: Some("wheel*".into()), ..wheels() };
    let overridden = RegionRule { node: Some("Wheel*".into()), ..rule("under") };
    let Built { rig, notes } = built(&mesh, 40, vec![overridden, nowhere, wheels(), mistyped]);
    let told: Vec<Note> = ["under", "propeller", "wheels"].map(|name| Note::EmptyRegion { name: name.into() }).into();
    assert_eq!(notes, told);
    assert_eq!(rig.regions.len(), 4);
    // Nor has a mesh without parts or colours what is asked for by name or colour.
    let plain = block([1, 1, 1], 1, Vec3::ONE);
    let red = RegionRule { color: Some([1.0, 1.0, 1.0]), ..rule("red") };
    let Built { rig, notes } = built(&plain, 5, vec![wheels(), red]);
    assert_eq!((rig.regions.len(), notes.len()), (0, 2));
}

/// What a region says of the whole body is as if the body itself said it, bit for bit.
#[test]
fn a_region_of_everything_changes_only_what_it_says() {
    let mesh = truck();
    let plain = build_rig(&mesh, &settings(50)).expect("a rig");
    let Built { rig, .. } = built(&mesh, 50, vec![RegionRule { density: Some(2000.0), ..rule("all") }]);
    assert_eq!(rig.regions[0].particles, (0..50).collect::<Vec<_>>());
    assert_eq!((&rig.edges, &rig.skin), (&plain.edges, &plain.skin));
    for (ours, plain) in rig.particles.iter().zip(&plain.particles) {
        assert_eq!((ours.position, ours.radii, ours.mass), (plain.position, plain.radii, 2.0 * plain.mass));
    }
    assert_eq!(built(&mesh, 50, vec![wheels()]), built(&mesh, 50, vec![wheels()]));
}
