//! Mesh files in: by extension to the glTF or the OBJ reader, then checked.

use std::fs;
use std::path::Path;

use crate::{Mesh, MeshError, read_gltf, read_obj};

/// Reads the triangle mesh of a `.glb`, `.gltf` or `.obj` file.
///
/// All primitives of all glTF nodes (all objects of an OBJ) come one after the other in file order, node transforms applied; the
/// node transform of a skinned mesh doesn't count, as glTF wants it. A mesh that several nodes share comes once a node. Vertices
/// keep the order of the file; OBJ corners with the same position, texture coordinate and normal become one vertex. Missing
/// normals are computed. Textures, materials, skins and animations are not read.
///
/// # Errors
/// [`MeshError::UnknownExtension`], [`MeshError::Io`] if the file is not there, [`MeshError::NotAMesh`] and
/// [`MeshError::UnsupportedMode`] for content that can't be read, and those of [`Mesh::validate`].
pub fn read_mesh(path: &Path) -> Result<Mesh, MeshError> {
    let name = path.display().to_string();
    let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    if !["glb", "gltf", "obj"].contains(&extension.as_str()) {
        return Err(MeshError::UnknownExtension { name, extension });
    }
    let bytes = fs::read(path).map_err(|source| MeshError::Io { name: name.clone(), source })?;
    if extension == "obj" { read_obj::parse(&name, &bytes) } else { read_gltf::parse(&name, &bytes, path.parent()) }
}

/// Reads the triangle mesh of a `.glb` held in memory; `name` is for errors. See [`read_mesh`] for what is read.
///
/// # Errors
/// Those of [`read_mesh`]; a buffer in another file is [`MeshError::NotAMesh`], since there is no folder to look in.
pub fn parse_glb(name: &str, bytes: &[u8]) -> Result<Mesh, MeshError> {
    read_gltf::parse(name, bytes, None)
}

pub(crate) fn not_a_mesh(name: &str, reason: impl ToString) -> MeshError {
    MeshError::NotAMesh { name: name.into(), reason: reason.to_string() }
}
