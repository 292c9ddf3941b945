//! PLY in, text or binary, by `ply-rs-bw` element by element: what it keeps is then what we keep, whatever the header announces.

use glam::{DVec3, Vec2, Vec3};
use ply_rs_bw::parser::{ParseError, Parser, Reader};
use ply_rs_bw::ply::{ElementDef, Encoding, Header, PropertyAccess, PropertyAccessResult, PropertyType, ScalarType};

use crate::mesh::{smooth_normals, unit_normal};
use crate::polygons::{Cutter, strip};
use crate::read::not_a_mesh;
use crate::{Mesh, MeshError};

pub(crate) fn parse(name: &str, bytes: &[u8]) -> Result<Mesh, MeshError> {
    let fail = |reason: String| not_a_mesh(name, reason);
    let (header, body) = header(bytes).map_err(fail)?;
    let mut body = Body { encoding: header.encoding, rest: body };
    let mut mesh = Mesh { name: name.into(), ..Mesh::default() };
    let mut cutter = Cutter::default();
    for element in header.elements.values() {
        match element.name.as_str() {
            "vertex" => vertices(&mut mesh, &mut body, element),
            "face" | "tristrips" => faces(&mut mesh, &mut body, element, &mut cutter),
            _ => body.each(element, |Skipped| Ok(())),
        }
        .map_err(fail)?;
    }
    if mesh.normals.is_empty() {
        mesh.normals = smooth_normals(&mesh.positions, &mesh.triangles);
    }
    mesh.end_part(mesh.positions.len(), "", "", "");
    mesh.validate()?;
    Ok(mesh)
}

/// The header, and what follows it.
fn header(bytes: &[u8]) -> Result<(Header, &[u8]), String> {
    const END: &[u8] = b"end_header";
    let mut at = 0;
    loop {
        let line = bytes[at..].split_inclusive(|&b| b == b'\n').next().ok_or("it has no end_header")?;
        at += line.len();
        if line.trim_ascii_end() == END {
            break;
        }
    }
    let (header, body) = bytes.split_at(at);
    // Comments in old encodings are no reason to refuse a mesh.
    let header = String::from_utf8_lossy(header);
    let header = Parser::<Skipped>::new().read_header(&mut Reader::new(header.as_bytes())).map_err(|e| short(&e))?;
    Ok((header, body))
}

/// What follows the header.
struct Body<'a> {
    encoding: Encoding,
    rest: &'a [u8],
}

impl Body<'_> {
    /// Reads all of an element, one after the other.
    fn each<E: PropertyAccess>(&mut self, element: &ElementDef, mut take: impl FnMut(E) -> Result<(), String>) -> Result<(), String> {
        // Without properties there is nothing to read, however many there are.
        let count = if element.properties.is_empty() { 0 } else { element.count };
        let parser = Parser::<E>::new();
        for index in 0..count {
            let fail = |reason: String| format!("{} {index} of {count}: {reason}", element.name);
            if self.rest.is_empty() {
                return Err(fail("the file ends".into()));
            }
            let one = match self.encoding {
                Encoding::Ascii => {
                    let line = self.rest.split_inclusive(|&b| b == b'\n').next().unwrap_or_default();
                    self.rest = &self.rest[line.len()..];
                    let line = std::str::from_utf8(line).map_err(|e| fail(e.to_string()))?;
                    parser.read_ascii_element(line, element)
                }
                Encoding::BinaryBigEndian => parser.read_big_endian_element(&mut self.rest, element),
                Encoding::BinaryLittleEndian => parser.read_little_endian_element(&mut self.rest, element),
            };
            take(one.map_err(|e| fail(short(&e)))?).map_err(fail)?;
        }
        Ok(())
    }
}

/// The library repeats the line that it could not read; one of its lines is enough.
fn short(error: &ParseError) -> String {
    error.to_string().lines().next().unwrap_or_default().to_owned()
}

fn vertices(mesh: &mut Mesh, body: &mut Body, element: &ElementDef) -> Result<(), String> {
    let has = |names: &[&str]| names.iter().all(|&name| element.properties.contains_key(name));
    if !has(&["x", "y", "z"]) {
        return Err("its vertices have no x, y and z".into());
    }
    let normals = has(&["nx", "ny", "nz"]);
    let colors = has(&["red", "green", "blue"]);
    let uvs = [["u", "v"], ["s", "t"], ["texture_u", "texture_v"]].iter().any(|names| has(names));
    body.each(element, |vertex: Vertex| {
        if !vertex.position.is_finite() {
            return Err(format!("position {} is not finite", vertex.position));
        }
        mesh.positions.push(vertex.position.as_vec3());
        if normals {
            mesh.normals.push(unit_normal(vertex.normal));
        }
        if colors {
            mesh.colors.push(vertex.color);
        }
        if uvs {
            mesh.uvs.push(vertex.uv);
        }
        Ok(())
    })
}

