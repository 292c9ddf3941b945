//! The rig: its ellipsoids, its edges, and a colour for every particle.

use glam::Vec3;
use polpo_rig::Rig;

use super::model::{Ellipsoid, Model};
use super::pose::Pose;

/// sRGB of the colours that particles have.
const COLOURS: [u32; 11] =
    [0xe4_572e, 0x2e_86ab, 0xf2_c14e, 0x5f_a55a, 0x8e_5ea2, 0xf7_8154, 0x3c_bbb1, 0xd1_4f7c, 0x4d_6cc1, 0xa3_c14a, 0xb0_7d4f];
const BAR: Vec3 = Vec3::new(0.10, 0.11, 0.13);

/// A colour for every particle, linear RGB: that of which there is least among those that it is tied to, and those that these are tied to.
pub(crate) fn palette(rig: &Rig) -> Vec<Vec3> {
    let mut tied = vec![Vec::new(); rig.particles.len()];
    for &[a, b] in &rig.edges {
        tied[a as usize].push(b as usize);
        tied[b as usize].push(a as usize);
    }
    let mut chosen: Vec<Option<usize>> = vec![None; rig.particles.len()];
    for particle in 0..chosen.len() {
        let mut near = [0u32; COLOURS.len()];
        let mut count = |other: usize, weight: u32| {
            if let Some(colour) = chosen[other] {
                near[colour] += weight;
            }
        };
        for &next in &tied[particle] {
            count(next, 100);
            tied[next].iter().for_each(|&far| count(far, 1));
        }
        // Of several, those take turns.
        let turn = |k: usize| (k + COLOURS.len() - particle * 4 % COLOURS.len()) % COLOURS.len();
        chosen[particle] = (0..COLOURS.len()).min_by_key(|&k| (near[k], turn(k)));
    }
    let linear = |byte: u32| (((byte & 255) as f32 / 255.0 + 0.055) / 1.055).powf(2.4);
    chosen.into_iter().map(|k| COLOURS[k.unwrap_or(0)]).map(|c| Vec3::new(linear(c >> 16), linear(c >> 8), linear(c))).collect()
}

/// The particles as large as they are.
pub(crate) fn ellipsoids(rig: &Rig, pose: &Pose, palette: &[Vec3]) -> Model {
    let posed = rig.particles.iter().zip(&pose.positions).zip(&pose.rotations).zip(palette);
    let ellipsoids = posed.map(|(((p, &centre), &rotation), &colour)| Ellipsoid {
        centre,
        frame: rotation * p.frame,
        radii: p.radii * pose.scale,
        colour,
    });
    Model { ellipsoids: ellipsoids.collect(), ..Model::default() }
}

/// The particles' centres, and bars for the edges between them.
pub(crate) fn skeleton(rig: &Rig, pose: &Pose, palette: &[Vec3]) -> Model {
    let mut lengths: Vec<f32> = rig.edges.iter().map(|e| pose.positions[e[0] as usize].distance(pose.positions[e[1] as usize])).collect();
    lengths.sort_by(f32::total_cmp);
    let mean = |p: &polpo_rig::Particle| p.radii.element_sum() / 3.0 * pose.scale;
    let length = lengths.get(lengths.len() / 2).copied().or_else(|| rig.particles.first().map(mean)).unwrap_or(1.0);
    let mut model = ellipsoids(rig, pose, palette);
    for ellipsoid in &mut model.ellipsoids {
        ellipsoid.radii = Vec3::splat(0.17 * length);
    }
    for edge in &rig.edges {
        model.add_bar(edge.map(|p| pose.positions[p as usize]), 0.045 * length, BAR);
    }
    model
}
