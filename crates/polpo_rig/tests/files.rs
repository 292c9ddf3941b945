//! Rig files give back what was written; whatever else they hold is an error, never a panic. So for mesh files.

mod common;

use std::fs;

use common::{block, moved, rig, two_fingers};
use glam::{Quat, Vec3};
use polpo_rig::{Mesh, MeshError, Rig, RigError, parse_glb, read_mesh};

/// A folder of the test's own.
fn folder(name: &str) -> std::path::PathBuf {
    let folder = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    fs::create_dir_all(&folder).expect("the target folder can be written");
    folder
}

fn small() -> Rig {
    rig(&block([2, 1, 1], 1, Vec3::new(2.0, 1.0, 1.0)), 6)
}

#[test]
fn both_formats_give_back_every_bit() {
    let rig = rig(&two_fingers(0.1), 30);
    let text = rig.to_ron().expect("a whole rig");
    assert_eq!(Rig::from_ron("text", &text).expect("its own text"), rig);
    let bytes = rig.to_postcard().expect("a whole rig");
    assert_eq!(Rig::from_postcard("bytes", &bytes).expect("its own bytes"), rig);
    for name in ["roundtrip.ron", "roundtrip.rig"] {
        let path = folder("roundtrip").join(name);
        rig.write(&path).expect("written");
        assert_eq!(Rig::read(&path).expect("read"), rig);
    }
}

#[test]
fn a_rig_of_another_mesh_is_refused() {
    let mesh = block([1, 1, 1], 2, Vec3::ONE);
    let rig = rig(&mesh, 5);
    assert!(rig.check_mesh(&mesh).is_ok());
    let other = moved(mesh.clone(), Vec3::X * 1e-3);
    assert!(matches!(rig.check_mesh(&other), Err(RigError::MeshHash { .. })));
    let more = Mesh { positions: vec![Vec3::ZERO; 99], ..mesh };
    assert!(matches!(rig.check_mesh(&more), Err(RigError::VertexCount { found: 99, .. })));
}

#[test]
fn other_versions_and_other_files_are_refused() {
    let text = small().to_ron().expect("a whole rig");
    let newer = text.replacen("version: 2", "version: 3", 1);
    assert!(matches!(Rig::from_ron("x", &newer), Err(RigError::Version { found: 3, expected: 2, .. })));
    let mut bytes = small().to_postcard().expect("a whole rig");
    bytes[8] = 7;
    assert!(matches!(Rig::from_postcard("x", &bytes), Err(RigError::Version { found: 7, expected: 2, .. })));
    assert!(matches!(Rig::from_postcard("x", b"GIF89a"), Err(RigError::NotARig { .. })));
    assert!(matches!(Rig::read("body.txt"), Err(RigError::UnknownExtension { .. })));
    assert!(matches!(Rig::read("no/such.rig"), Err(RigError::Io { .. })));
}

/// What the errors say to somebody who has only the file.
#[test]
fn what_does_not_fit_is_told() {
    let says = |rig: Result<Rig, RigError>| rig.map_err(|e| e.to_string()).err().unwrap_or_default();
    let text = small().to_ron().expect("a whole rig");
    let bytes = small().to_postcard().expect("a whole rig");
    let version = |version: u8| {
        let mut bytes = bytes.clone();
        bytes[8] = version;
        bytes
    };
    let older = "a.rig: rig format version 1, this library reads version 2: rig the mesh anew";
    let newer = "a.rig: rig format version 3, this library reads version 2: it was made by a newer one";
    assert_eq!(says(Rig::from_postcard("a.rig", &version(1))), older);
    assert_eq!(says(Rig::from_postcard("a.rig", &version(3))), newer);
    // Whatever else an older text holds.
    assert_eq!(says(Rig::from_ron("a.rig", "(version: 1, rig: (colour: Red, springs: [(1, \"x\")]))")), older);
    assert_eq!(says(Rig::from_postcard("a.rig", &bytes[..11])), "a.rig: not a rig: it ends in its version");
    assert_eq!(says(Rig::from_postcard("a.rig", &bytes[..bytes.len() - 1])), "a.rig: not a rig: it ends too early");
    let longer = [&bytes[..], b"ab"].concat();
    assert_eq!(says(Rig::from_postcard("a.rig", &longer)), "a.rig: not a rig: 2 bytes are left over at its end");
    for end in (20..text.len() - 2).step_by(97) {
        let error = says(Rig::from_ron("a.ron", &text[..end]));
        assert!(error.starts_with("a.ron: not a rig: "), "{end}: {error}");
    }
    assert!(says(Rig::from_ron("a.ron", &format!("{text}x"))).starts_with("a.ron: not a rig: "));
}

