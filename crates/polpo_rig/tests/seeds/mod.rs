//! Small files of every format, each with most of what the format knows.
#![allow(dead_code, reason = "every test file uses a part of it")]
#![allow(unreachable_pub, reason = "shared by the test files, which have no library of their own")]

use glam::{Quat, Vec3};
use polpo_rig::{Influences, MeshHash, Particle, Region, Rig};

/// The corners of a unit cube, x fastest.
pub fn corners() -> Vec<Vec3> {
    (0..8).map(|i| Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32)).collect()
}

/// Its sides, outwards.
pub const SIDES: [[u32; 4]; 6] = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];

pub fn triangles() -> Vec<[u32; 3]> {
    SIDES.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect()
}

/// Every seed with a name that tells its format.
pub fn all() -> Vec<(&'static str, Vec<u8>)> {
    vec![
        ("cube.glb", glb(&cube_json(), &cube_bytes())),
        ("nodes.glb", glb(&nodes_json(4), &nodes_bytes())),
        ("uri.gltf", cube_json().replace("\"byteLength\":", &format!("\"uri\":\"{}\",\"byteLength\":", data_uri(&cube_bytes()))).into()),
        ("cube.obj", OBJ.into()),
        ("binary.stl", stl_binary("solid cube")),
        ("text.stl", stl_text().into()),
        ("text.ply", ply("ascii")),
        ("little.ply", ply("binary_little_endian")),
        ("big.ply", ply("binary_big_endian")),
        ("rig.ron", rig().to_ron().expect("a whole rig").into()),
        ("rig.rig", rig().to_postcard().expect("a whole rig")),
    ]
}

/// A `.glb` of a document and its binary chunk.
pub fn glb(json: &str, binary: &[u8]) -> Vec<u8> {
    let mut text = json.as_bytes().to_vec();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut file = b"glTF".to_vec();
    file.extend(2_u32.to_le_bytes());
    file.extend((28 + text.len() as u32 + binary.len() as u32).to_le_bytes());
    for (kind, chunk) in [(b"JSON", &text[..]), (b"BIN\0", binary)] {
        file.extend((chunk.len() as u32).to_le_bytes());
        file.extend(kind);
        file.extend(chunk);
    }
    file
}

pub fn floats(values: impl IntoIterator<Item = f32>) -> Vec<u8> {
    values.into_iter().flat_map(f32::to_le_bytes).collect()
}

/// Positions, normals, colours in bytes, texture coordinates, indices; a sparse list that moves vertex 7 to (2, 2, 2).
fn cube_bytes() -> Vec<u8> {
    let mut bytes = floats(corners().iter().flat_map(|p| p.to_array()));
    bytes.extend(floats(corners().iter().flat_map(|p| (*p - 0.5).normalize().to_array())));
    bytes.extend((0..8_u8).flat_map(|i| [i, 255 - i, 7, 255]));
    bytes.extend(floats(corners().iter().flat_map(|p| [p.x, p.y])));
    bytes.extend(triangles().iter().flatten().map(|&v| v as u8));
    bytes.extend([7, 0, 0, 0]);
    bytes.extend(floats([2.0; 3]));
    bytes
}

fn cube_json() -> String {
    let view = |from: usize, len: usize| format!(r#"{{"buffer":0,"byteOffset":{from},"byteLength":{len}}}"#);
    let views = [view(0, 96), view(96, 96), view(192, 32), view(224, 64), view(288, 36), view(324, 4), view(328, 12)].join(",");
    format!(
        r#"{{"asset":{{"version":"2.0"}},"nodes":[{{"mesh":0,"name":"cube"}}],"materials":[{{"name":"skin"}}],
        "meshes":[{{"name":"box","primitives":[{{"attributes":{{"POSITION":0,"NORMAL":1,"COLOR_0":2,"TEXCOORD_0":3}},"indices":4,"material":0}}]}}],
        "accessors":[{{"bufferView":0,"componentType":5126,"count":8,"type":"VEC3","sparse":{{"count":1,
        "indices":{{"bufferView":5,"componentType":5121}},"values":{{"bufferView":6}}}}}},
        {{"bufferView":1,"componentType":5126,"count":8,"type":"VEC3"}},
        {{"bufferView":2,"componentType":5121,"count":8,"type":"VEC4","normalized":true}},
        {{"bufferView":3,"componentType":5126,"count":8,"type":"VEC2"}},
        {{"bufferView":4,"componentType":5121,"count":36,"type":"SCALAR"}}],
        "bufferViews":[{views}],"buffers":[{{"byteLength":340}}]}}"#
    )
}

/// A glTF with a parent and a child node that both show the cube; the child is mirrored.
pub fn nodes_json(mode: u32) -> String {
    format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],
        "nodes":[{{"mesh":0,"children":[1],"translation":[10,0,0]}},{{"mesh":0,"scale":[-2,1,1],"name":"child"}}],
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"indices":1,"mode":{mode}}}]}}],
        "accessors":[{{"bufferView":0,"componentType":5126,"count":8,"type":"VEC3","min":[0,0,0],"max":[1,1,1]}},
        {{"bufferView":1,"componentType":5123,"count":36,"type":"SCALAR"}}],
        "bufferViews":[{{"buffer":0,"byteOffset":0,"byteLength":96}},
        {{"buffer":0,"byteOffset":96,"byteLength":72}}],"buffers":[{{"byteLength":168}}]}}"#
    )
}

