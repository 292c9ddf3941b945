//! glTF in. The `gltf` crate reads the document and the buffers; accessors are read here, because they come from the file and the
//! crate's own iterators panic on one that reaches beyond its buffer.

use std::path::Path;

use glam::{Mat3, Mat4, Vec2, Vec3};
use gltf::accessor::{DataType, Dimensions};
use gltf::mesh::Mode;
use gltf::{Accessor, Document, Gltf, Primitive, Semantic};

use crate::mesh::smooth_normals;
use crate::read::not_a_mesh;
use crate::{Mesh, MeshError};

type Buffers = [gltf::buffer::Data];

pub(crate) fn parse(name: &str, bytes: &[u8], folder: Option<&Path>) -> Result<Mesh, MeshError> {
    let Gltf { document, blob } = Gltf::from_slice(bytes).map_err(|e| not_a_mesh(name, e))?;
    let buffers = gltf::import_buffers(&document, folder, blob).map_err(|e| not_a_mesh(name, e))?;

    let mut mesh = Mesh { name: name.into(), ..Mesh::default() };
    let transforms = world_transforms(&document).map_err(|reason| not_a_mesh(name, reason))?;
    for (node, transform) in document.nodes().zip(transforms) {
        let Some(part) = node.mesh() else { continue };
        let transform = if node.skin().is_some() { Mat4::IDENTITY } else { transform };
        for primitive in part.primitives() {
            if primitive.mode() != Mode::Triangles {
                return Err(MeshError::UnsupportedMode {
                    name: name.into(),
                    mesh: part.index(),
                    primitive: primitive.index(),
                    mode: format!("{:?}", primitive.mode()),
                });
            }
            append(&mut mesh, &primitive, &buffers, transform).map_err(|reason| {
                let (mesh, primitive) = (part.index(), primitive.index());
                not_a_mesh(name, format_args!("mesh {mesh}, primitive {primitive}: {reason}"))
            })?;
        }
    }
    mesh.validate()?;
    Ok(mesh)
}

/// The transform of every node to the world, in file order.
fn world_transforms(document: &Document) -> Result<Vec<Mat4>, String> {
    let count = document.nodes().len();
    let mut parent = vec![None; count];
    for node in document.nodes() {
        for child in node.children() {
            let slot = &mut parent[child.index()];
            if slot.replace(node.index()).is_some() {
                return Err(format!("node {} has two parents", child.index()));
            }
        }
    }
    let local: Vec<Mat4> = document.nodes().map(|n| Mat4::from_cols_array_2d(&n.transform().matrix())).collect();
    let world = |node: usize| {
        let mut transform = local[node];
        let mut above = parent[node];
        for _ in 0..count {
            let Some(p) = above else { return Ok(transform) };
            transform = local[p] * transform;
            above = parent[p];
        }
        Err(format!("node {node} is its own ancestor"))
    };
    (0..count).map(world).collect()
}

