//! Skin weights: how much each vertex follows the particles around it.
//!
//! A vertex takes the shares of the voxels right under it ([`Shell`]) by quadratic B-splines of its place among them, and only of those
//! that the body links with the one it lies in: nothing bleeds from one limb to the next, and how finely the mesh is divided does not
//! matter. What cliffs are left are levelled (`cliffs`).

use glam::DVec3;

use crate::Influences;
use crate::clean::Surface;
use crate::cliffs;
use crate::sample::Sample;
use crate::shell::{Mixer, Shares, Shell};
use crate::voxels::Voxels;

/// The influences of every vertex of the mesh (welded vertices share theirs), `most` at most.
pub(crate) fn weigh(surface: &Surface, voxels: &Voxels, sample: &Sample, most: usize) -> Vec<Influences> {
    let normals = mitres(surface);
    let shell = Shell::new(surface, voxels, sample, &normals, most);
    let mut mixer = Mixer::new(sample.positions.len(), most);
    let mut skin: Vec<Shares> = Vec::with_capacity(surface.positions.len());
    for (&position, &normal) in surface.positions.iter().zip(&normals) {
        let voxel = voxels.under(position, normal);
        let below = position - normal * (0.5 * voxels.size);
        let centre = voxels.centre(voxel);
        // Where the point is in no voxel, the nearest place in the one that stands for it.
        let point = ((below - centre) / voxels.size).clamp(DVec3::splat(-0.5), DVec3::splat(0.5));
        let mut add = |near: u32, shares| {
            let away = (voxels.centre(near) - centre) / voxels.size - point;
            mixer.add(shares, (spline(away.x) * spline(away.y) * spline(away.z)) as f32);
        };
        if let Some(own) = shell.at(voxel) {
            add(voxel, own);
        }
        shell.around(voxels, voxel).for_each(|(near, shares, _)| add(near, shares));
        skin.push(mixer.keep());
    }
    cliffs::level(surface, &shell.widths, &mut skin, &mut mixer);
    let influences = |shares: &Shares| {
        let kept: Vec<(u32, f64)> = shares.iter().map(|(particle, share)| (particle, share.into())).collect();
        Influences::new(&kept)
    };
    let skin: Vec<Influences> = skin.iter().map(influences).collect();
    surface.welded.iter().map(|&v| skin[v as usize]).collect()
}

/// The quadratic B-spline: a box of width 1, blurred twice by itself.
fn spline(x: f64) -> f64 {
    let x = x.abs();
    if x < 0.5 { 0.75 - x * x } else { 0.5 * (1.5 - x).max(0.0) * (1.5 - x).max(0.0) }
}

/// The outward direction at every vertex, longer at a corner: a step against it goes as deep below each of the vertex's triangles as a
/// step against their own normals. At most three times as long, for where a fold has no such depth.
fn mitres(surface: &Surface) -> Vec<DVec3> {
    let faces = surface.normals();
    let mut normals = vec![DVec3::ZERO; surface.positions.len()];
    for (t, face) in faces.iter().enumerate() {
        let [a, b, c] = surface.corners(t);
        for v in surface.triangles[t] {
            normals[v as usize] += face * (b - a).cross(c - a).length();
        }
    }
    let mut slant = vec![1.0_f64; normals.len()];
    normals.iter_mut().for_each(|n| *n = n.normalize_or_zero());
    for (triangle, face) in surface.triangles.iter().zip(&faces) {
        for &v in triangle {
            slant[v as usize] = slant[v as usize].min(normals[v as usize].dot(*face));
        }
    }
    normals.iter().zip(slant).map(|(normal, slant)| *normal / slant.max(1.0 / 3.0)).collect()
}