fn faces(mesh: &mut Mesh, body: &mut Body, element: &ElementDef, cutter: &mut Cutter) -> Result<(), String> {
    let list = element.properties.iter().find(|(name, _)| CORNERS.contains(&name.as_str()));
    match list.map(|(_, property)| &property.data_type) {
        Some(PropertyType::List(_, kind)) if !matches!(kind, ScalarType::Float | ScalarType::Double) => {}
        _ => return Err(format!("its {} elements have no list {} of integers", element.name, CORNERS[0])),
    }
    let (mut corners, mut outline) = (Vec::new(), Vec::new());
    body.each(element, |face: Face| {
        if element.name == "face" {
            corners.clear();
            outline.clear();
            for &corner in &face.0 {
                let (corner, position) = vertex(mesh, corner)?;
                corners.push(corner);
                outline.push(position);
            }
            return cutter.cut(&corners, &outline, &mut mesh.triangles);
        }
        // Strips one after the other, each but the last ended by -1.
        for run in face.0.split(|&corner| corner == -1) {
            corners.clear();
            for &corner in run {
                corners.push(vertex(mesh, corner)?.0);
            }
            mesh.triangles.extend(strip(&corners));
        }
        Ok(())
    })
}

/// A corner's vertex and where it is.
fn vertex(mesh: &Mesh, corner: i64) -> Result<(u32, Vec3), String> {
    let index = u32::try_from(corner).ok();
    let found = index.and_then(|index| Some((index, *mesh.positions.get(index as usize)?)));
    found.ok_or_else(|| format!("vertex {corner} is not among the {} read so far", mesh.positions.len()))
}

const CORNERS: [&str; 2] = ["vertex_indices", "vertex_index"];

/// An element that nobody needs.
struct Skipped;

impl PropertyAccess for Skipped {
    fn new() -> Skipped {
        Skipped
    }
}

struct Vertex {
    position: DVec3,
    normal: Vec3,
    /// Linear RGBA.
    color: [f32; 4],
    uv: Vec2,
}

impl Vertex {
    /// `most` is the greatest value of an integer type, for colours; 0 for floats.
    fn set(&mut self, name: &str, value: f64, most: f64) -> PropertyAccessResult {
        let share = if most > 0.0 { value / most } else { value };
        let color = || if most > 0.0 { linear(share) } else { share as f32 };
        match name {
            "x" => self.position.x = value,
            "y" => self.position.y = value,
            "z" => self.position.z = value,
            "nx" => self.normal.x = value as f32,
            "ny" => self.normal.y = value as f32,
            "nz" => self.normal.z = value as f32,
            "red" => self.color[0] = color(),
            "green" => self.color[1] = color(),
            "blue" => self.color[2] = color(),
            "alpha" => self.color[3] = share as f32,
            "u" | "s" | "texture_u" => self.uv.x = value as f32,
            "v" | "t" | "texture_v" => self.uv.y = value as f32,
            _ => return PropertyAccessResult::Ignored,
        }
        PropertyAccessResult::Set
    }
}

/// sRGB to linear.
fn linear(x: f64) -> f32 {
    (if x <= 0.04045 { x / 12.92 } else { libm::pow((x + 0.055) / 1.055, 2.4) }) as f32
}

/// One setter a type of the format.
macro_rules! scalars {
    ($($setter:ident: $kind:ty, $most:expr;)*) => {
        $(fn $setter(&mut self, name: &str, value: $kind) -> PropertyAccessResult {
            self.set(name, f64::from(value), f64::from($most))
        })*
    };
}

impl PropertyAccess for Vertex {
    fn new() -> Vertex {
        Vertex { position: DVec3::ZERO, normal: Vec3::ZERO, color: [1.0; 4], uv: Vec2::ZERO }
    }

    scalars! {
        set_char: i8, i8::MAX;
        set_uchar: u8, u8::MAX;
        set_short: i16, i16::MAX;
        set_ushort: u16, u16::MAX;
        set_int: i32, i32::MAX;
        set_uint: u32, u32::MAX;
        set_float: f32, 0;
        set_double: f64, 0;
    }
}

/// A face's or a strip's corners.
struct Face(Vec<i64>);

macro_rules! lists {
    ($($setter:ident: $kind:ty;)*) => {
        $(fn $setter(&mut self, name: &str, values: Vec<$kind>) -> PropertyAccessResult {
            if !CORNERS.contains(&name) {
                return PropertyAccessResult::Ignored;
            }
            self.0 = values.into_iter().map(i64::from).collect();
            PropertyAccessResult::Set
        })*
    };
}

impl PropertyAccess for Face {
    fn new() -> Face {
        Face(Vec::new())
    }

    lists! {
        set_list_char: i8;
        set_list_uchar: u8;
        set_list_short: i16;
        set_list_ushort: u16;
        set_list_int: i32;
        set_list_uint: u32;
    }
}
