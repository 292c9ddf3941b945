//! From the rig's mesh to Bevy's.

use std::ops::Range;

use bevy::asset::RenderAssetUsages;
use bevy::mesh::{Indices, PrimitiveTopology};
use bevy::prelude::*;

/// The mesh a rig was made from, as Bevy's renderer takes it: same vertices in the same order, so that the rig fits it. Colours and texture coordinates come along if there are any.
///
/// # Panics
/// For a mesh that [`validate`](polpo_rig::Mesh::validate) refuses.
pub fn bevy_mesh(mesh: &polpo_rig::Mesh) -> Mesh {
    mesh_of_part(mesh, 0..mesh.positions.len() as u32, 0..mesh.triangles.len() as u32)
}

/// The same of some of the vertices and the triangles between them, of a mesh that was validated.
pub(crate) fn mesh_of_part(mesh: &polpo_rig::Mesh, vertices: Range<u32>, triangles: Range<u32>) -> Mesh {
    let (first, vertices) = (vertices.start, vertices.start as usize..vertices.end as usize);
    let triangles = &mesh.triangles[triangles.start as usize..triangles.end as usize];
    let vectors = |values: &[Vec3]| values[vertices.clone()].iter().map(Vec3::to_array).collect::<Vec<_>>();
    let mut out = Mesh::new(PrimitiveTopology::TriangleList, RenderAssetUsages::all())
        .with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, vectors(&mesh.positions))
        .with_inserted_attribute(Mesh::ATTRIBUTE_NORMAL, vectors(&mesh.normals))
        .with_inserted_indices(Indices::U32(triangles.iter().flatten().map(|vertex| vertex - first).collect()));
    if !mesh.colors.is_empty() {
        out.insert_attribute(Mesh::ATTRIBUTE_COLOR, mesh.colors[vertices.clone()].to_vec());
    }
    if !mesh.uvs.is_empty() {
        let uvs: Vec<[f32; 2]> = mesh.uvs[vertices].iter().map(Vec2::to_array).collect();
        out.insert_attribute(Mesh::ATTRIBUTE_UV_0, uvs);
    }
    out
}
