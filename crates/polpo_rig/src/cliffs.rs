//! Cliffs: where weights change too fast between two neighbours on the skin, they are mixed along it until they don't.
//!
//! The blur of the voxels' shares leaves few. Where parts overlap, or a fold is narrower than a voxel, two neighbours can lie over voxels
//! that the body links by a long way round only. On an edge of the skin of length ℓ, between cells of width h, weights may change by
//! [`STEEPEST`]·ℓ/h; where they change by c, which is more, both ends come to meet each other:
//!
//! ```text
//! w_a ← w_a + ½·(1 − STEEPEST·ℓ/(h·c))·(w_b − w_a)
//! ```
//!
//! the mean over all such edges of a vertex, all vertices at once, round by round. What is no cliff stays as it is, and nothing goes
//! through the air.

use crate::clean::Surface;
use crate::shell::{Mixer, Shares};

/// The steepest that the skin may be: from one particle wholly to another within a third of a cell. Linear B-splines in a row have 1.
const STEEPEST: f64 = 3.0;
/// Edges shorter than this share of a cell count as that long.
const SHORTEST: f64 = 0.05;
/// More rounds than this would go further than a cell.
const ROUNDS: usize = 200;

/// Levels the cliffs of the welded vertices' shares; `widths` are those of the particles' cells, in the unit box.
pub(crate) fn level(surface: &Surface, widths: &[f64], skin: &mut [Shares], mixer: &mut Mixer) {
    let mut edges: Vec<[u32; 2]> = surface.triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]).collect();
    edges.iter_mut().for_each(|edge| edge.sort_unstable());
    edges.sort_unstable();
    edges.dedup();
    let width = |shares: &Shares| shares.iter().next().map_or(1.0, |(heaviest, _)| widths[heaviest as usize]);
    let mut moved = vec![true; skin.len()];
    for _ in 0..ROUNDS {
        let mut pulls: Vec<(u32, u32, f32)> = Vec::new();
        for &[a, b] in edges.iter().filter(|edge| edge.iter().any(|&v| moved[v as usize])) {
            let [one, other] = [a, b].map(|v| &skin[v as usize]);
            let change = f64::from(one.change(other));
            if change <= STEEPEST * SHORTEST {
                continue;
            }
            let length = surface.positions[a as usize].distance(surface.positions[b as usize]) / width(one).max(width(other));
            let allowed = STEEPEST * length.max(SHORTEST);
            // What is nearly level would be worked on for ever.
            if change > 1.01 * allowed {
                let pull = (0.5 * (1.0 - allowed / change)) as f32;
                pulls.extend([(a, b, pull), (b, a, pull)]);
            }
        }
        if pulls.is_empty() {
            return;
        }
        moved.fill(false);
        pulls.sort_unstable_by_key(|pull| (pull.0, pull.1));
        let mixed: Vec<(u32, Shares)> = pulls
            .chunk_by(|one, other| one.0 == other.0)
            .map(|pulls| {
                let (vertex, each) = (pulls[0].0, 1.0 / pulls.len() as f32);
                mixer.add(&skin[vertex as usize], 1.0 - each * pulls.iter().map(|pull| pull.2).sum::<f32>());
                pulls.iter().for_each(|&(_, other, pull)| mixer.add(&skin[other as usize], each * pull));
                (vertex, mixer.keep())
            })
            .collect();
        for (vertex, shares) in mixed {
            moved[vertex as usize] = true;
            skin[vertex as usize] = shares;
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::Mesh;

    /// A strip of so many squares, 0.02 of a cell wide each, whose left half follows one particle and whose right half another.
    fn leveled(squares: u32) -> (Vec<Shares>, Vec<Shares>) {
        let at = |i: u32| Vec3::new((i / 2) as f32, (i % 2) as f32, 0.0);
        let mesh = Mesh {
            positions: (0..2 * squares + 2).map(at).collect(),
            normals: vec![Vec3::Z; 2 * squares as usize + 2],
            triangles: (0..squares).flat_map(|s| [[2 * s, 2 * s + 2, 2 * s + 1], [2 * s + 1, 2 * s + 2, 2 * s + 3]]).collect(),
            ..Mesh::default()
        };
        let surface = Surface::new(&mesh).expect("a mesh");
        let cliff: Vec<Shares> = (0..2 * squares + 2).map(|v| Shares::whole(u32::from(v > squares))).collect();
        let mut skin = cliff.clone();
        // The surface is as long as 1.
        level(&surface, &[50.0 / f64::from(squares); 2], &mut skin, &mut Mixer::new(2, 4));
        (cliff, skin)
    }

    #[test]
    fn a_jump_becomes_a_slope() {
        let (cliff, skin) = leveled(60);
        let change = |skin: &[Shares], v: usize| skin[v].change(&skin[v + 2]);
        let steepest = |skin: &[Shares]| (0..skin.len() - 2).map(|v| change(skin, v)).fold(0.0, f32::max);
        assert_eq!(steepest(&cliff), 1.0);
        // Of a cell 0.05 at least, and a hundredth is let be.
        assert!(steepest(&skin) < 1.02 * 0.15, "{}", steepest(&skin));
        for shares in &skin {
            assert!((shares.iter().map(|s| s.1).sum::<f32>() - 1.0).abs() < 1e-5);
        }
        // The slope is a third of a cell long, and some more for its ends.
        let touched = (0..skin.len()).filter(|&v| skin[v].change(&cliff[v]) > 0.0).count();
        assert!((2 * 6..2 * 30).contains(&touched), "{touched}");
        assert_eq!(skin[0].change(&cliff[0]), 0.0);
    }
}
