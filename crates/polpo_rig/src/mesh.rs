//! The triangle mesh a rig is made for.

use std::fmt;

use glam::{Vec2, Vec3};
use serde::{Deserialize, Serialize};

use crate::{MeshError, MeshPart};

/// A triangle mesh in its own unit (metres, as the rest of the house takes it), right-handed.
///
/// It may be open, come in several parts, and hold degenerate or duplicate triangles: [`build_rig`](crate::build_rig) copes.
/// What it must keep is checked by [`validate`](Mesh::validate).
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Mesh {
    /// Where it came from, for errors.
    pub name: String,
    /// One a vertex \[m\], finite.
    pub positions: Vec<Vec3>,
    /// One unit normal a vertex; the readers compute them if the file has none.
    pub normals: Vec<Vec3>,
    /// Linear RGBA, in 0 to 1; empty, or one a vertex.
    pub colors: Vec<[f32; 4]>,
    /// Texture coordinates; empty, or one a vertex.
    pub uvs: Vec<Vec2>,
    /// Three vertex indices a triangle, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// What the file is made of, in its order; empty for one part without a name.
    pub parts: Vec<MeshPart>,
}

/// A stable fingerprint of a mesh's positions and triangles: a rig carries the one of its mesh.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct MeshHash(pub u64);

impl fmt::Display for MeshHash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:016x}", self.0)
    }
}

impl Mesh {
    /// Checks that the mesh can be worked with.
    ///
    /// # Errors
    /// The first fault found, with the index of the vertex or triangle: no vertices, no triangles, attributes of another length,
    /// a value that is not finite, a triangle that points beyond the vertices, or all vertices in one point.
    pub fn validate(&self) -> Result<(), MeshError> {
        let name = || self.name.clone();
        let vertices = self.positions.len();
        if vertices == 0 {
            return Err(MeshError::Empty { name: name() });
        }
        if self.triangles.is_empty() {
            return Err(MeshError::NoTriangles { name: name() });
        }
        for (item, count) in [("vertices", vertices), ("triangles", self.triangles.len())] {
            if u32::try_from(count).is_err() {
                return Err(MeshError::TooLarge { name: name(), item, count });
            }
        }
        let optional = |len: usize| if len == 0 { vertices } else { len };
        for (item, found) in [("normals", self.normals.len()), ("colors", optional(self.colors.len())), ("uvs", optional(self.uvs.len()))] {
            if found != vertices {
                return Err(MeshError::LengthMismatch { name: name(), item, expected: vertices, found });
            }
        }
        let faults = [
            ("position", self.positions.iter().position(|p| !p.is_finite())),
            ("normal", self.normals.iter().position(|n| !n.is_finite())),
            ("color", self.colors.iter().position(|c| c.iter().any(|x| !x.is_finite()))),
            ("uv", self.uvs.iter().position(|uv| !uv.is_finite())),
        ];
        for (item, fault) in faults {
            if let Some(index) = fault {
                return Err(MeshError::NotFinite { name: name(), item, index });
            }
        }
        for (triangle, corners) in self.triangles.iter().enumerate() {
            if let Some(&vertex) = corners.iter().find(|&&v| v as usize >= vertices) {
                return Err(MeshError::IndexOutOfRange { name: name(), triangle, vertex, vertices });
            }
        }
        if self.positions.iter().all(|p| *p == self.positions[0]) {
            return Err(MeshError::ZeroExtent { name: name() });
        }
        Ok(())
    }

    /// The fingerprint of positions and triangles, counts included: FNV-1a (64 bit) over their 32-bit words, little end first.
    ///
    /// Normals, colours and texture coordinates don't enter: a repainted mesh keeps its rig. Positions enter bit by bit, so a mesh
    /// that went through a lossy format has another hash.
    pub fn hash(&self) -> MeshHash {
        let mut hash = 0xcbf2_9ce4_8422_2325_u64;
        let mut feed = |word: u32| {
            for byte in word.to_le_bytes() {
                hash = (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
            }
        };
        for count in [self.positions.len() as u64, self.triangles.len() as u64] {
            feed(count as u32);
            feed((count >> 32) as u32);
        }
        self.positions.iter().flat_map(|p| p.to_array()).for_each(|x| feed(x.to_bits()));
        self.triangles.iter().flatten().for_each(|&v| feed(v));
        MeshHash(hash)
    }
}

/// Normals from the triangles: the sum of the adjacent triangles' area vectors, normalised; Y up where that vanishes.
///
/// Triangles must point into `positions`.
pub(crate) fn smooth_normals(positions: &[Vec3], triangles: &[[u32; 3]]) -> Vec<Vec3> {
    let mut sums = vec![glam::DVec3::ZERO; positions.len()];
    for t in triangles {
        let [a, b, c] = t.map(|v| positions[v as usize].as_dvec3());
        let area = (b - a).cross(c - a);
        for &v in t {
            sums[v as usize] += area;
        }
    }
    sums.into_iter().map(|n| n.try_normalize().map_or(Vec3::Y, |n| n.as_vec3())).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hash_sees_positions_and_triangles_but_not_paint() {
        let mesh = Mesh {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
            normals: vec![Vec3::Z; 3],
            triangles: vec![[0, 1, 2]],
            ..Mesh::default()
        };
        let painted = Mesh { colors: vec![[1.0; 4]; 3], name: "other".into(), ..mesh.clone() };
        let moved = Mesh { positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y * 1.000_000_1], ..mesh.clone() };
        let turned = Mesh { triangles: vec![[0, 2, 1]], ..mesh.clone() };
        assert_eq!(mesh.hash(), painted.hash());
        assert_ne!(mesh.hash(), moved.hash());
        assert_ne!(mesh.hash(), turned.hash());
        // A rig file outlives the build that wrote it: the value itself is part of the format.
        assert_eq!(mesh.hash().to_string(), "a37e0cccee0a7884");
    }
}
