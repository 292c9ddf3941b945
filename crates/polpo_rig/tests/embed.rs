//! A rig travels in the glTF of its mesh, and nothing else of that file changes.

mod common;

use common::block;
use glam::{Quat, Vec3};
use polpo_rig::{Influences, MeshHash, Particle, Rig, RigError, embed_rig};
use proptest::prelude::*;
use serde_json::{Value, json};

fn small(mass: f32) -> Rig {
    let particle = Particle { position: Vec3::X, frame: Quat::IDENTITY, radii: Vec3::ONE, mass };
    Rig { mesh_hash: MeshHash(7), particles: vec![particle], skin: vec![Influences::whole(0); 3], ..Rig::default() }
}

/// A `.glb` of a text and of chunks.
fn glb(text: &str, chunks: &[(&[u8; 4], &[u8])]) -> Vec<u8> {
    let mut padded = text.as_bytes().to_vec();
    padded.resize(text.len().next_multiple_of(4), b' ');
    let mut body = Vec::new();
    for (kind, data) in [(b"JSON", &padded[..])].iter().chain(chunks) {
        body.extend((data.len() as u32).to_le_bytes());
        body.extend(*kind);
        body.extend(*data);
    }
    [b"glTF\x02\0\0\0", &(12 + body.len() as u32).to_le_bytes()[..], &body].concat()
}

/// The text of a `.glb`, and what comes after it.
fn opened(glb: &[u8]) -> (&str, &[u8]) {
    let length = u32::from_le_bytes(glb[12..16].try_into().expect("four bytes")) as usize;
    assert_eq!((length % 4, u32::from_le_bytes(glb[8..12].try_into().expect("four bytes")) as usize), (0, glb.len()));
    let (text, rest) = glb[20..].split_at(length);
    (std::str::from_utf8(text).expect("text"), rest)
}

const CHUNKS: [(&[u8; 4], &[u8]); 2] = [(b"BIN\0", &[1, 2, 3, 4, 5, 6, 7, 0]), (b"ODD?", &[9; 12])];

/// Odd spaces, numbers and escapes, all of which stay.
const BEFORE: &str = "{ \"asset\" : {\"version\":\"2.0\"},\n\"scene\":1,\t\"scenes\":[ {}, {\"name\":\"\\u0041\\/b\",\"extras\":{ \"mood\" : 1.50e-0 }} ], \"big\":123456789012345678901234567890 }";

#[test]
fn nothing_else_changes_by_a_byte() {
    let rig = small(2.0);
    let file = embed_rig("a.glb", &glb(BEFORE, &CHUNKS), &rig).expect("a glTF");
    assert_eq!(Rig::from_gltf("a.glb", &file).expect("a glTF"), Some(rig.clone()));
    let (text, rest) = opened(&file);
    assert_eq!(rest, opened(&glb(BEFORE, &CHUNKS)).1);
    let (start, code) = text.split_once("\"polpo_rig\":\"").expect("the key");
    let (code, end) = code.split_once("\",").expect("the end of the code");
    assert_eq!(format!("{start}{end}").trim_end(), BEFORE);
    assert!(code.bytes().all(|b| b.is_ascii_alphanumeric() || b"+/=".contains(&b)));
    // Again is the same; another takes its place; a text is a file as well.
    assert_eq!(embed_rig("a.glb", &file, &rig).expect("a glTF"), file);
    let other = embed_rig("a.glb", &file, &small(3.0)).expect("a glTF");
    assert_eq!(Rig::from_gltf("a.glb", &other).expect("a glTF"), Some(small(3.0)));
    assert_eq!(embed_rig("a.glb", &other, &rig).expect("a glTF"), file);
    let gltf = embed_rig("a.gltf", BEFORE.as_bytes(), &rig).expect("a glTF");
    assert_eq!(String::from_utf8_lossy(&gltf), text.trim_end_matches(' '));
    assert_eq!(Rig::from_gltf("a.gltf", &gltf).expect("a glTF"), Some(rig));
}

