//! glTF 2.0 in: nodes, meshes and accessors, read here with every index and range checked. The usual crate panics on some files that
//! are not valid, and brings image decoders that nobody needs for a rig.

use std::path::Path;

use glam::{DMat3, DMat4, Vec2, Vec3};

use crate::budget::Budget;
use crate::gltf_accessors::Accessors;
use crate::gltf_buffers::{Buffers, binary_chunks};
use crate::gltf_document::{Document, Primitive};
use crate::mesh::{smooth_normals, unit, unit_normal};
use crate::polygons::strip;
use crate::read::not_a_mesh;
use crate::{Mesh, MeshError, MeshPart};

/// Extensions a file may require although they mean nothing here, or that are understood.
const HARMLESS: [&str; 4] = ["KHR_materials_", "KHR_texture_", "KHR_lights_", "KHR_mesh_quantization"];

const MODES: [&str; 7] = ["Points", "Lines", "LineLoop", "LineStrip", "Triangles", "TriangleStrip", "TriangleFan"];
const TRIANGLES: u32 = 4;
const STRIP: u32 = 5;
const FAN: u32 = 6;

/// Position, normal, colour and texture coordinates.
const VERTEX_BYTES: usize = 12 + 12 + 16 + 8;
const TRIANGLE_BYTES: usize = 12;

/// Reads a `.glb` or, if it doesn't start as one, the text of a `.gltf`. `folder` is where buffers in files of their own are.
pub(crate) fn parse(name: &str, bytes: &[u8], folder: Option<&Path>) -> Result<Mesh, MeshError> {
    let fail = |reason: String| not_a_mesh(name, reason);
    let (text, blob) = binary_chunks(bytes).map_err(fail)?;
    let document: Document = serde_json::from_slice(text).map_err(|e| not_a_mesh(name, e))?;
    let foreign = |e: &&std::borrow::Cow<str>| !HARMLESS.iter().any(|h| e.starts_with(h));
    if let Some(extension) = document.extensions_required.iter().find(foreign) {
        return Err(fail(format!("it requires the extension {extension}")));
    }
    let buffers = Buffers::load(&document.buffers, blob, folder).map_err(fail)?;
    let transforms = document.world_transforms().map_err(fail)?;
    let accessors = Accessors { document: &document, buffers: &buffers };

    let mut mesh = Mesh { name: name.into(), ..Mesh::default() };
    let mut budget = Budget::of(bytes.len() + buffers.outside());
    let mut skipped = None;
    for (index, (node, transform)) in document.nodes.iter().zip(transforms).enumerate() {
        let Some(shape_index) = node.mesh else { continue };
        let shape = document.meshes.get(shape_index);
        let shape = shape.ok_or_else(|| fail(format!("node {index} shows mesh {shape_index}, which is not there")))?;
        let transform = if node.skin.is_some() { DMat4::IDENTITY } else { transform };
        for (primitive_index, primitive) in shape.primitives.iter().enumerate() {
            let mode = primitive.mode.unwrap_or(TRIANGLES);
            if mode < TRIANGLES {
                skipped = skipped.or(Some((shape_index, primitive_index, mode)));
                continue;
            }
            let at = |reason| not_a_mesh(name, format_args!("mesh {shape_index}, primitive {primitive_index}: {reason}"));
            let material = document.material(primitive.material).map_err(at)?;
            budget.spend(size_of::<MeshPart>() + node.name().len() + shape.name().len() + material.len(), 1).map_err(at)?;
            append(&mut mesh, primitive, &accessors, transform, &mut budget).map_err(at)?;
            mesh.end_part(mesh.positions.len(), node.name(), shape.name(), material);
        }
    }
    if let Some((mesh_index, primitive, mode)) = skipped.filter(|_| mesh.triangles.is_empty()) {
        let mode = MODES.get(mode as usize).copied().unwrap_or_default();
        return Err(MeshError::NoSurface { name: name.into(), mesh: mesh_index, primitive, mode });
    }
    mesh.validate()?;
    Ok(mesh)
}

