//! A binary glTF of one mesh: the least of the format that keeps vertex order, colours and exact positions.

use glam::DVec3;
use serde_json::{Value, json};

/// What is written: closed, coloured, one normal a vertex. Positions in metres, colours linear RGB.
pub(crate) struct ColoredMesh {
    pub(crate) name: &'static str,
    pub(crate) positions: Vec<DVec3>,
    pub(crate) normals: Vec<DVec3>,
    pub(crate) colors: Vec<DVec3>,
    pub(crate) triangles: Vec<[u32; 3]>,
}

const FLOAT: u32 = 5126;
const UNSIGNED_INT: u32 = 5125;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;

/// The file's bytes.
pub(crate) fn write(mesh: &ColoredMesh) -> Vec<u8> {
    let mut binary = Vec::new();
    let mut views = Vec::new();
    let mut view = |bytes: Vec<u8>, target: u32| {
        views.push(json!({
            "buffer": 0, "byteOffset": binary.len(), "byteLength": bytes.len(), "target": target,
        }));
        // Everything here is made of 4-byte words, so every view starts aligned.
        binary.extend(bytes);
    };
    let floats =
        |vectors: &[DVec3]| -> Vec<u8> { vectors.iter().flat_map(|v| v.as_vec3().to_array()).flat_map(f32::to_le_bytes).collect() };
    view(floats(&mesh.positions), ARRAY_BUFFER);
    view(floats(&mesh.normals), ARRAY_BUFFER);
    view(floats(&mesh.colors), ARRAY_BUFFER);
    view(mesh.triangles.iter().flatten().flat_map(|v| v.to_le_bytes()).collect(), ELEMENT_ARRAY_BUFFER);

    let (low, high) = bounds(&mesh.positions);
    let vertices = mesh.positions.len();
    let attribute = |view: usize| json!({ "bufferView": view, "componentType": FLOAT, "count": vertices, "type": "VEC3" });
    let mut position = attribute(0);
    position["min"] = low;
    position["max"] = high;
    let document = json!({
        "asset": { "version": "2.0", "generator": "cargo xtask assets" },
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "mesh": 0, "name": mesh.name }],
        "meshes": [{
            "name": mesh.name,
            "primitives": [{ "attributes": { "POSITION": 0, "NORMAL": 1, "COLOR_0": 2 }, "indices": 3, "material": 0 }],
        }],
        "materials": [{
            "name": "skin",
            "pbrMetallicRoughness": { "baseColorFactor": [1, 1, 1, 1], "metallicFactor": 0, "roughnessFactor": 0.45 },
        }],
        "accessors": [
            position,
            attribute(1),
            attribute(2),
            { "bufferView": 3, "componentType": UNSIGNED_INT, "count": 3 * mesh.triangles.len(), "type": "SCALAR" },
        ],
        "bufferViews": views,
        "buffers": [{ "byteLength": binary.len() }],
    });

    let mut text = document.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut file = b"glTF".to_vec();
    file.extend(2_u32.to_le_bytes());
    file.extend((12 + 8 + text.len() as u32 + 8 + binary.len() as u32).to_le_bytes());
    for (kind, chunk) in [(b"JSON", text), (b"BIN\0", binary)] {
        file.extend((chunk.len() as u32).to_le_bytes());
        file.extend(kind);
        file.extend(chunk);
    }
    file
}

/// Smallest and largest coordinates, as they are stored.
fn bounds(positions: &[DVec3]) -> (Value, Value) {
    let low = positions.iter().fold(DVec3::INFINITY, |a, p| a.min(*p)).as_vec3();
    let high = positions.iter().fold(DVec3::NEG_INFINITY, |a, p| a.max(*p)).as_vec3();
    (json!(low.to_array()), json!(high.to_array()))
}