#[test]
fn engines_read_it_from_the_extras_alone() {
    let rig = small(2.0);
    let file = embed_rig("a.gltf", BEFORE.as_bytes(), &rig).expect("a glTF");
    let document: Value = serde_json::from_slice(&file).expect("JSON");
    let extras = document["scenes"][1]["extras"].to_string();
    assert_eq!(Rig::from_extras("a.gltf", &extras).expect("extras"), Some(rig));
    for none in ["{}", "3", "null", " [\"polpo_rig\"] ", "{\"rig\":1}"] {
        assert_eq!(Rig::from_extras("x", none).expect("extras"), None, "{none}");
    }
    let says = |extras: &str| Rig::from_extras("x", extras).map_err(|e| e.to_string()).err().unwrap_or_default();
    assert!(says("{").starts_with("x: not a rig: extras: EOF"), "{}", says("{"));
    assert!(says("{\"polpo_rig\":5}").starts_with("x: not a rig: extras, polpo_rig: invalid type"), "{}", says("{\"polpo_rig\":5}"));
    assert_eq!(says("{\"polpo_rig\":\"a*\"}"), "x: not a rig: extras, polpo_rig: Invalid symbol 42, offset 1.");
    assert_eq!(says("{\"polpo_rig\":\"UE9MUE8=\"}"), "x: not a rig: it does not start with POLPORIG");
    assert!(says("{\"polpo_rig\":\"UE9MUE9SSUcHAAAA\"}").contains("version 7"));
}

