//! Skin weights are a partition of unity that changes smoothly over the skin.

mod common;

use common::{cubes, grid, rig, settings, spacing, two_fingers};
use glam::{IVec3, Vec3};
use polpo_rig::{Influences, Mesh, Rig, build_rig};

fn weight(influences: &Influences, particle: u32) -> f32 {
    let slots = influences.particles.iter().zip(&influences.weights);
    slots.filter(|s| *s.0 == particle).map(|s| s.1).sum()
}

/// Half the sum of all changes of weight between two vertices: 0 for the same weights, 1 for other particles.
fn change(a: &Influences, b: &Influences) -> f32 {
    let mut particles: Vec<u32> = a.particles.iter().chain(&b.particles).copied().collect();
    particles.sort_unstable();
    particles.dedup();
    particles.iter().map(|&p| (weight(a, p) - weight(b, p)).abs()).sum::<f32>() * 0.5
}

#[test]
fn weights_sum_to_one() {
    for particles in [1, 2, 3, 5, 40] {
        let rig = rig(&two_fingers(0.05), particles);
        for (v, influences) in rig.skin.iter().enumerate() {
            let sum: f32 = influences.weights.iter().sum();
            assert!((sum - 1.0).abs() <= 1e-6, "vertex {v}: {sum}");
            assert!(influences.weights.is_sorted_by(|a, b| a >= b), "vertex {v}: heaviest first");
            for slot in 0..4 {
                if influences.weights[slot] == 0.0 {
                    assert_eq!(influences.particles[slot], influences.particles[0], "vertex {v}, slot {slot}");
                }
            }
        }
    }
}

fn steepest(mesh: &Mesh, rig: &Rig) -> (f32, f32) {
    let spacing = spacing(rig);
    let mut steepest = 0.0_f32;
    let mut longest = 0.0_f32;
    for t in &mesh.triangles {
        for (a, b) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
            let length = mesh.positions[a as usize].distance(mesh.positions[b as usize]) / spacing;
            steepest = steepest.max(change(&rig.skin[a as usize], &rig.skin[b as usize]));
            longest = longest.max(length);
        }
    }
    (steepest, longest)
}

#[test]
fn weights_change_smoothly() {
    // A bent slab, its mesh a tenth of the spacing or finer: fine enough for a jump to stand out from a slope.
    let mesh = cubes(&grid(IVec3::ZERO, IVec3::new(12, 4, 3)), 10, |p| {
        let p = p * 0.1;
        Vec3::new(p.x, p.y + 0.4 * p.x * p.x, p.z)
    });
    let rig = build_rig(&mesh, &settings(20)).expect("a slab can be rigged");
    let (steepest, longest) = steepest(&mesh, &rig);
    // From one particle to the next a weight goes from all to nothing, most of it within half the way.
    assert!(longest < 0.25, "the mesh is too coarse to tell: {longest}");
    assert!(steepest < 2.5 * longest, "{steepest} over {longest} of the spacing");
}

#[test]
fn a_vertex_follows_what_it_is_near() {
    let mesh = two_fingers(0.05);
    let rig = rig(&mesh, 40);
    let spacing = spacing(&rig);
    for (p, influences) in mesh.positions.iter().zip(&rig.skin) {
        let middle: Vec3 = (0..4).map(|i| rig.particles[influences.particles[i] as usize].position * influences.weights[i]).sum();
        assert!(middle.distance(*p) < 1.5 * spacing, "{p} follows {middle}");
    }
}
