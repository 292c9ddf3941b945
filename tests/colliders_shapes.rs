//! Bodies come to rest on every shape that Rapier has, where the surface is, and never get into it on the way.

#[path = "colliders_harness.rs"]
mod harness;

use bevy::prelude::*;
use harness::*;
use polpo_rig::Rig;
use rapier3d::prelude::*;

/// Shapes whose highest point under x = z = 0 is at height 0.
fn shapes() -> Vec<(&'static str, ColliderBuilder)> {
    let at = |builder: ColliderBuilder, y: f32| builder.translation(Vec3::Y * y);
    let corners: Vec<Vec3> = (0..8)
        .map(|i| {
            let sign = |bit: i32| if i & bit == 0 { -1.0 } else { 1.0 };
            Vec3::new(sign(1), 0.3 * sign(2), 0.8 * sign(4))
        })
        .collect();
    let plate = SharedShape::cuboid(0.5, 0.2, 1.0);
    let plates = vec![
        (Pose::from_translation(Vec3::new(-0.4, -0.2, 0.0)), plate.clone()),
        (Pose::from_translation(Vec3::new(0.5, -0.2, 0.1)), plate),
        (Pose::from_translation(Vec3::new(1.5, 0.3, 0.1)), SharedShape::ball(0.4)),
    ];
    let (block, faces) = rapier3d::geometry::Cuboid::new(Vec3::new(1.0, 0.3, 0.8)).to_trimesh();
    let cubes: Vec<IVec3> = (0..49).map(|i| IVec3::new(i % 7 - 3, -1, i / 7 - 3)).collect();
    let upside_down = |builder: ColliderBuilder| builder.rotation(Vec3::X * std::f32::consts::PI);
    vec![
        ("ball", at(ColliderBuilder::ball(0.5), -0.5)),
        ("cuboid", at(ColliderBuilder::cuboid(1.0, 0.3, 1.0), -0.3)),
        ("capsule", at(ColliderBuilder::capsule_z(0.5, 0.3), -0.3)),
        ("cylinder", at(ColliderBuilder::cylinder(0.4, 0.5), -0.4)),
        ("cone", at(upside_down(ColliderBuilder::cone(0.4, 0.6)), -0.4)),
        ("convex hull", at(ColliderBuilder::convex_hull(&corners).unwrap(), -0.3)),
        ("round cuboid", at(ColliderBuilder::round_cuboid(1.0, 0.3, 1.0, 0.1), -0.4)),
        ("round cylinder", at(ColliderBuilder::round_cylinder(0.4, 0.5, 0.1), -0.5)),
        ("round cone", at(upside_down(ColliderBuilder::round_cone(0.4, 0.6, 0.1)), -0.5)),
        ("round convex hull", at(ColliderBuilder::round_convex_hull(&corners, 0.05).unwrap(), -0.35)),
        ("half-space", ColliderBuilder::new(SharedShape::new(rapier3d::geometry::HalfSpace::new(Vec3::Y)))),
        ("triangle", ColliderBuilder::triangle(Vec3::new(-2.0, 0.0, 1.5), Vec3::new(2.0, 0.0, 1.5), Vec3::new(0.0, 0.0, -2.0))),
        (
            "round triangle",
            at(ColliderBuilder::round_triangle(Vec3::new(-2.0, 0.0, 1.5), Vec3::new(2.0, 0.0, 1.5), Vec3::new(0.0, 0.0, -2.0), 0.1), -0.1),
        ),
        ("segment", ColliderBuilder::segment(Vec3::NEG_Z, Vec3::Z)),
        ("polyline", ColliderBuilder::polyline(vec![Vec3::NEG_Z, Vec3::new(0.0, 0.0, -0.1), Vec3::Z], None)),
        ("triangle mesh", flat_mesh(2.0, 16)),
        ("oriented mesh", at(ColliderBuilder::trimesh_with_flags(block, faces, TriMeshFlags::ORIENTED).unwrap(), -0.3)),
        ("height field", ground(4.0, 16, |_, _| 0.0)),
        ("compound", ColliderBuilder::compound(plates)),
        ("voxels", ColliderBuilder::voxels(Vec3::splat(0.3), &cubes)),
    ]
}

fn comes_to_rest(name: &str, collider: ColliderBuilder, rig: Rig, kind: &str) {
    let least = rig.particles[0].radii.min_element();
    let mut lab = Lab::new();
    lab.rapier().insert_fixed(collider);
    let body = lab.spawn(rig, Vec3::Y * 0.5, Vec3::ZERO);
    let mut deepest = 0.0f32;
    for _ in 0..120 {
        lab.step();
        deepest = deepest.max(lab.penetration(body));
    }
    let mut fastest = 0.0f32;
    for _ in 0..60 {
        lab.step();
        deepest = deepest.max(lab.penetration(body));
        fastest = fastest.max(lab.velocity(body, 0).length());
    }
    let off = lab.center(body, 0).y - lab.reach_down(body, 0);
    println!("{name:18} {kind:10} rests {off:+.1e} m from the surface, at most {fastest:.1e} m/s, was at most {deepest:.1e} m deep");
    assert!(off.abs() < 0.01 * least, "{kind} on {name}: rests {off} m from the surface");
    assert!(fastest < 0.01, "{kind} on {name}: still at {fastest} m/s");
    assert!(deepest < 0.01 * least, "{kind} on {name}: was {deepest} m deep");
}

#[test]
fn a_ball_rests_on_every_shape() {
    for (name, collider) in shapes() {
        comes_to_rest(name, collider, ball(), "ball");
    }
}

#[test]
fn a_long_ellipsoid_rests_on_every_shape() {
    for (name, collider) in shapes() {
        comes_to_rest(name, collider, long(), "ellipsoid");
    }
}

/// The same from a place where it does not fall on a symmetry: it must never be inside, wherever it rolls.
#[test]
fn nothing_gets_in_wherever_it_falls() {
    for (name, collider) in shapes() {
        let mut worst = (0, 0.0f32);
        for k in 0..12 {
            let mut lab = Lab::new();
            lab.rapier().insert_fixed(collider.clone());
            let a = k as f32;
            let place =
                Transform::from_xyz(0.37 * libm(a), 0.6, 0.37 * libm(a + 1.9)).with_rotation(Quat::from_xyzw(0.3, a, 0.2, 1.0).normalize());
            let rig = if k % 2 == 0 { long() } else { ball() };
            let least = rig.particles[0].radii.min_element();
            let body = lab.spawn_with(rig, place, Vec3::new(0.3, -1.0, 0.2), ());
            for _ in 0..90 {
                lab.step();
                let depth = lab.penetration(body) / least;
                if depth > worst.1 {
                    worst = (k, depth);
                }
            }
        }
        println!("{name:18} at most {:.1e} of the smallest radius deep, fall {}", worst.1, worst.0);
        assert!(worst.1 < 0.1, "{name}: {} of the smallest radius deep", worst.1);
    }
}

/// Some wave between −1 and 1.
fn libm(a: f32) -> f32 {
    let t = (a * 0.37).fract() * 4.0 - 2.0;
    if t < 0.0 { t + 1.0 } else { 1.0 - t }
}