/// Adds one primitive to the mesh.
fn append(mesh: &mut Mesh, primitive: &Primitive, accessors: &Accessors, transform: DMat4, budget: &mut Budget) -> Result<(), String> {
    let attributes = &primitive.attributes;
    let position = attributes.position.ok_or("it has no POSITION")?;
    let vertices = accessors.count(position).map_err(|e| format!("POSITION: {e}"))?;
    budget.spend(vertices, VERTEX_BYTES).map_err(|e| format!("POSITION: {vertices} vertices, and {e}"))?;
    for (item, accessor) in [("NORMAL", attributes.normal), ("COLOR_0", attributes.color), ("TEXCOORD_0", attributes.uv)] {
        let found = accessor.map_or(Ok(vertices), |a| accessors.count(a)).map_err(|e| format!("{item}: {e}"))?;
        if found != vertices {
            return Err(format!("{found} entries in {item}, but {vertices} vertices"));
        }
    }

    let mut positions: Vec<Vec3> = vectors(accessors, position, 3, "POSITION")?;
    let mut triangles = triangles(primitive, accessors, vertices, budget)?;
    let mut normals: Vec<Vec3> = match attributes.normal {
        Some(normal) => vectors(accessors, normal, 3, "NORMAL")?,
        None => smooth_normals(&positions, &triangles),
    };
    // Integers make unit vectors only nearly.
    normals.iter_mut().for_each(|n| *n = unit_normal(*n));

    // Untouched bits under the identity: the hash of a file's mesh is then the one of the mesh that an engine loads from it.
    if transform != DMat4::IDENTITY {
        let linear = DMat3::from_mat4(transform);
        // The cofactor matrix turns normals under any scale, also a flat or mirroring one.
        let cofactor =
            DMat3::from_cols(linear.y_axis.cross(linear.z_axis), linear.z_axis.cross(linear.x_axis), linear.x_axis.cross(linear.y_axis));
        let mirrored = linear.determinant() < 0.0;
        for p in &mut positions {
            *p = transform.transform_point3(p.as_dvec3()).as_vec3();
        }
        for n in &mut normals {
            let turned = cofactor * n.as_dvec3();
            *n = unit(if mirrored { -turned } else { turned }).as_vec3();
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
    mesh.positions.append(&mut positions);
    mesh.normals.append(&mut normals);
    if let Some(color) = attributes.color {
        mesh.colors.resize(before, [1.0; 4]);
        mesh.colors.append(&mut vectors::<4, _>(accessors, color, 3, "COLOR_0")?);
    } else if !mesh.colors.is_empty() {
        mesh.colors.resize(after, [1.0; 4]);
    }
    if let Some(uv) = attributes.uv {
        mesh.uvs.resize(before, Vec2::ZERO);
        mesh.uvs.append(&mut vectors::<2, _>(accessors, uv, 2, "TEXCOORD_0")?);
    } else if !mesh.uvs.is_empty() {
        mesh.uvs.resize(after, Vec2::ZERO);
    }
    Ok(())
}

/// An attribute's vectors of `least` to N components.
fn vectors<const N: usize, T: From<[f32; N]> + Copy>(
    accessors: &Accessors,
    index: usize,
    least: usize,
    item: &str,
) -> Result<Vec<T>, String> {
    accessors.vectors(index, least).map_err(|e| format!("{item}: {e}"))
}

/// A primitive's index triples, or those of its vertices in order if it has no indices; none reaches beyond the vertices.
fn triangles(primitive: &Primitive, accessors: &Accessors, vertices: usize, budget: &mut Budget) -> Result<Vec<[u32; 3]>, String> {
    let indices = match primitive.indices {
        Some(accessor) => {
            let at = |e: String| format!("indices: {e}");
            let count = accessors.count(accessor).map_err(at)?;
            budget.spend(count, TRIANGLE_BYTES).map_err(|e| format!("indices: {count} of them, and {e}"))?;
            accessors.indices(accessor).map_err(at)?
        }
        None => (0..u32::try_from(vertices).map_err(|e| e.to_string())?).collect(),
    };
    if let Some(at) = indices.iter().position(|&v| v as usize >= vertices) {
        return Err(format!("index {at} points to vertex {}, but there are {vertices}", indices[at]));
    }
    match primitive.mode.unwrap_or(TRIANGLES) {
        TRIANGLES => match indices.as_chunks::<3>() {
            (triangles, []) => Ok(triangles.to_vec()),
            _ => Err(format!("{} indices don't make triangles", indices.len())),
        },
        STRIP => Ok(strip(&indices).collect()),
        FAN => Ok(indices.windows(2).skip(1).map(|w| [w[0], w[1], indices[0]]).collect()),
        other => Err(format!("mode {other} is unknown")),
    }
}
