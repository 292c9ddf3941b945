//! Wavefront OBJ in: `v`, `vt`, `vn` and `f` lines; polygons become fans of triangles; all else is skipped.
//!
//! Read here and not by a crate: the usual one multiplies indices from the file without a check and panics on large ones.

use std::collections::BTreeMap;
use std::str::{FromStr, SplitAsciiWhitespace};

use glam::{Vec2, Vec3};

use crate::mesh::smooth_normals;
use crate::read::not_a_mesh;
use crate::{Mesh, MeshError};

/// The lists of the file, which faces point into.
#[derive(Default)]
struct Lists {
    positions: Vec<Vec3>,
    /// One a position; white where the file has none.
    colors: Vec<[f32; 4]>,
    any_color: bool,
    uvs: Vec<Vec2>,
    normals: Vec<Vec3>,
}

/// A face's corner: position, texture coordinate, normal.
type Corner = (usize, Option<usize>, Option<usize>);

pub(crate) fn parse(name: &str, bytes: &[u8]) -> Result<Mesh, MeshError> {
    let text = std::str::from_utf8(bytes).map_err(|e| not_a_mesh(name, e))?;
    let mut lists = Lists::default();
    let mut corners: Vec<Corner> = Vec::new();
    let mut vertex_of: BTreeMap<Corner, u32> = BTreeMap::new();
    let mut triangles = Vec::new();
    for (line, content) in text.lines().enumerate() {
        let mut words = content.split_ascii_whitespace();
        let done = match words.next() {
            Some("v") => lists.position(words),
            Some("vt") => vector(words, 2).map(|[u, v, _]| lists.uvs.push(Vec2::new(u, v))),
            Some("vn") => vector(words, 3).map(|n| lists.normals.push(n.into())),
            Some("f") => lists.face(words).and_then(|face| {
                let mut vertices = Vec::with_capacity(face.len());
                for corner in face {
                    let next = u32::try_from(corners.len()).map_err(|e| e.to_string())?;
                    let vertex = *vertex_of.entry(corner).or_insert(next);
                    if vertex == next {
                        corners.push(corner);
                    }
                    vertices.push(vertex);
                }
                triangles.extend(vertices.windows(2).skip(1).map(|w| [vertices[0], w[0], w[1]]));
                Ok(())
            }),
            _ => Ok(()),
        };
        done.map_err(|e| not_a_mesh(name, format_args!("line {}: {e}", line + 1)))?;
    }

    let positions: Vec<Vec3> = corners.iter().map(|c| lists.positions[c.0]).collect();
    // The format doesn't ask for unit normals.
    let normals: Option<Vec<Vec3>> = corners.iter().map(|c| c.2.map(|n| lists.normals[n].normalize_or(Vec3::Y))).collect();
    let uvs: Option<Vec<Vec2>> = corners.iter().map(|c| c.1.map(|t| lists.uvs[t])).collect();
    let colors = corners.iter().filter(|_| lists.any_color).map(|c| lists.colors[c.0]).collect();
    let mesh = Mesh {
        name: name.into(),
        normals: normals.unwrap_or_else(|| smooth_normals(&positions, &triangles)),
        positions,
        colors,
        uvs: uvs.unwrap_or_default(),
        triangles,
        parts: Vec::new(),
    };
    mesh.validate()?;
    Ok(mesh)
}

impl Lists {
    /// `x y z`, `x y z w` (w is ignored) or `x y z r g b`.
    fn position(&mut self, words: SplitAsciiWhitespace) -> Result<(), String> {
        let rest: Vec<&str> = words.clone().skip(3).collect();
        self.positions.push(vector(words, 3)?.into());
        let mut color = [1.0; 4];
        if rest.len() >= 3 {
            self.any_color = true;
            for (x, word) in color.iter_mut().zip(&rest[..3]) {
                *x = number(word)?;
            }
        }
        self.colors.push(color);
        Ok(())
    }

    /// `v`, `v/vt`, `v//vn` or `v/vt/vn` a corner, counted from 1, or backwards from -1.
    fn face(&self, words: SplitAsciiWhitespace) -> Result<Vec<Corner>, String> {
        let corner = |word: &str| {
            let mut parts = word.split('/');
            let mut next = |list: &str, len: usize| match parts.next() {
                None | Some("") => Ok(None),
                Some(part) => index(part, len).map(Some).map_err(|e| format!("{list} {e}")),
            };
            let v = next("vertex", self.positions.len())?;
            let vt = next("texture coordinate", self.uvs.len())?;
            let vn = next("normal", self.normals.len())?;
            Ok((v.ok_or(format!("corner {word:?} has no vertex"))?, vt, vn))
        };
        words.map(corner).collect()
    }
}

fn index(word: &str, len: usize) -> Result<usize, String> {
    let value: i64 = number(word)?;
    let at = if value < 0 { (len as i64).checked_add(value) } else { value.checked_sub(1) };
    at.and_then(|at| usize::try_from(at).ok()).filter(|&at| at < len).ok_or_else(|| format!("{value} is not among the {len} read so far"))
}

fn vector(words: SplitAsciiWhitespace, count: usize) -> Result<[f32; 3], String> {
    let mut v = [0.0; 3];
    let mut found = 0;
    for (x, word) in v.iter_mut().zip(words).take(count) {
        *x = number(word)?;
        found += 1;
    }
    if found == count { Ok(v) } else { Err(format!("{found} numbers where {count} should be")) }
}

fn number<T: FromStr>(word: &str) -> Result<T, String> {
    word.parse().map_err(|_| format!("{word:?} is not a number"))
}
