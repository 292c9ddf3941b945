//! Wavefront OBJ in: `v`, `vt`, `vn` and `f` lines, and `o`, `g` and `usemtl` for the parts; all else is skipped.
//!
//! Read here and not by a crate: the usual one multiplies indices from the file without a check and panics on large ones.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::str::{FromStr, SplitAsciiWhitespace};

use glam::{Vec2, Vec3};

use crate::budget::Budget;
use crate::mesh::{smooth_normals, unit_normal};
use crate::polygons::Cutter;
use crate::read::not_a_mesh;
use crate::{Mesh, MeshError, MeshPart};

/// A face's corner: position, texture coordinate, normal, as indices into the lists; `NONE` for one that it has not.
type Corner = [u32; 3];

const NONE: u32 = u32::MAX;

/// The lists of the file, which faces point into.
#[derive(Default)]
struct Lists {
    positions: Vec<Vec3>,
    /// Empty until a position has one, then one a position; white where the file has none.
    colors: Vec<[f32; 3]>,
    uvs: Vec<Vec2>,
    normals: Vec<Vec3>,
}

/// What the file has said so far.
struct Reader {
    lists: Lists,
    /// The object, group and material of the faces to come.
    names: [String; 3],
    /// One a vertex of the mesh.
    corners: Vec<Corner>,
    /// The vertices of the part that is open.
    vertex_of: BTreeMap<Corner, u32>,
    /// Without positions, normals and the like until the end.
    mesh: Mesh,
    cutter: Cutter,
    budget: Budget,
    // The face at hand; kept for their memory.
    face: Vec<Corner>,
    vertices: Vec<u32>,
    outline: Vec<Vec3>,
}

pub(crate) fn parse(name: &str, bytes: &[u8]) -> Result<Mesh, MeshError> {
    // Names in old encodings are no reason to refuse a mesh.
    let text = String::from_utf8_lossy(bytes);
    let mut reader = Reader {
        lists: Lists::default(),
        names: Default::default(),
        corners: Vec::new(),
        vertex_of: BTreeMap::new(),
        mesh: Mesh { name: name.into(), ..Mesh::default() },
        cutter: Cutter::default(),
        budget: Budget::of(bytes.len()),
        face: Vec::new(),
        vertices: Vec::new(),
        outline: Vec::new(),
    };
    for (line, content) in lines(&text) {
        reader.line(&content).map_err(|e| not_a_mesh(name, format_args!("line {line}: {e}")))?;
    }
    reader.end_part().map_err(|e| not_a_mesh(name, e))?;
    let mesh = reader.finish();
    mesh.validate()?;
    Ok(mesh)
}

/// Lines with their number, from 1; one that ends in a backslash goes on in the next.
fn lines(text: &str) -> impl Iterator<Item = (usize, Cow<'_, str>)> {
    let mut lines = text.lines().enumerate();
    std::iter::from_fn(move || {
        let (at, mut line) = lines.next()?;
        let mut whole = Cow::Borrowed(line);
        while let Some(start) = line.strip_suffix('\\') {
            let joined = whole.to_mut();
            joined.truncate(joined.len() - line.len());
            line = lines.next().map_or("", |(_, next)| next);
            joined.extend([start, " ", line]);
        }
        Some((at + 1, whole))
    })
}

impl Reader {
    fn line(&mut self, content: &str) -> Result<(), String> {
        let mut words = content.split_ascii_whitespace();
        let lists = &mut self.lists;
        match words.next() {
            Some("v") => lists.position(words),
            Some("vt") => vector(words, 2).map(|[u, v, _]| lists.uvs.push(Vec2::new(u, v))),
            Some("vn") => vector(words, 3).map(|n| lists.normals.push(n.into())),
            Some("f") => self.face(words),
            Some(word @ ("o" | "g" | "usemtl")) => {
                let slot = ["o", "g", "usemtl"].iter().position(|w| *w == word).unwrap_or_default();
                let name = content.trim_ascii_start()[word.len()..].trim_ascii();
                if self.names[slot] != name {
                    self.end_part()?;
                    self.names[slot] = name.into();
                }
                Ok(())
            }
            _ => Ok(()),
        }
    }

    fn face(&mut self, words: SplitAsciiWhitespace) -> Result<(), String> {
        self.face.clear();
        for word in words {
            self.face.push(self.lists.corner(word)?);
        }
        if self.face.len() < 3 {
            return Ok(());
        }
        self.vertices.clear();
        self.outline.clear();
        for &corner in &self.face {
            let next = u32::try_from(self.corners.len()).map_err(|e| e.to_string())?;
            let vertex = *self.vertex_of.entry(corner).or_insert(next);
            if vertex == next {
                self.corners.push(corner);
            }
            self.vertices.push(vertex);
            self.outline.push(self.lists.positions[corner[0] as usize]);
        }
        self.cutter.cut(&self.vertices, &self.outline, &mut self.mesh.triangles)
    }

