//! glTF 2.0 in: nodes, meshes and accessors, read here with every index and range checked. The usual crate panics on some files that
//! are not valid, and brings image decoders that nobody needs for a rig.

use std::path::Path;

use glam::{Mat3, Mat4, Quat, Vec2, Vec3};
use serde::Deserialize;

use crate::gltf_buffers::{Buffers, binary_chunks};
use crate::mesh::smooth_normals;
use crate::read::not_a_mesh;
use crate::{Mesh, MeshError};

/// Extensions a file may require although they mean nothing here, or that are understood.
const HARMLESS: [&str; 4] = ["KHR_materials_", "KHR_texture_", "KHR_lights_", "KHR_mesh_quantization"];

const TRIANGLES: u32 = 4;

/// The parts of a document that hold a mesh; absent lists are empty.
#[derive(Deserialize, Default)]
#[serde(rename_all = "camelCase", default)]
pub(crate) struct Document {
    extensions_required: Vec<String>,
    nodes: Vec<Node>,
    meshes: Vec<Part>,
    pub(crate) accessors: Vec<Accessor>,
    pub(crate) buffer_views: Vec<BufferView>,
    pub(crate) buffers: Vec<BufferSource>,
}

#[derive(Deserialize)]
struct Node {
    #[serde(default)]
    children: Vec<usize>,
    mesh: Option<usize>,
    skin: Option<usize>,
    matrix: Option<[f32; 16]>,
    translation: Option<[f32; 3]>,
    rotation: Option<[f32; 4]>,
    scale: Option<[f32; 3]>,
}

#[derive(Deserialize)]
struct Part {
    primitives: Vec<Primitive>,
}

#[derive(Deserialize)]
struct Primitive {
    attributes: Attributes,
    indices: Option<usize>,
    mode: Option<u32>,
}