pub fn nodes_bytes() -> Vec<u8> {
    let mut bytes = floats(corners().iter().flat_map(|p| p.to_array()));
    bytes.extend(triangles().iter().flatten().flat_map(|v| (*v as u16).to_le_bytes()));
    bytes
}

pub fn data_uri(bytes: &[u8]) -> String {
    let symbols = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let code = bytes.chunks(3).flat_map(|c| {
        let bits = (0..3).fold(0_usize, |n, i| n << 8 | c.get(i).map_or(0, |&b| b as usize));
        [18, 12, 6, 0].map(|shift| char::from(symbols[bits >> shift & 63])).into_iter().take(c.len() + 1)
    });
    format!("data:application/octet-stream;base64,{}", code.collect::<String>())
}

/// A square and a concave face, in two parts.
pub const OBJ: &str = "# two faces\nv 0 0 0\nv 1 0 0 1 0 0\nv 1 1 0\nv 0 1 0\nv 0.8 0.8 0\nvt 0 0\nvt 1 0\nvn 0 0 2\n\
    o one\ng left right\nusemtl skin\nf 1/1/1 2/2/1 3/1/1 4/2/1\nl 1 2\nusemtl bone\nf -4//1 -3//1 \\\n-2//1 -1//1\n";

pub fn stl_binary(header: &str) -> Vec<u8> {
    let mut bytes = header.as_bytes().to_vec();
    bytes.resize(80, 0);
    bytes.extend(12_u32.to_le_bytes());
    for t in triangles() {
        bytes.extend(floats([0.0; 3]));
        bytes.extend(floats(t.iter().flat_map(|&v| corners()[v as usize].to_array())));
        bytes.extend([0, 0]);
    }
    bytes
}

/// Two solids, a square each.
pub fn stl_text() -> String {
    let mut text = String::new();
    for (side, name) in [(0, "under side"), (1, "top")] {
        text += &format!("solid {name}\n");
        for t in &triangles()[2 * side..2 * side + 2] {
            text += "  facet normal nan 0 0\n    outer loop\n";
            for &v in t {
                let [x, y, z] = corners()[v as usize].to_array();
                text += &format!("      vertex {x:e} {y} {z}\n");
            }
            text += "    endloop\n  endfacet\n";
        }
        text += &format!("endsolid {name}\n");
    }
    text
}

/// The cube with colours, elements and properties that nobody asked for, quads and a strip.
pub fn ply(format: &str) -> Vec<u8> {
    let mut bytes = format!(
        "ply\nformat {format} 1.0\ncomment a cube\nelement camera 1\nproperty float view\nproperty list uchar short marks\n\
        element vertex 8\nproperty float x\nproperty double y\nproperty float z\nproperty int id\nproperty uchar red\n\
        property uchar green\nproperty uchar blue\nproperty float nx\nproperty float ny\nproperty float nz\n\
        element face 5\nproperty list uchar uint vertex_indices\nproperty uchar flag\n\
        element tristrips 1\nproperty list int int vertex_indices\nend_header\n"
    )
    .into_bytes();
    let mut line = |values: &[(char, f64)]| {
        if format == "ascii" {
            let words: Vec<String> = values.iter().map(|(_, x)| x.to_string()).collect();
            bytes.extend((words.join(" ") + "\n").into_bytes());
            return;
        }
        for &(kind, x) in values {
            let mut value = match kind {
                'f' => (x as f32).to_le_bytes().to_vec(),
                'd' => x.to_le_bytes().to_vec(),
                'c' => vec![x as u8],
                's' => (x as i16).to_le_bytes().to_vec(),
                _ => (x as i32).to_le_bytes().to_vec(),
            };
            if format == "binary_big_endian" {
                value.reverse();
            }
            bytes.extend(value);
        }
    };
    line(&[('f', 0.5), ('c', 2.0), ('s', 300.0), ('s', -1.0)]);
    for (i, p) in corners().iter().enumerate() {
        let [x, y, z] = p.to_array().map(f64::from);
        let [r, g, b] = [255.0, 0.0, 55.0];
        line(&[('f', x), ('d', y), ('f', z), ('i', i as f64), ('c', r), ('c', g), ('c', b), ('f', 0.0), ('f', 0.0), ('f', 1.0)]);
    }
    for side in &SIDES[..5] {
        let [a, b, c, d] = side.map(f64::from);
        line(&[('c', 4.0), ('u', a), ('u', b), ('u', c), ('u', d), ('c', 9.0)]);
    }
    line(&[('i', 8.0), ('i', 1.0), ('i', 3.0), ('i', 5.0), ('i', 7.0), ('i', -1.0), ('i', 0.0), ('i', 1.0), ('i', 2.0)]);
    bytes
}

/// Three particles in a row, four vertices.
pub fn rig() -> Rig {
    let particle = |x: f32| Particle { position: Vec3::X * x, frame: Quat::IDENTITY, radii: Vec3::splat(0.5), mass: 1.0 };
    Rig {
        mesh_hash: MeshHash(7),
        particles: [0.0, 1.0, 2.0].map(particle).to_vec(),
        edges: vec![[0, 1], [1, 2]],
        skin: vec![Influences::new(&[(0, 0.5), (1, 0.25), (2, 0.25)]); 4],
        regions: vec![Region { name: "tail".into(), particles: vec![1, 2], friction: Some(0.5), ..Region::default() }],
        cells: None,
    }
}