/// Adds one primitive to the mesh.
fn append(mesh: &mut Mesh, primitive: &Primitive, buffers: &Buffers, transform: Mat4) -> Result<(), String> {
    let read = |semantic: Semantic| {
        let accessor = primitive.get(&semantic);
        accessor.map(|a| floats(&a, buffers).map_err(|e| format!("{semantic:?}: {e}")))
    };
    let vec3 = |v: [f32; 4]| Vec3::new(v[0], v[1], v[2]);

    let positions = read(Semantic::Positions).ok_or("it has no positions")??;
    let vertices = positions.len();
    let mut positions: Vec<Vec3> = positions.into_iter().map(vec3).collect();
    let mut triangles = triangles(primitive, buffers, vertices)?;
    let mut normals = match read(Semantic::Normals) {
        Some(normals) => normals?.into_iter().map(vec3).collect(),
        None => smooth_normals(&positions, &triangles),
    };
    let colors = read(Semantic::Colors(0)).transpose()?;
    let uvs = read(Semantic::TexCoords(0)).transpose()?;
    for (item, found) in [
        ("normals", normals.len()),
        ("colors", colors.as_ref().map_or(vertices, Vec::len)),
        ("uvs", uvs.as_ref().map_or(vertices, Vec::len)),
    ] {
        if found != vertices {
            return Err(format!("{found} {item} for {vertices} positions"));
        }
    }

    // Untouched bits under the identity: the hash of a file's mesh is then the one of the mesh that the engine loads from it.
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
    let base = u32::try_from(before).map_err(|_| "more vertices than a 32-bit index reaches")?;
    for t in &triangles {
        let mut moved = [0; 3];
        for (to, from) in moved.iter_mut().zip(t) {
            *to = base.checked_add(*from).ok_or("more vertices than a 32-bit index reaches")?;
        }
        mesh.triangles.push(moved);
    }
    mesh.positions.extend(positions);
    mesh.normals.extend(normals);
    let after = mesh.positions.len();
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

/// A primitive's index triples, or the vertices in threes if it has no indices.
fn triangles(primitive: &Primitive, buffers: &Buffers, vertices: usize) -> Result<Vec<[u32; 3]>, String> {
    let indices = match primitive.indices() {
        Some(accessor) => indices(&accessor, buffers).map_err(|e| format!("indices: {e}"))?,
        None => (0..u32::try_from(vertices).map_err(|e| e.to_string())?).collect(),
    };
    let (triangles, rest) = indices.as_chunks::<3>();
    if !rest.is_empty() {
        return Err(format!("{} indices don't make triangles", indices.len()));
    }
    Ok(triangles.to_vec())
}

/// The elements of an accessor: bytes of one element each, checked against the buffer.
fn elements<'a>(accessor: &Accessor, buffers: &'a Buffers) -> Result<impl Iterator<Item = &'a [u8]> + use<'a>, String> {
    if accessor.sparse().is_some() {
        return Err("sparse accessors are not supported".into());
    }
    let view = accessor.view().ok_or("the accessor has no buffer view")?;
    let size = accessor.size();
    let stride = view.stride().unwrap_or(size).max(1);
    let bytes = buffers
        .get(view.buffer().index())
        .and_then(|b| b.0.get(view.offset()..view.offset().checked_add(view.length())?))
        .and_then(|b| b.get(accessor.offset()..))
        .ok_or("the buffer view reaches beyond its buffer")?;
    let count = accessor.count();
    let needed = count.checked_sub(1).map_or(Some(0), |n| n.checked_mul(stride)?.checked_add(size));
    if needed.is_none_or(|needed| needed > bytes.len()) {
        return Err("the accessor reaches beyond its buffer view".into());
    }
    Ok((0..count).map(move |i| &bytes[i * stride..i * stride + size]))
}

/// Scalars to 4-vectors of any storable type, integers normalised to 0..1 or -1..1; missing components are 0, a missing alpha 1.
fn floats(accessor: &Accessor, buffers: &Buffers) -> Result<Vec<[f32; 4]>, String> {
    let components = match accessor.dimensions() {
        Dimensions::Vec2 => 2,
        Dimensions::Vec3 => 3,
        Dimensions::Vec4 => 4,
        other => return Err(format!("{other:?} where a vector should be")),
    };
    let kind = accessor.data_type();
    let width = kind.size();
    let value = |b: &[u8]| match (kind, b) {
        (DataType::F32, &[a, b, c, d]) => f32::from_le_bytes([a, b, c, d]),
        (DataType::U8, &[a]) => f32::from(a) / 255.0,
        (DataType::U16, &[a, b]) => f32::from(u16::from_le_bytes([a, b])) / 65535.0,
        (DataType::I8, &[a]) => (f32::from(a as i8) / 127.0).max(-1.0),
        (DataType::I16, &[a, b]) => (f32::from(i16::from_le_bytes([a, b])) / 32767.0).max(-1.0),
        _ => f32::NAN,
    };
    let vector = |bytes: &[u8]| {
        let mut v = [0.0, 0.0, 0.0, 1.0];
        for (x, bytes) in v.iter_mut().zip(bytes.chunks(width)).take(components) {
            *x = value(bytes);
        }
        v
    };
    Ok(elements(accessor, buffers)?.map(vector).collect())
}

fn indices(accessor: &Accessor, buffers: &Buffers) -> Result<Vec<u32>, String> {
    if accessor.dimensions() != Dimensions::Scalar {
        return Err(format!("{:?} where a scalar should be", accessor.dimensions()));
    }
    let index = |b: &[u8]| match *b {
        [a] => Ok(u32::from(a)),
        [a, b] => Ok(u32::from(u16::from_le_bytes([a, b]))),
        [a, b, c, d] => Ok(u32::from_le_bytes([a, b, c, d])),
        _ => Err(format!("{} bytes an index", b.len())),
    };
    match accessor.data_type() {
        DataType::U8 | DataType::U16 | DataType::U32 => elements(accessor, buffers)?.map(index).collect(),
        other => Err(format!("{other:?} is no index type")),
    }
}
