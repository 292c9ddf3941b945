//! Mesh files in: by extension to the reader of the format, then checked.

use std::fs;
use std::path::Path;

use crate::error::shortened;
use crate::{Mesh, MeshError, read_gltf, read_obj, read_ply, read_stl};

/// Reads the triangle mesh of a `.glb`, `.gltf`, `.obj`, `.ply` or `.stl` file.
///
/// What the file is made of comes in its order and is told by [`Mesh::parts`]. Vertices keep the order of the file. Missing normals
/// are computed. Positions are rounded to `f32` and keep the file's unit and origin. Textures, skins and animations are not read.
///
/// - **glTF** 2.0: all primitives of all nodes, node transforms applied, but not to a skinned mesh, as glTF wants it. A mesh that
///   several nodes share comes once a node. Strips and fans become triangles, points and lines are left out. Quantised and sparse
///   accessors are read, compressed ones are not. Buffers may be files below, beside or above the document, by a relative path.
/// - **OBJ**: polygons are cut into triangles, also concave ones. Corners of a part with the same position, texture coordinate and
///   normal become one vertex. Curves, surfaces and smoothing groups are not read.
/// - **PLY**, text or binary: faces are cut into triangles as in OBJ, strips too. Colours in integers are sRGB, as painting programs
///   write them. Other elements and properties are skipped.
/// - **STL**, text or binary: three vertices a triangle, with the triangle's normal; the file's normals are not looked at.
///
/// Reading takes memory for the file and some times as much for the mesh; at worst, for a file that was made for it, a hundred times.
/// A small glTF or OBJ that says more than it holds may grow to 64 MiB, as one that shows a mesh at many nodes does.
///
/// # Errors
/// [`MeshError::UnknownExtension`], [`MeshError::Io`] if the file is not there, [`MeshError::NotAMesh`] for content that can't be read
/// or grows too large, [`MeshError::NoSurface`] for points and lines only, and those of [`Mesh::validate`].
pub fn read_mesh(path: &Path) -> Result<Mesh, MeshError> {
    let name = path.display().to_string();
    let format = Format::of(&name)?;
    let bytes = fs::read(path).map_err(|source| MeshError::Io { name: name.clone(), source })?;
    format.parse(&name, &bytes, path.parent())
}

/// Reads a mesh file held in memory. `name` is for errors, and its extension tells the format. See [`read_mesh`] for what is read.
///
/// # Errors
/// Those of [`read_mesh`]; a buffer in another file is [`MeshError::NotAMesh`], since there is no folder to look in.
pub fn parse_mesh(name: &str, bytes: &[u8]) -> Result<Mesh, MeshError> {
    Format::of(name)?.parse(name, bytes, None)
}

/// Reads the triangle mesh of a `.glb` held in memory, whatever its `name`, which is for errors. See [`read_mesh`] for what is read.
///
/// # Errors
/// Those of [`parse_mesh`].
pub fn parse_glb(name: &str, bytes: &[u8]) -> Result<Mesh, MeshError> {
    read_gltf::parse(name, bytes, None)
}

enum Format {
    Gltf,
    Obj,
    Ply,
    Stl,
}

impl Format {
    fn of(name: &str) -> Result<Format, MeshError> {
        let extension = Path::new(name).extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
        match extension.as_str() {
            "glb" | "gltf" => Ok(Format::Gltf),
            "obj" => Ok(Format::Obj),
            "ply" => Ok(Format::Ply),
            "stl" => Ok(Format::Stl),
            _ => Err(MeshError::UnknownExtension { name: name.into(), extension }),
        }
    }

    fn parse(&self, name: &str, bytes: &[u8], folder: Option<&Path>) -> Result<Mesh, MeshError> {
        match self {
            Format::Gltf => read_gltf::parse(name, bytes, folder),
            Format::Obj => read_obj::parse(name, bytes),
            Format::Ply => read_ply::parse(name, bytes),
            Format::Stl => read_stl::parse(name, bytes),
        }
    }
}

pub(crate) fn not_a_mesh(name: &str, reason: impl ToString) -> MeshError {
    MeshError::NotAMesh { name: name.into(), reason: shortened(reason) }
}