    /// Makes a part of the faces since the last one, if there are any.
    fn end_part(&mut self) -> Result<(), String> {
        if self.vertex_of.is_empty() {
            return Ok(());
        }
        self.vertex_of.clear();
        let [object, group, material] = &self.names;
        self.budget.spend(size_of::<MeshPart>() + object.len() + group.len() + material.len(), 1)?;
        self.mesh.end_part(self.corners.len(), object, group, material);
        Ok(())
    }

    /// The mesh, its vertices made of the corners.
    fn finish(self) -> Mesh {
        let Reader { lists, corners, mut mesh, .. } = self;
        let some = |index: u32| Some(index as usize).filter(|_| index != NONE);
        mesh.positions = corners.iter().map(|c| lists.positions[c[0] as usize]).collect();
        if corners.iter().any(|c| c[2] == NONE) {
            // By position, so that neither parts nor seams of texture coordinates make an edge.
            let places: Vec<[u32; 3]> = mesh.triangles.iter().map(|t| t.map(|v| corners[v as usize][0])).collect();
            let smooth = smooth_normals(&lists.positions, &places);
            mesh.normals = corners.iter().map(|c| some(c[2]).map_or(smooth[c[0] as usize], |n| unit_normal(lists.normals[n]))).collect();
        } else {
            // The format doesn't ask for unit normals.
            mesh.normals = corners.iter().map(|c| unit_normal(lists.normals[c[2] as usize])).collect();
        }
        mesh.uvs = corners.iter().map(|c| some(c[1]).map(|t| lists.uvs[t])).collect::<Option<_>>().unwrap_or_default();
        let color = |c: &Corner| lists.colors.get(c[0] as usize).map_or([1.0; 4], |&[r, g, b]| [r, g, b, 1.0]);
        mesh.colors = corners.iter().filter(|_| !lists.colors.is_empty()).map(color).collect();
        mesh
    }
}

impl Lists {
    /// `x y z`, `x y z w` (w is ignored) or `x y z r g b`.
    fn position(&mut self, words: SplitAsciiWhitespace) -> Result<(), String> {
        let position = vector(words.clone(), 3)?;
        let mut rest = words.skip(3);
        if rest.clone().nth(2).is_some() {
            let mut color = [1.0; 3];
            for (x, word) in color.iter_mut().zip(&mut rest) {
                *x = finite(word)?;
            }
            self.colors.resize(self.positions.len(), [1.0; 3]);
            self.colors.push(color);
        }
        self.positions.push(position.into());
        Ok(())
    }

    /// `v`, `v/vt`, `v//vn` or `v/vt/vn`, counted from 1, or backwards from -1.
    fn corner(&self, word: &str) -> Result<Corner, String> {
        let mut parts = word.split('/');
        let mut next = |list: &str, len: usize| match parts.next() {
            None | Some("") => Ok(NONE),
            Some(part) => index(part, len).map_err(|e| format!("{list} {e}")),
        };
        let v = next("vertex", self.positions.len())?;
        let vt = next("texture coordinate", self.uvs.len())?;
        let vn = next("normal", self.normals.len())?;
        if v == NONE { Err(format!("corner {word:?} has no vertex")) } else { Ok([v, vt, vn]) }
    }
}

fn index(word: &str, len: usize) -> Result<u32, String> {
    let value: i64 = number(word)?;
    let at = if value < 0 { (len as i64).checked_add(value) } else { value.checked_sub(1) };
    at.and_then(|at| u32::try_from(at).ok())
        .filter(|&at| (at as usize) < len && at != NONE)
        .ok_or_else(|| format!("{value} is not among the {len} read so far"))
}

fn vector(words: SplitAsciiWhitespace, count: usize) -> Result<[f32; 3], String> {
    let mut v = [0.0; 3];
    let mut found = 0;
    for (x, word) in v.iter_mut().zip(words).take(count) {
        *x = finite(word)?;
        found += 1;
    }
    if found == count { Ok(v) } else { Err(format!("{found} numbers where {count} should be")) }
}

/// A number that `f32` holds.
pub(crate) fn finite(word: &str) -> Result<f32, String> {
    let x: f32 = number(word)?;
    if x.is_finite() { Ok(x) } else { Err(format!("{word:?} is not finite")) }
}

fn number<T: FromStr>(word: &str) -> Result<T, String> {
    word.parse().map_err(|_| format!("{word:?} is not a number"))
}