/// Lists that say they hold 2⁴⁰ items, and brackets in brackets: neither memory nor stack is spent on them.
#[test]
fn what_a_file_announces_is_not_believed() {
    let most = [0x80, 0x80, 0x80, 0x80, 0x80, 0x20];
    let start = [b"POLPORIG".as_slice(), &[2, 0, 0, 0, 9]].concat();
    // Particles, edges, skin, regions; a name in a region; volumes of cells.
    for before in [&[][..], &[0], &[0, 0], &[0, 0, 0], &[0, 0, 0, 1], &[0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]] {
        for tail in [0, 64] {
            let bytes = [&start, before, &most[..], &vec![0; tail]].concat();
            assert!(matches!(Rig::from_postcard("huge", &bytes), Err(RigError::NotARig { .. })), "{before:?}");
        }
    }
    for deep in ["(", "[", "Some(", "{a:"] {
        for text in [deep.repeat(100_000), format!("(version: 2, rig: {}", deep.repeat(100_000))] {
            assert!(matches!(Rig::from_ron("deep", &text), Err(RigError::NotARig { .. })));
        }
    }
}

#[test]
fn a_broken_rig_is_neither_written_nor_read() {
    let mut broken = small();
    broken.edges[0] = [0, 99];
    assert!(matches!(broken.to_ron(), Err(RigError::Invalid { .. })));
    assert!(matches!(broken.to_postcard(), Err(RigError::Invalid { .. })));
    let text = small().to_ron().expect("a whole rig");
    let far = text.replacen("edges: [\n      (0,", "edges: [\n      (77,", 1);
    assert_ne!(far, text);
    let error = Rig::from_ron("far.ron", &far).map_err(|e| e.to_string());
    assert_eq!(error.err().as_deref(), Some("far.ron: edge 0 points to particle 77, but there are 6"));
}

/// Every prefix, and bytes changed at pseudo-random places: reading must return, with whatever result.
fn mangle(bytes: &[u8], mut read: impl FnMut(&[u8])) {
    let step = (bytes.len() / 300).max(1);
    for end in (0..bytes.len()).step_by(step) {
        read(&bytes[..end]);
    }
    let mut state = 0x2545_f491_4f6c_dd1d_u64;
    let mut random = |below: usize| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state % below.max(1) as u64) as usize
    };
    for round in 0..1500 {
        let mut mangled = bytes.to_vec();
        for _ in 0..=round % 4 {
            let at = random(mangled.len());
            match random(4) {
                0 => mangled[at] = random(256) as u8,
                1 => mangled[at] ^= 1 << random(8),
                // Digits become other digits: text stays text, and counts and indices go wild.
                2 => mangled[at] = b'0' + random(10) as u8,
                _ => {
                    let end = (at + random(16)).min(mangled.len());
                    mangled.drain(at..end);
                }
            }
            if mangled.is_empty() {
                break;
            }
        }
        read(&mangled);
    }
}

