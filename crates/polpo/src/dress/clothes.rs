//! A mesh and a material for each part of a model.
//!
//! With `GltfConvertCoordinates::rotate_meshes` Bevy gives tangents half a turn about Y, which is not undone here: normal maps are shaded wrongly then. Of a mesh that Bevy has loaded into the render world only there is nothing to
//! read: its part goes without tangents and a second set of texture coordinates.

use std::collections::BTreeMap;
use std::sync::Arc;

use bevy::gltf::{Gltf, GltfMaterial, GltfNode};
use bevy::mesh::{PrimitiveTopology, VertexAttributeValues};
use bevy::prelude::*;
use polpo_rig::MeshPart;

use super::source::{Files, Source};
use crate::render::mesh_of_part;

/// The parts of a model, shared by all bodies made of it.
#[derive(Debug)]
pub(super) struct Clothes {
    /// Its address stands for the model.
    pub(super) model: Arc<polpo_rig::Mesh>,
    /// Whether they are of a file that was read for them; see [`Source`].
    pub(super) fresh: bool,
    pub(super) parts: Vec<Cloth>,
}

#[derive(Debug)]
pub(super) struct Cloth {
    pub(super) part: MeshPart,
    pub(super) mesh: Handle<Mesh>,
    pub(super) material: Handle<StandardMaterial>,
}

/// A mesh and a material for each part of the model.
pub(super) fn make(
    model: &polpo_rig::Mesh,
    source: Option<&Source>,
    files: &Files,
    meshes: &mut Assets<Mesh>,
    materials: &mut Assets<StandardMaterial>,
) -> Vec<Cloth> {
    let whole = [MeshPart { vertices: 0..model.positions.len() as u32, triangles: 0..model.triangles.len() as u32, ..default() }];
    let parts = if model.parts.is_empty() { &whole[..] } else { &model.parts };
    let pieces = source.and_then(|source| pieces(&source.gltf, files, meshes)).unwrap_or_default();
    if !pieces.is_empty() && pieces.len() != parts.len() {
        tracing::warn!(
            "{}: Bevy finds {} pieces in it, the rigger {}: it goes without its materials",
            model.name,
            pieces.len(),
            parts.len()
        );
    }
    let fits = pieces.len() == parts.len();
    let mut plain = None;
    let dress = |(index, part): (usize, &MeshPart)| {
        let piece = pieces.get(index).filter(|_| fits);
        let mesh = mesh_like(model, part, piece.and_then(|piece| Some((meshes.get(&piece.mesh)?, piece.turn))));
        let material = piece.and_then(|piece| material(piece, &source?.gltf, files));
        let material = material.unwrap_or_else(|| plain.get_or_insert_with(|| materials.add(StandardMaterial::default())).clone());
        Cloth { part: part.clone(), mesh: meshes.add(mesh), material }
    };
    parts.iter().enumerate().filter(|(_, part)| !part.vertices.is_empty()).map(dress).collect()
}

/// A primitive of a node as Bevy read it.
struct Piece {
    mesh: Handle<Mesh>,
    /// The linear part of its node's transform.
    turn: Mat3,
    material: Option<Handle<GltfMaterial>>,
}

/// The primitives of all nodes that have a surface, in the file's order.
fn pieces(source: &Handle<Gltf>, files: &Files, meshes: &Assets<Mesh>) -> Option<Vec<Piece>> {
    let gltf = files.gltfs.as_ref()?.get(source)?;
    let (all_nodes, all_meshes) = (files.nodes.as_ref()?, files.meshes.as_ref()?);
    let nodes: Vec<&GltfNode> = gltf.nodes.iter().map(|node| all_nodes.get(node)).collect::<Option<_>>()?;
    let indices: BTreeMap<_, usize> = gltf.nodes.iter().map(Handle::id).zip(0..).collect();
    let mut parents = vec![None; nodes.len()];
    for (index, child) in nodes.iter().enumerate().flat_map(|(index, node)| node.children.iter().map(move |child| (index, child))) {
        parents[*indices.get(&child.id())?] = Some(index);
    }
    let linear = |node: usize| {
        let Transform { rotation, scale, .. } = nodes[node].transform;
        Mat3::from_quat(rotation) * Mat3::from_diagonal(scale)
    };
    let mut pieces = Vec::new();
    for (index, node) in nodes.iter().enumerate() {
        let Some(mesh) = node.mesh.as_ref().and_then(|mesh| all_meshes.get(mesh)) else { continue };
        let mut turn = Mat3::IDENTITY;
        // As glTF wants it, the node of a mesh with bones does not count. Bevy has looked for loops.
        let mut above = Some(index).filter(|_| node.skin.is_none());
        while let Some(node) = above {
            turn = linear(node) * turn;
            above = parents[node];
        }
        for primitive in &mesh.primitives {
            let topology = meshes.get(&primitive.mesh).map(Mesh::primitive_topology);
            if matches!(topology, Some(PrimitiveTopology::TriangleList | PrimitiveTopology::TriangleStrip)) {
                pieces.push(Piece { mesh: primitive.mesh.clone(), turn, material: primitive.material.clone() });
            }
        }
    }
    Some(pieces)
}

/// The piece's material, if it is there: the source holds it.
fn material(piece: &Piece, source: &Handle<Gltf>, files: &Files) -> Option<Handle<StandardMaterial>> {
    let path = files.material(source, piece.material.as_ref())?;
    let server = files.server.as_ref()?;
    server.get_handle::<StandardMaterial>(path).filter(|material| !server.load_state(material).is_failed())
}

/// The mesh of a part, with what else the vertices of `like` have; without that if they are not the same ones.
fn mesh_like(model: &polpo_rig::Mesh, part: &MeshPart, like: Option<(&Mesh, Mat3)>) -> Mesh {
    let mut mesh = mesh_of_part(model, part.vertices.clone(), part.triangles.clone());
    // There is nothing to read in one that is in the render world only.
    let Some((attributes, turn)) = like.and_then(|(like, turn)| Some((like.try_attributes().ok()?, turn))) else { return mesh };
    let attributes: Vec<_> = attributes.collect();
    if attributes.is_empty() || attributes.iter().any(|(_, values)| values.len() != part.vertices.len()) {
        return mesh;
    }
    mesh.remove_attribute(Mesh::ATTRIBUTE_COLOR);
    mesh.remove_attribute(Mesh::ATTRIBUTE_UV_0);
    let ours = [Mesh::ATTRIBUTE_POSITION, Mesh::ATTRIBUTE_NORMAL, Mesh::ATTRIBUTE_JOINT_INDEX, Mesh::ATTRIBUTE_JOINT_WEIGHT].map(|a| a.id);
    for (attribute, values) in attributes.into_iter().filter(|(attribute, _)| !ours.contains(&attribute.id)) {
        let values = match values {
            VertexAttributeValues::Float32x4(tangents) if attribute.id == Mesh::ATTRIBUTE_TANGENT.id => {
                VertexAttributeValues::Float32x4(tangents.iter().map(|&tangent| turned(tangent, turn)).collect())
            }
            values => values.clone(),
        };
        mesh.insert_attribute(*attribute, values);
    }
    mesh
}

/// A tangent in the model's axes; one that vanishes there stays as it is.
fn turned([x, y, z, hand]: [f32; 4], turn: Mat3) -> [f32; 4] {
    let tangent = Vec3::new(x, y, z);
    let hand = if turn.determinant() < 0.0 { -hand } else { hand };
    (turn * tangent).normalize_or(tangent).extend(hand).to_array()
}
