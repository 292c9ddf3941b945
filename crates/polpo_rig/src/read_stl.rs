//! STL in, text or binary.
//!
//! Read here and not by a crate: the usual one takes a binary file whose header begins with "solid" for text, and stops after the
//! first solid. The normals of the file are not looked at: they say what the triangle says, or nothing.

use std::str::SplitAsciiWhitespace;

use glam::Vec3;

use crate::mesh::unit;
use crate::read::not_a_mesh;
use crate::read_obj::finite;
use crate::{Mesh, MeshError};

/// A text and the number of triangles.
const HEADER: usize = 84;
/// The normal, three corners and two bytes that nobody agrees on.
const FACET: usize = 50;

pub(crate) fn parse(name: &str, bytes: &[u8]) -> Result<Mesh, MeshError> {
    let mut mesh = Mesh { name: name.into(), ..Mesh::default() };
    let binary = announced(bytes).is_some_and(|count| count.checked_mul(FACET) == Some(bytes.len() - HEADER));
    let done = if !binary && is_text(bytes) { text(&mut mesh, bytes) } else { self::binary(&mut mesh, bytes) };
    done.map_err(|e| not_a_mesh(name, e))?;
    mesh.validate()?;
    Ok(mesh)
}

/// How many triangles it has if it is binary and not shorter than the header.
fn announced(bytes: &[u8]) -> Option<usize> {
    let count = bytes.get(HEADER - 4..)?.first_chunk::<4>()?;
    Some(u32::from_le_bytes(*count) as usize)
}

/// A binary header may begin with "solid" too, but no text has a zero.
fn is_text(bytes: &[u8]) -> bool {
    let bytes = bytes.trim_ascii_start();
    bytes.get(..5).is_some_and(|b| b.eq_ignore_ascii_case(b"solid")) && !bytes[..bytes.len().min(512)].contains(&0)
}

fn binary(mesh: &mut Mesh, bytes: &[u8]) -> Result<(), String> {
    let count = announced(bytes).ok_or("neither a text that begins with \"solid\" nor as long as a binary header")?;
    let (facets, rest) = bytes[HEADER..].as_chunks::<FACET>();
    if facets.len() != count || !rest.is_empty() {
        let (bytes, whole) = (bytes.len() - HEADER, facets.len());
        return Err(format!("{count} triangles announced, but the {bytes} bytes after the header are {whole} and {} more", rest.len()));
    }
    mesh.positions.reserve_exact(3 * count);
    mesh.normals.reserve_exact(3 * count);
    mesh.triangles.reserve_exact(count);
    for facet in facets {
        let (words, _) = facet.as_chunks::<4>();
        let x = |i: usize| f32::from_le_bytes(words[i]);
        triangle(mesh, [3, 6, 9].map(|i| Vec3::new(x(i), x(i + 1), x(i + 2))))?;
    }
    let header: Vec<u8> = bytes[..HEADER - 4].iter().copied().take_while(|&b| b != 0).collect();
    let header = std::str::from_utf8(&header).unwrap_or_default().trim_ascii();
    mesh.end_part(mesh.positions.len(), "", header.strip_prefix("solid ").unwrap_or(header).trim_ascii(), "");
    Ok(())
}

fn text(mesh: &mut Mesh, bytes: &[u8]) -> Result<(), String> {
    let text = String::from_utf8_lossy(bytes);
    let (mut solid, mut corners) = (None, Vec::new());
    for (line, content) in text.lines().enumerate() {
        let mut words = content.split_ascii_whitespace();
        let Some(word) = words.next() else { continue };
        let name = content.trim_ascii_start()[word.len()..].trim_ascii();
        let done = match (word.to_ascii_lowercase().as_str(), solid) {
            ("solid", None) => {
                solid = Some(name);
                Ok(())
            }
            ("endsolid", Some(name)) if corners.is_empty() => {
                mesh.end_part(mesh.positions.len(), "", name, "");
                solid = None;
                Ok(())
            }
            ("facet" | "outer", Some(_)) if corners.is_empty() => Ok(()),
            ("endloop", Some(_)) => Ok(()),
            ("vertex", Some(_)) => vertex(words).map(|p| corners.push(p)),
            ("endfacet", Some(_)) => match <[Vec3; 3]>::try_from(std::mem::take(&mut corners)) {
                Ok(corners) => triangle(mesh, corners),
                Err(corners) => Err(format!("a facet of {} corners", corners.len())),
            },
            _ => Err(format!("{word:?} is out of place")),
        };
        done.map_err(|e| format!("line {}: {e}", line + 1))?;
    }
    solid.map_or(Ok(()), |name| Err(format!("it ends within the solid {name:?}")))
}

fn vertex(mut words: SplitAsciiWhitespace) -> Result<Vec3, String> {
    let mut next = || words.next().ok_or("fewer than 3 numbers".to_string()).and_then(finite);
    Ok(Vec3::new(next()?, next()?, next()?))
}

fn triangle(mesh: &mut Mesh, corners: [Vec3; 3]) -> Result<(), String> {
    let first = u32::try_from(mesh.positions.len()).ok().filter(|first| first.checked_add(3).is_some());
    let first = first.ok_or("more vertices than a 32-bit index reaches")?;
    let [a, b, c] = corners.map(Vec3::as_dvec3);
    mesh.positions.extend(corners);
    mesh.normals.extend([unit((b - a).cross(c - a)).as_vec3(); 3]);
    mesh.triangles.push([first, first + 1, first + 2]);
    Ok(())
}
