//! The mesh: as it is, as glass, or by the particles its vertices follow.

use glam::Vec3;
use polpo_rig::{Influences, Mesh};

use super::model::{Corner, Model};

/// Of a mesh without colours of its own, linear RGB.
const CLAY: Vec3 = Vec3::new(0.70, 0.25, 0.11);
const GLASS: Vec3 = Vec3::new(0.30, 0.45, 0.62);

/// The mesh in its own colours.
pub(crate) fn surface(mesh: &Mesh) -> Model {
    coloured(mesh, |vertex| mesh.colors.get(vertex).map_or(CLAY, |c| Vec3::new(c[0], c[1], c[2]).clamp(Vec3::ZERO, Vec3::ONE)))
}

/// The mesh to look through.
pub(crate) fn glass(mesh: &Mesh) -> Model {
    coloured(mesh, |_| GLASS)
}

/// Every vertex in the colours of the particles that it follows, mixed by their weights.
pub(crate) fn weights(mesh: &Mesh, skin: &[Influences], palette: &[Vec3]) -> Model {
    coloured(mesh, |vertex| {
        let used = skin.get(vertex).into_iter().flat_map(|i| i.used());
        used.map(|(particle, weight)| palette.get(particle as usize).copied().unwrap_or_default() * weight).sum()
    })
}

fn coloured(mesh: &Mesh, colour: impl Fn(usize) -> Vec3) -> Model {
    let corners = mesh.positions.iter().zip(&mesh.normals).enumerate();
    Model {
        corners: corners.map(|(v, (&position, &normal))| Corner { position, normal, colour: colour(v) }).collect(),
        triangles: mesh.triangles.clone(),
        ellipsoids: Vec::new(),
    }
}