#[test]
fn a_file_without_a_scene_gets_one() {
    let rig = small(2.0);
    for (text, nodes) in [
        (r#"{"asset":{},"nodes":[{"children":[2]},{},{}]}"#, json!([0, 1])),
        (r#"{"asset":{},"scenes":[],"scene":4,"nodes":[{},{"children":[0]}]}"#, json!([1])),
        (r#"{"asset":{}}"#, Value::Null),
    ] {
        let file = embed_rig("a.gltf", text.as_bytes(), &rig).expect("a glTF");
        let document: Value = serde_json::from_slice(&file).expect("JSON");
        assert_eq!((&document["scene"], &document["scenes"][0]["nodes"]), (&json!(0), &nodes));
        assert_eq!(Rig::from_gltf("a.gltf", &file).expect("a glTF").as_ref(), Some(&rig));
        assert_eq!(Rig::from_gltf("a.gltf", text.as_bytes()).expect("a glTF"), None);
    }
}

#[test]
fn what_cannot_hold_a_rig_is_named() {
    let says = |bytes: &[u8]| embed_rig("x", bytes, &small(1.0)).map_err(|e| e.to_string()).err().unwrap_or_default();
    let whole = glb(BEFORE, &CHUNKS);
    let mut old = whole.clone();
    old[4] = 1;
    let mut other = whole.clone();
    other[16..20].copy_from_slice(b"BIN\0");
    let cases: [(&[u8], &str); 11] = [
        (b"", "EOF"),
        (b"[]", "expected an object"),
        (b"{}", "it has no asset"),
        (b"\xff\xfe", "utf-8"),
        (br#"{"asset":{},"scenes":[{}],"scene":1}"#, "the default scene is 1, of 1"),
        (br#"{"asset":{},"scenes":[{"extras":3}]}"#, "scene 0: its extras: invalid type"),
        (br#"{"asset":{},"nodes":[{"children":[8]}]}"#, "node 8 is not there"),
        (&old, "glTF version 1, only 2 is read"),
        (&other, "its first chunk is not JSON"),
        (&whole[..15], "it ends in its header"),
        (&whole[..whole.len() - 1], "it ends too early"),
    ];
    for (bytes, message) in cases {
        let error = says(bytes);
        assert!(error.starts_with("x: not a glTF to hold a rig: ") && error.contains(message), "{error:?} does not say {message:?}");
    }
    assert!(matches!(embed_rig("x", &whole, &Rig::default()), Err(RigError::Invalid { .. })));
    assert!(matches!(Rig::from_gltf("x", b"OBJ"), Err(RigError::NotAGltf { .. })));
}

/// The mesh beside it is the same to the bit, so the rig still fits it.
#[test]
fn the_rig_fits_the_mesh_it_travels_with() {
    let mesh = block([1, 1, 1], 1, Vec3::ONE);
    let positions: Vec<u8> = mesh.positions.iter().flat_map(|p| p.to_array()).flat_map(f32::to_le_bytes).collect();
    let indices: Vec<u8> = mesh.triangles.iter().flatten().flat_map(|v| v.to_le_bytes()).collect();
    let text = json!({
        "asset": { "version": "2.0" },
        "nodes": [{ "mesh": 0 }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "indices": 1 }] }],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": 8, "type": "VEC3" },
            { "bufferView": 1, "componentType": 5125, "count": 36, "type": "SCALAR" },
        ],
        "bufferViews": [{ "buffer": 0, "byteLength": 96 }, { "buffer": 0, "byteOffset": 96, "byteLength": 144 }],
        "buffers": [{ "byteLength": 240 }],
    });
    let file = glb(&text.to_string(), &[(b"BIN\0", &[positions, indices].concat())]);
    let rig = common::rig(&polpo_rig::parse_glb("box", &file).expect("a mesh"), 4);
    let both = embed_rig("box", &file, &rig).expect("a glTF");
    let mesh = polpo_rig::parse_glb("box", &both).expect("a mesh");
    let travelled = Rig::from_gltf("box", &both).expect("a glTF").expect("a rig");
    assert_eq!(travelled, rig);
    travelled.check_mesh(&mesh).expect("its mesh");
}

/// Documents of all shapes that a scene's extras can have.
fn document() -> impl Strategy<Value = Value> {
    let extras = prop_oneof![
        Just(None),
        Just(Some(Value::Null)),
        Just(Some(json!({}))),
        Just(Some(json!({ "a": [1, { "polpo_rig": 2 }], "z": "\u{1F419} \"\\" }))),
        Just(Some(json!({ "polpo_rig": "old", "z": 0.1 }))),
    ];
    let scene = (extras, any::<bool>()).prop_map(|(extras, named)| {
        let mut scene = if named { json!({ "name": "s", "nodes": [0] }) } else { json!({}) };
        if let Some(extras) = extras {
            scene["extras"] = extras;
        }
        scene
    });
    (proptest::collection::vec(scene, 0..4), any::<Option<u8>>()).prop_map(|(scenes, default)| {
        let mut document = json!({ "asset": { "version": "2.0" }, "nodes": [{ "name": "n" }], "extras": { "polpo_rig": "not here" } });
        if let (Some(default), false) = (default, scenes.is_empty()) {
            document["scene"] = json!(usize::from(default) % scenes.len());
        }
        document["scenes"] = json!(scenes);
        document
    })
}

proptest! {
    #[test]
    fn any_document_takes_a_rig(document in document(), pretty: bool, binary: bool) {
        let rig = small(2.0);
        let text = if pretty { serde_json::to_string_pretty(&document) } else { serde_json::to_string(&document) }.expect("text");
        let file = if binary { glb(&text, &CHUNKS) } else { text.clone().into_bytes() };
        let with = embed_rig("x", &file, &rig).expect("a glTF");
        prop_assert_eq!(&Rig::from_gltf("x", &with).expect("a glTF"), &Some(rig.clone()));
        prop_assert_eq!(&embed_rig("x", &with, &rig).expect("a glTF"), &with);
        let now = if binary { opened(&with).0 } else { std::str::from_utf8(&with).expect("text") };
        if binary {
            prop_assert_eq!(opened(&with).1, opened(&file).1);
        }
        // All but the rig is as it was.
        let mut now: Value = serde_json::from_str(now).expect("JSON");
        let mut before = document;
        let index = before.get("scene").and_then(Value::as_u64).unwrap_or(0) as usize;
        if before["scenes"] == json!([]) {
            before["scenes"] = json!([{ "nodes": [0], "extras": {} }]);
            before["scene"] = json!(0);
        }
        for document in [&mut now, &mut before] {
            let scene = &mut document["scenes"][index];
            if scene.get("extras").is_none_or(Value::is_null) {
                scene["extras"] = json!({});
            }
            scene["extras"].as_object_mut().expect("an object").remove("polpo_rig");
        }
        prop_assert_eq!(now, before);
    }

    #[test]
    fn mangled_files_never_panic(
        binary: bool,
        full: bool,
        changes in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>(), 0..3), 0..6),
        end: prop::sample::Index,
    ) {
        let file = if binary { glb(BEFORE, &CHUNKS) } else { BEFORE.as_bytes().to_vec() };
        let mut file = if full { embed_rig("x", &file, &small(1.0)).expect("a glTF") } else { file };
        for (at, byte, kind) in changes {
            let at = at.index(file.len());
            match kind {
                0 => file[at] = byte,
                1 => file[at] = b"{}[]\",:0n"[usize::from(byte) % 9],
                _ => file.truncate(file.len() - end.index(file.len()) / 8),
            }
        }
        drop(Rig::from_gltf("x", &file));
        drop(Rig::from_extras("x", &String::from_utf8_lossy(&file)));
        if let Ok(with) = embed_rig("x", &file, &small(1.0)) {
            prop_assert_eq!(Rig::from_gltf("x", &with).expect("what was written"), Some(small(1.0)));
        }
    }
}