#[test]
fn mangled_rigs_never_panic() {
    let rig = small();
    let bytes = rig.to_postcard().expect("a whole rig");
    mangle(&bytes, |b| drop(Rig::from_postcard("mangled", b)));
    let text = rig.to_ron().expect("a whole rig");
    mangle(text.as_bytes(), |b| drop(Rig::from_ron("mangled", &String::from_utf8_lossy(b))));
}

/// A glTF with a parent and a child node that both show the mesh; the child is mirrored.
fn gltf(mode: u32) -> Vec<u8> {
    let mesh = block([1, 1, 1], 1, Vec3::ONE);
    let mut binary: Vec<u8> = Vec::new();
    binary.extend(mesh.positions.iter().flat_map(|p| p.to_array()).flat_map(f32::to_le_bytes));
    binary.extend(mesh.triangles.iter().flatten().flat_map(|v| (*v as u16).to_le_bytes()));
    let (positions, indices) = (96, 72);
    let mut text = format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],
        "nodes":[{{"mesh":0,"children":[1],"translation":[10,0,0]}},{{"mesh":0,"scale":[-2,1,1]}}],
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"indices":1,"mode":{mode}}}]}}],
        "accessors":[{{"bufferView":0,"componentType":5126,"count":8,"type":"VEC3","min":[0,0,0],"max":[1,1,1]}},
        {{"bufferView":1,"componentType":5123,"count":36,"type":"SCALAR"}}],
        "bufferViews":[{{"buffer":0,"byteOffset":0,"byteLength":{positions}}},
        {{"buffer":0,"byteOffset":{positions},"byteLength":{indices}}}],"buffers":[{{"byteLength":{}}}]}}"#,
        binary.len()
    )
    .into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut file = b"glTF".to_vec();
    file.extend(2_u32.to_le_bytes());
    file.extend((28 + text.len() as u32 + binary.len() as u32).to_le_bytes());
    for (kind, chunk) in [(b"JSON", text), (b"BIN\0", binary)] {
        file.extend((chunk.len() as u32).to_le_bytes());
        file.extend(kind);
        file.extend(chunk);
    }
    file
}

#[test]
fn gltf_nodes_come_in_order_with_their_transforms() {
    let mesh = parse_glb("nodes", &gltf(4)).expect("a mesh");
    assert_eq!((mesh.positions.len(), mesh.triangles.len()), (16, 24));
    let box_mesh = block([1, 1, 1], 1, Vec3::ONE);
    for (v, &p) in box_mesh.positions.iter().enumerate() {
        assert_eq!(mesh.positions[v], p + Vec3::X * 10.0);
        assert_eq!(mesh.positions[8 + v], p * Vec3::new(-2.0, 1.0, 1.0) + Vec3::X * 10.0);
    }
    // Both enclose a positive volume: the mirrored one is turned back.
    for (part, volume) in [(0..12, 1.0), (12..24, 2.0)] {
        let sum: f32 = mesh.triangles[part]
            .iter()
            .map(|t| {
                let [a, b, c] = t.map(|v| mesh.positions[v as usize] - Vec3::X * 10.0);
                a.dot(b.cross(c)) / 6.0
            })
            .sum();
        assert!((sum - volume).abs() < 1e-4, "{sum}");
    }
    // The computed normals point away from the middle.
    for (p, n) in mesh.positions[8..].iter().zip(&mesh.normals[8..]) {
        assert!(n.dot(*p - Vec3::new(9.0, 0.5, 0.5)) > 0.5, "{p} {n}");
    }
}

#[test]
fn gltf_lines_are_refused() {
    let error = parse_glb("lines", &gltf(1));
    assert!(matches!(error, Err(MeshError::UnsupportedMode { mesh: 0, primitive: 0, .. })), "{error:?}");
}

#[test]
fn mangled_gltf_never_panics() {
    mangle(&gltf(4), |b| drop(parse_glb("mangled", b)));
}

