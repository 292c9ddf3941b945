//! The parts that a mesh's file is made of.

use std::ops::Range;

/// A part of a mesh as its file divides it: a run of vertices and of triangles, and what the file calls them.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct MeshPart {
    /// The glTF node, or the OBJ object (`o`).
    pub node: String,
    /// The glTF mesh, the OBJ groups (`g`) or the STL solid.
    pub name: String,
    /// The glTF material, or the OBJ one (`usemtl`).
    pub material: String,
    /// Its vertices; a vertex belongs to one part.
    pub vertices: Range<u32>,
    /// Its triangles, whose corners are among its vertices.
    pub triangles: Range<u32>,
}