#[derive(Deserialize)]
struct Attributes {
    #[serde(rename = "POSITION")]
    position: Option<usize>,
    #[serde(rename = "NORMAL")]
    normal: Option<usize>,
    #[serde(rename = "COLOR_0")]
    color: Option<usize>,
    #[serde(rename = "TEXCOORD_0")]
    uv: Option<usize>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct Accessor {
    pub(crate) buffer_view: Option<usize>,
    #[serde(default)]
    pub(crate) byte_offset: usize,
    pub(crate) component_type: u32,
    #[serde(default)]
    pub(crate) normalized: bool,
    pub(crate) count: usize,
    #[serde(rename = "type")]
    pub(crate) shape: String,
    pub(crate) sparse: Option<serde_json::Value>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct BufferView {
    pub(crate) buffer: usize,
    #[serde(default)]
    pub(crate) byte_offset: usize,
    pub(crate) byte_length: usize,
    pub(crate) byte_stride: Option<usize>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct BufferSource {
    pub(crate) uri: Option<String>,
    pub(crate) byte_length: usize,
}

/// Reads a `.glb` or, if it doesn't start as one, the text of a `.gltf`. `folder` is where buffers in files of their own are.
pub(crate) fn parse(name: &str, bytes: &[u8], folder: Option<&Path>) -> Result<Mesh, MeshError> {
    let fail = |reason: String| not_a_mesh(name, reason);
    let (text, blob) = binary_chunks(bytes).map_err(fail)?;
    let document: Document = serde_json::from_slice(text).map_err(|e| not_a_mesh(name, e))?;
    let foreign = |e: &&String| !HARMLESS.iter().any(|h| e.starts_with(h));
    if let Some(extension) = document.extensions_required.iter().find(foreign) {
        return Err(fail(format!("it requires the extension {extension}")));
    }
    let buffers = Buffers::load(&document, blob, folder).map_err(fail)?;

    let mut mesh = Mesh { name: name.into(), ..Mesh::default() };
    let transforms = world_transforms(&document.nodes).map_err(fail)?;
    for (index, (node, transform)) in document.nodes.iter().zip(transforms).enumerate() {
        let Some(part_index) = node.mesh else { continue };
        let part = document.meshes.get(part_index);
        let part = part.ok_or_else(|| fail(format!("node {index} shows mesh {part_index}, which is not there")))?;
        let transform = if node.skin.is_some() { Mat4::IDENTITY } else { transform };
        for (primitive_index, primitive) in part.primitives.iter().enumerate() {
            let mode = primitive.mode.unwrap_or(TRIANGLES);
            if mode != TRIANGLES {
                return Err(MeshError::UnsupportedMode {
                    name: name.into(),
                    mesh: part_index,
                    primitive: primitive_index,
                    mode: mode_name(mode),
                });
            }
            append(&mut mesh, primitive, &buffers, transform)
                .map_err(|reason| not_a_mesh(name, format_args!("mesh {part_index}, primitive {primitive_index}: {reason}")))?;
        }
    }
    mesh.validate()?;
    Ok(mesh)
}

fn mode_name(mode: u32) -> String {
    let names = ["Points", "Lines", "LineLoop", "LineStrip", "Triangles", "TriangleStrip", "TriangleFan"];
    names.get(mode as usize).map_or_else(|| mode.to_string(), |name| (*name).into())
}

impl Node {
    fn transform(&self) -> Mat4 {
        if let Some(matrix) = self.matrix {
            return Mat4::from_cols_array(&matrix);
        }
        let scale = self.scale.map_or(Vec3::ONE, Vec3::from);
        let rotation = self.rotation.map_or(Quat::IDENTITY, Quat::from_array);
        let translation = self.translation.map_or(Vec3::ZERO, Vec3::from);
        let axes = Mat3::from_quat(rotation) * Mat3::from_diagonal(scale);
        let mut transform = Mat4::from_mat3(axes);
        transform.w_axis = translation.extend(1.0);
        transform
    }
}

/// The transform of every node to the world, in file order.
fn world_transforms(nodes: &[Node]) -> Result<Vec<Mat4>, String> {
    let mut parent = vec![None; nodes.len()];
    for (index, node) in nodes.iter().enumerate() {
        for &child in &node.children {
            let slot = parent.get_mut(child).ok_or(format!("node {index} has child {child}, which is not there"))?;
            if slot.replace(index).is_some() {
                return Err(format!("node {child} has two parents"));
            }
        }
    }
    let world = |node: usize| {
        let mut transform = nodes[node].transform();
        let mut above = parent[node];
        for _ in 0..nodes.len() {
            let Some(p) = above else { return Ok(transform) };
            transform = nodes[p].transform() * transform;
            above = parent[p];
        }
        Err(format!("node {node} is its own ancestor"))
    };
    (0..nodes.len()).map(world).collect()
}

/// Adds one primitive to the mesh.
fn append(mesh: &mut Mesh, primitive: &Primitive, buffers: &Buffers, transform: Mat4) -> Result<(), String> {
    let attributes = &primitive.attributes;
    let read = |accessor: Option<usize>, item: &str| accessor.map(|a| buffers.vectors(a).map_err(|e| format!("{item}: {e}"))).transpose();
    let vec3 = |v: [f32; 4]| Vec3::new(v[0], v[1], v[2]);

    let positions = read(attributes.position, "POSITION")?.ok_or("it has no POSITION")?;
    let vertices = positions.len();
    let mut positions: Vec<Vec3> = positions.into_iter().map(vec3).collect();
    let mut triangles = triangles(primitive, buffers, vertices)?;
    let mut normals = match read(attributes.normal, "NORMAL")? {
        Some(normals) => normals.into_iter().map(vec3).collect(),
        None => smooth_normals(&positions, &triangles),
    };
    let colors = read(attributes.color, "COLOR_0")?;
    let uvs = read(attributes.uv, "TEXCOORD_0")?;
    for (item, found) in [
        ("NORMAL", normals.len()),
        ("COLOR_0", colors.as_ref().map_or(vertices, Vec::len)),
        ("TEXCOORD_0", uvs.as_ref().map_or(vertices, Vec::len)),
    ] {
        if found != vertices {
            return Err(format!("{found} entries in {item}, but {vertices} vertices"));
        }
    }

    // Untouched bits under the identity: the hash of a file's mesh is then the one of the mesh that an engine loads from it.
    if transform != Mat4::IDENTITY {
        let linear = Mat3::from_mat4(transform);
        // The cofactor matrix turns normals under any scale, also a flat or mirroring one.
        let cofactor =
            Mat3::from_cols(linear.y_axis.cross(linear.z_axis), linear.z_axis.cross(linear.x_axis), linear.x_axis.cross(linear.y_axis));
        let mirrored = linear.determinant() < 0.0;
        for p in &mut positions {
            *p = transform.transform_point3(*p);
        }
        for n in &mut normals {
            let turned = cofactor * *n;
            *n = (if mirrored { -turned } else { turned }).normalize_or(Vec3::Y);
        }
        if mirrored {
            triangles.iter_mut().for_each(|t| t.swap(1, 2));
        }
    }

    let before = mesh.positions.len();
    let after = before + vertices;
    if u32::try_from(after).is_err() {
        return Err("more vertices than a 32-bit index reaches".into());
    }
    mesh.triangles.extend(triangles.iter().map(|t| t.map(|v| v + before as u32)));
    mesh.positions.extend(positions);
    mesh.normals.extend(normals);
    if let Some(colors) = colors {
        mesh.colors.resize(before, [1.0; 4]);
        mesh.colors.extend(colors);
    } else if !mesh.colors.is_empty() {
        mesh.colors.resize(after, [1.0; 4]);
    }
    if let Some(uvs) = uvs {
        mesh.uvs.resize(before, Vec2::ZERO);
        mesh.uvs.extend(uvs.iter().map(|v| Vec2::new(v[0], v[1])));
    } else if !mesh.uvs.is_empty() {
        mesh.uvs.resize(after, Vec2::ZERO);
    }
    Ok(())
}

/// A primitive's index triples, or the vertices in threes if it has no indices; none reaches beyond the vertices.
fn triangles(primitive: &Primitive, buffers: &Buffers, vertices: usize) -> Result<Vec<[u32; 3]>, String> {
    let indices = match primitive.indices {
        Some(accessor) => buffers.indices(accessor).map_err(|e| format!("indices: {e}"))?,
        None => (0..u32::try_from(vertices).map_err(|e| e.to_string())?).collect(),
    };
    let (triangles, rest) = indices.as_chunks::<3>();
    if !rest.is_empty() {
        return Err(format!("{} indices don't make triangles", indices.len()));
    }
    if let Some(at) = indices.iter().position(|&v| v as usize >= vertices) {
        return Err(format!("triangle {} points to vertex {}, but there are {vertices}", at / 3, indices[at]));
    }
    Ok(triangles.to_vec())
}
