//! Coverage is what it says, for spheres whose share and overhang are known.

mod common;

use common::{block, cubes, grid, moved};
use glam::{IVec3, Quat, Vec3};
use polpo_rig::{Mesh, Particle, Rig, coverage};

fn rig(particles: &[(Vec3, Vec3)]) -> Rig {
    let particle = |&(position, radii)| Particle { position, radii, frame: Quat::IDENTITY, mass: 1.0 };
    Rig { particles: particles.iter().map(particle).collect(), ..Rig::default() }
}

/// A ball of radius 2 around a place.
fn ball(at: Vec3) -> Mesh {
    cubes(&grid(IVec3::ZERO, IVec3::splat(2)), 12, |p| (p - 1.0).normalize() * 2.0 + at)
}

#[test]
fn a_sphere_in_a_ball_leaves_bare_or_sticks_out_what_it_is_too_small_or_large() {
    let at = Vec3::new(30.0, -7.0, 2.0);
    for (radius, covered, bare, overhang) in [(1.0, 0.0, 1.0, 0.0), (1.95, 1.0, 0.05, 0.0), (2.2, 1.0, 0.0, 0.2)] {
        let found = coverage(&ball(at), &rig(&[(at, Vec3::splat(radius))]));
        assert_eq!(found.covered, covered, "radius {radius}");
        assert!((found.bare - bare).abs() < 0.015 && (found.overhang - overhang).abs() < 0.015, "radius {radius}: {found:?}");
    }
}

#[test]
fn half_a_body_is_half_covered() {
    let bar = block([8, 1, 1], 2, Vec3::new(8.0, 1.0, 1.0));
    let beads: Vec<(Vec3, Vec3)> = (0..40).map(|i| (Vec3::new(0.05 + 0.1 * i as f32, 0.5, 0.5), Vec3::splat(0.75))).collect();
    let found = coverage(&bar, &rig(&beads));
    // With u the way from the last centre along the bar, the skin is √(u² + 1/3) − 0.75 away on average around it: 0.16 at u = 0.7.
    assert!((found.covered - (4.0 * 4.65 + 1.0) / 34.0).abs() < 0.02, "{found:?}");
    // Integrated from u = 0.5 to 4.05 and over the far end.
    assert!((found.bare - 0.776).abs() < 0.03, "{found:?}");
}

#[test]
fn where_parts_overlap_nothing_sticks_out() {
    // A small box half in a large one: an ellipsoid in the large one is inside, though it is outside the small one.
    let both = common::both(block([1, 1, 1], 2, Vec3::ONE), moved(block([1, 1, 1], 2, Vec3::splat(0.4)), Vec3::new(0.8, 0.3, 0.3)));
    let found = coverage(&both, &rig(&[(Vec3::splat(0.5), Vec3::splat(0.45))]));
    assert!(found.overhang < 0.002, "{found:?}");
}

#[test]
fn what_has_nothing_to_cover_is_zero() {
    let found = coverage(&Mesh::default(), &rig(&[(Vec3::ZERO, Vec3::ONE)]));
    assert_eq!((found.covered, found.bare, found.overhang), (0.0, 0.0, 0.0));
    let found = coverage(&block([1, 1, 1], 1, Vec3::ONE), &Rig::default());
    assert_eq!((found.covered, found.overhang), (0.0, 0.0));
}
