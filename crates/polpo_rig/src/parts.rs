//! The parts that a mesh's file is made of.

use std::ops::Range;

use crate::{Mesh, MeshError};

/// A part of a mesh as its file divides it: a run of vertices and of triangles, and what the file calls them.
///
/// In glTF one per node and primitive, in OBJ one per run of faces of the same object, group and material, in STL one per solid, in
/// PLY the whole. Names are the file's, not unique, and empty where the file has none.
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

impl Mesh {
    /// Makes a part of the triangles that came to the mesh since the last one, and of its vertices up to now.
    pub(crate) fn end_part(&mut self, vertices: usize, node: &str, name: &str, material: &str) {
        let (vertex, triangle) = self.parts.last().map_or((0, 0), |p| (p.vertices.end, p.triangles.end));
        // More than fits is refused by `validate`, before it looks at parts.
        let end = |len: usize| u32::try_from(len).unwrap_or(u32::MAX);
        self.parts.push(MeshPart {
            node: node.into(),
            name: name.into(),
            material: material.into(),
            vertices: vertex..end(vertices),
            triangles: triangle..end(self.triangles.len()),
        });
    }

    /// Parts follow each other without gaps to the end, and triangles keep to their part; no parts are fine.
    pub(crate) fn check_parts(&self) -> Result<(), MeshError> {
        let (mut vertex, mut triangle) = (0, 0);
        for (index, part) in self.parts.iter().enumerate() {
            let fail = |reason: String| MeshError::Part { name: self.name.clone(), part: index, reason };
            for (item, range, start, len) in [
                ("vertices", &part.vertices, &mut vertex, self.positions.len()),
                ("triangles", &part.triangles, &mut triangle, self.triangles.len()),
            ] {
                if range.start != *start || range.end < *start || range.end as usize > len {
                    return Err(fail(format!("its {item} are {range:?}, but must start at {start} and end within {len}")));
                }
                *start = range.end;
            }
            for t in part.triangles.clone() {
                if let Some(corner) = self.triangles[t as usize].iter().find(|corner| !part.vertices.contains(corner)) {
                    return Err(fail(format!("triangle {t} points to vertex {corner}, which is not of {:?}", part.vertices)));
                }
            }
        }
        let whole = [("vertices", vertex, self.positions.len()), ("triangles", triangle, self.triangles.len())];
        match whole.into_iter().find(|&(_, end, len)| end as usize != len) {
            Some((item, end, len)) if !self.parts.is_empty() => {
                let reason = format!("it is the last, but its {item} end at {end} and not at {len}");
                Err(MeshError::Part { name: self.name.clone(), part: self.parts.len() - 1, reason })
            }
            _ => Ok(()),
        }
    }
}
