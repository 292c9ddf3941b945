//! From the rig's mesh to Bevy's.

use bevy::asset::RenderAssetUsages;
use bevy::mesh::{Indices, PrimitiveTopology};
use bevy::prelude::*;

/// The mesh a rig was made from, as Bevy's renderer takes it: same vertices in the same order, so that the rig fits it. Colours and texture coordinates come along if there are any.
pub fn bevy_mesh(mesh: &polpo_rig::Mesh) -> Mesh {
    let vectors = |values: &[Vec3]| values.iter().map(Vec3::to_array).collect::<Vec<_>>();
    let mut out = Mesh::new(PrimitiveTopology::TriangleList, RenderAssetUsages::all())
        .with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, vectors(&mesh.positions))
        .with_inserted_attribute(Mesh::ATTRIBUTE_NORMAL, vectors(&mesh.normals))
        .with_inserted_indices(Indices::U32(mesh.triangles.iter().flatten().copied().collect()));
    if !mesh.colors.is_empty() {
        out.insert_attribute(Mesh::ATTRIBUTE_COLOR, mesh.colors.clone());
    }
    if !mesh.uvs.is_empty() {
        let uvs: Vec<[f32; 2]> = mesh.uvs.iter().map(Vec2::to_array).collect();
        out.insert_attribute(Mesh::ATTRIBUTE_UV_0, uvs);
    }
    out
}
