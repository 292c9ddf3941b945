//! The same shape gives the same rig: byte by byte on every run, and in proportion at every scale.

mod common;

use common::{block, rig, two_fingers};
use glam::Vec3;
use polpo_rig::Mesh;

#[test]
fn the_same_mesh_gives_the_same_bytes() {
    let mesh = two_fingers(0.05);
    let (once, again) = (rig(&mesh, 40), rig(&mesh.clone(), 40));
    assert_eq!(once.to_postcard().ok(), again.to_postcard().ok());
    assert_eq!(once.to_ron().ok(), again.to_ron().ok());
}

#[test]
fn a_repainted_mesh_keeps_its_rig() {
    let mesh = two_fingers(0.05);
    let painted = Mesh { colors: vec![[0.5; 4]; mesh.positions.len()], ..mesh.clone() };
    assert_eq!(rig(&mesh, 20), rig(&painted, 20));
}

#[test]
fn scale_changes_lengths_and_nothing_else() {
    let bend = |p: Vec3| Vec3::new(p.x + 0.3 * p.y * p.y, p.y, p.z * (1.0 + 0.2 * p.x));
    let base = block([4, 3, 2], 2, Vec3::new(1.3, 0.9, 0.5));
    let shape = |scale: f32| Mesh { positions: base.positions.iter().map(|&p| bend(p) * scale).collect(), ..base.clone() };
    let one = rig(&shape(1.0), 60);
    for scale in [1e6, 1e-6, 1024.0] {
        let other = rig(&shape(scale), 60);
        assert_eq!(one.edges, other.edges, "at scale {scale}");
        for (i, (a, b)) in one.particles.iter().zip(&other.particles).enumerate() {
            let off = (a.position - b.position / scale).abs().max((a.radii - b.radii / scale).abs());
            assert!(off.max_element() < 1e-4, "particle {i} at scale {scale}: {a:?} {b:?}");
            let mass = f64::from(b.mass) / f64::from(scale).powi(3) / f64::from(a.mass);
            assert!((mass - 1.0).abs() < 1e-3, "particle {i} at scale {scale} has {mass} times the mass");
        }
        for (v, (a, b)) in one.skin.iter().zip(&other.skin).enumerate() {
            let off = a.weights.iter().zip(b.weights).fold(0.0_f32, |off, (a, b)| off.max((a - b).abs()));
            assert!(off < 1e-3, "vertex {v} at scale {scale}: {a:?} {b:?}");
        }
    }
}
