//! Edges follow the body: one piece, and none across the air.

mod common;

use common::{pieces, rig, two_fingers};
use glam::Vec3;

/// 1 for the left finger, 2 for the right one, 0 for the palm and the roots that are neighbours over it.
fn finger(p: Vec3, gap: f32) -> u32 {
    match (p.y > 0.45, p.x < 0.5 * gap) {
        (false, _) => 0,
        (true, true) => 1,
        (true, false) => 2,
    }
}

#[test]
fn nothing_leaps_from_finger_to_finger() {
    // The voxels of these bodies are about 0.012 wide; the narrowest gap is a twentieth of one.
    for gap in [0.05, 0.005, 0.0006] {
        let mesh = two_fingers(gap);
        let rig = rig(&mesh, 40);
        assert_eq!((rig.edges.len(), pieces(&rig)), (100, 1));
        let of = |i: u32| finger(rig.particles[i as usize].position, gap);
        for n in [1, 2] {
            assert!((0..40).filter(|&i| of(i) == n).count() >= 8, "finger {n} is hardly sampled");
        }
        for edge in &rig.edges {
            let [a, b] = edge.map(of);
            assert!(
                a == b || a == 0 || b == 0,
                "edge {edge:?} crosses a gap of {gap}: {:?}",
                edge.map(|i| rig.particles[i as usize].position)
            );
        }
        for (v, influences) in rig.skin.iter().enumerate() {
            let p = mesh.positions[v];
            if p.y < 0.7 {
                continue;
            }
            for (&particle, &weight) in influences.particles.iter().zip(&influences.weights) {
                let other = of(particle) == 3 - finger(p, gap);
                assert!(!other || weight == 0.0, "vertex {v} at {p} follows a particle across a gap of {gap}");
            }
        }
    }
}

#[test]
fn edges_are_of_about_one_length() {
    let rig = rig(&common::block([3, 3, 3], 2, Vec3::ONE), 60);
    let lengths = rig.edges.iter().map(|e| {
        let [a, b] = e.map(|i| rig.particles[i as usize].position);
        a.distance(b) / common::spacing(&rig)
    });
    for length in lengths {
        assert!((0.5..1.6).contains(&length), "{length} of the mean");
    }
}