#[test]
fn gltf_buffers_come_from_data_uris_and_files() {
    let glb = gltf(4);
    let json = glb[20..].split(|&b| b == 0).next().unwrap_or_default();
    let json = String::from_utf8_lossy(json);
    let json = &json[..json.rfind('}').map_or(0, |end| end + 1)];
    let binary = &glb[glb.len() - 168..];
    let symbols = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let base64: String = binary
        .chunks(3)
        .flat_map(|c| {
            let bits = c.iter().fold(0_usize, |n, &b| n << 8 | b as usize);
            [18, 12, 6, 0].map(|shift| char::from(symbols[bits >> shift & 63]))
        })
        .collect();
    let folder = folder("gltf");
    fs::write(folder.join("the box.bin"), binary).expect("written");
    let expected = parse_glb("whole", &glb).expect("a mesh");
    for uri in [format!("data:application/octet-stream;base64,{base64}"), "the%20box.bin".into()] {
        let text = json.replace("\"buffers\":[{", &format!("\"buffers\":[{{\"uri\":\"{uri}\","));
        fs::write(folder.join("box.gltf"), &text).expect("written");
        let mesh = read_mesh(&folder.join("box.gltf")).expect("a mesh");
        assert_eq!(mesh.hash(), expected.hash());
        // Nor does a text without its folder panic.
        assert_eq!(parse_glb("lost", text.as_bytes()).is_ok(), uri.starts_with("data:"));
    }
}

const OBJ: &str = "# two faces\nv 0 0 0\nv 1 0 0 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvn 0 0 2\n\
    o one\nf 1/1/1 2/2/1 3/1/1 4/2/1\nl 1 2\nf -4//1 -2//1 -1//1\n";

#[test]
fn obj_polygons_become_triangles() {
    let path = folder("obj").join("faces.obj");
    fs::write(&path, OBJ).expect("written");
    let mesh = read_mesh(&path).expect("a mesh");
    // The second face has no texture coordinates, so its corners are vertices of their own.
    assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3], [4, 5, 6]]);
    assert_eq!(mesh.positions[4], Vec3::ZERO);
    assert_eq!(mesh.normals, [Vec3::Z; 7]);
    assert_eq!(mesh.colors[1], [1.0, 0.0, 0.0, 1.0]);
    assert!(mesh.uvs.is_empty(), "not every corner has one");
}

#[test]
fn obj_faults_name_the_line() {
    let path = folder("obj").join("faults.obj");
    let cases = [
        ("v 0 0 0\nf 1 2 3\n", "line 2: vertex 2 is not among the 1 read so far"),
        ("v 0 0\n", "line 1: 2 numbers where 3 should be"),
        ("v 0 0 zero\n", "line 1: \"zero\" is not a number"),
        ("v 0 0 0\nf 1 0 1\n", "line 2: vertex 0 is not among the 1 read so far"),
        ("v 0 0 0\nf 1 9223372036854775807 -9223372036854775808\n", "line 2: vertex 9223372036854775807"),
        ("v 0 0 0\nf 1 1/ /\n", "line 2: corner \"/\" has no vertex"),
    ];
    for (text, message) in cases {
        fs::write(&path, text).expect("written");
        let error = read_mesh(&path).map_err(|e| e.to_string()).err().unwrap_or_default();
        assert!(error.contains(message), "{error:?} does not say {message:?}");
    }
}

#[test]
fn mangled_obj_never_panics() {
    let path = folder("obj").join("mangled.obj");
    mangle(OBJ.as_bytes(), |b| {
        fs::write(&path, b).expect("written");
        drop(read_mesh(&path));
    });
}

#[test]
fn frames_survive_the_text_format() {
    let mut rig = small();
    rig.particles[0].frame = Quat::from_xyzw(0.1, -0.2, 0.3, 0.4).normalize();
    let text = rig.to_ron().expect("a whole rig");
    assert_eq!(Rig::from_ron("text", &text).expect("its own text").particles[0], rig.particles[0]);
}
