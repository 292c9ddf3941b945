use std::fs;

use glam::{Vec2, Vec3};
use polpo_rig::{MeshError, parse_glb, read_mesh};

use crate::seeds::{all, corners, data_uri, floats, glb, nodes_bytes, nodes_json, triangles};
use crate::{part, read, refused, volume};

#[test]
fn nodes_come_in_order_with_their_transforms() {
    let mesh = read("nodes.glb", glb(&nodes_json(4), &nodes_bytes()));
    assert_eq!((mesh.positions.len(), mesh.triangles.len()), (16, 24));
    for (v, &p) in corners().iter().enumerate() {
        assert_eq!(mesh.positions[v], p + Vec3::X * 10.0);
        assert_eq!(mesh.positions[8 + v], p * Vec3::new(-2.0, 1.0, 1.0) + Vec3::X * 10.0);
    }
    // Both enclose a positive volume: the mirrored one is turned back.
    assert!((volume(&mesh, 0..12) - 1.0).abs() < 1e-4 && (volume(&mesh, 12..24) - 2.0).abs() < 1e-4);
    // The computed normals point away from the middle.
    for (p, n) in mesh.positions[8..].iter().zip(&mesh.normals[8..]) {
        assert!(n.dot(*p - Vec3::new(9.0, 0.5, 0.5)) > 0.5, "{p} {n}");
    }
    assert_eq!(mesh.parts, [part("", "", "", 0..8, 0..12), part("child", "", "", 8..16, 12..24)]);
}

#[test]
fn far_nodes_add_up_before_they_are_rounded() {
    let json = nodes_json(4).replace("[10,0,0]", "[100000000.5,0,0]").replace("\"scale\":[-2,1,1]", "\"translation\":[-100000000,0,0]");
    assert_eq!(read("far.glb", glb(&json, &nodes_bytes())).positions[8], Vec3::X * 0.5);
}

#[test]
fn attributes_names_and_sparse_elements_are_read() {
    let (_, file) = &all()[0];
    let mesh = read("cube.glb", file);
    assert_eq!(mesh.positions[..7], corners()[..7]);
    assert_eq!(mesh.positions[7], Vec3::splat(2.0), "the sparse one");
    assert_eq!(mesh.triangles, triangles());
    assert_eq!(mesh.normals[0], (Vec3::ZERO - 0.5).normalize());
    assert_eq!(mesh.colors[1], [1.0 / 255.0, 254.0 / 255.0, 7.0 / 255.0, 1.0]);
    assert_eq!(mesh.uvs[1], Vec2::X);
    assert_eq!(mesh.parts, [part("cube", "box", "skin", 0..8, 0..12)]);
}

#[test]
fn quantised_normals_are_unit_vectors() {
    let json = nodes_json(4)
        // No transform, which would make them unit vectors anyway.
        .replace("\"translation\":[10,0,0]", "\"name\":\"\"")
        .replace("\"scale\":[-2,1,1],", "")
        .replace("\"POSITION\":0", "\"POSITION\":0,\"NORMAL\":2")
        .replace(
            "],\n        \"bufferViews\"",
            ",{\"bufferView\":0,\"componentType\":5120,\"count\":8,\"type\":\"VEC3\"}],\n\"bufferViews\"",
        );
    let mesh = read("quantised.glb", glb(&json, &[&[100_u8; 24][..], &nodes_bytes()[24..]].concat()));
    assert!(mesh.normals.iter().all(|n| n.is_normalized()), "{:?}", mesh.normals);
}

#[test]
fn an_accessor_without_bytes_is_nought() {
    let sparse = r#"{"componentType":5126,"count":5,"type":"VEC3","sparse":{"count":2,
        "indices":{"bufferView":1,"componentType":5123},"values":{"bufferView":0}}}"#;
    let json = |accessor: &str| {
        format!(
            r#"{{"nodes":[{{"mesh":0}}],"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"mode":5}}]}}],"accessors":[{accessor}],
            "bufferViews":[{{"buffer":0,"byteLength":24}},{{"buffer":0,"byteOffset":24,"byteLength":4}}],"buffers":[{{"byteLength":28}}]}}"#
        )
    };
    let bytes = [floats([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]), vec![1, 0, 4, 0]].concat();
    let mesh = read("sparse.glb", glb(&json(sparse), &bytes));
    assert_eq!(mesh.positions, [Vec3::ZERO, Vec3::new(1.0, 2.0, 3.0), Vec3::ZERO, Vec3::ZERO, Vec3::new(4.0, 5.0, 6.0)]);
    let far = [&bytes[..26], &[5, 0][..]].concat();
    assert!(refused("s.glb", glb(&json(sparse), &far)).contains("POSITION: sparse: element 5 is beyond the 5"));
    let zeros = json(r#"{"componentType":5126,"count":5,"type":"VEC3"}"#);
    assert_eq!(refused("s.glb", glb(&zeros, &bytes)), "the mesh has no extent, all its vertices lie in one point");
}

#[test]
fn strips_and_fans_turn_as_their_first_triangle() {
    let file = |mode: u32, count: usize| {
        let json = nodes_json(mode).replace("\"count\":36", &format!("\"count\":{count}"));
        let mut bytes = nodes_bytes();
        bytes[96..106].copy_from_slice(&[0, 0, 1, 0, 2, 0, 3, 0, 5, 0]);
        glb(&json, &bytes)
    };
    assert_eq!(read("strip.glb", file(5, 5)).triangles[..3], [[0, 1, 2], [1, 3, 2], [2, 3, 5]]);
    assert_eq!(read("fan.glb", file(6, 5)).triangles[..3], [[1, 2, 0], [2, 3, 0], [3, 5, 0]]);
    assert!(refused("list.glb", file(4, 5)).ends_with("5 indices don't make triangles"));
    assert!(refused("mode.glb", file(7, 5)).ends_with("mode 7 is unknown"));
}

#[test]
fn lines_are_left_out_unless_there_is_nothing_else() {
    let error = parse_glb("lines", &glb(&nodes_json(1), &nodes_bytes()));
    assert!(matches!(error, Err(MeshError::NoSurface { mesh: 0, primitive: 0, mode: "Lines", .. })), "{error:?}");
    let both = nodes_json(4).replace("\"primitives\":[", "\"primitives\":[{\"attributes\":{\"POSITION\":0},\"mode\":0},");
    let mesh = read("both.glb", glb(&both, &nodes_bytes()));
    assert_eq!((mesh.parts.len(), mesh.triangles.len()), (2, 24));
}

#[test]
fn buffers_come_from_data_uris_and_files() {
    let folder = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("gltf/below");
    fs::create_dir_all(&folder).expect("the target folder can be written");
    fs::write(folder.join("the box.bin"), nodes_bytes()).expect("written");
    fs::write(folder.join("../above.bin"), nodes_bytes()).expect("written");
    let expected = read("whole.glb", glb(&nodes_json(4), &nodes_bytes()));
    let with = |uri: &str| nodes_json(4).replace("\"buffers\":[{", &format!("\"buffers\":[{{\"uri\":\"{uri}\","));
    for uri in [&data_uri(&nodes_bytes()), "the%20box.bin", "./the box.bin", "../above.bin"] {
        fs::write(folder.join("box.gltf"), with(uri)).expect("written");
        let mesh = read_mesh(&folder.join("box.gltf")).expect("a mesh");
        assert_eq!(mesh.hash(), expected.hash());
        // Without its folder there are only data URIs.
        assert_eq!(parse_glb("lost", with(uri).as_bytes()).is_ok(), uri.starts_with("data:"));
    }
    for (uri, message) in [
        ("/etc/hostname", "a path from the root"),
        ("%2Fetc/hostname", "a path from the root"),
        ("\\\\\\\\server\\\\file", "a path from the root"),
        ("file:///etc/hostname", "nothing by \"file\""),
        ("https://example.org/box.bin", "nothing by \"https\""),
        ("C:/box.bin", "nothing by \"C\""),
        ("../below", "is not a file"),
        ("../../../../../../../../../../../../../../../../dev/zero", "is not a file"),
        ("gone.bin", "gone.bin: "),
        ("%FF", "utf-8"),
        ("data:text/plain,hello", "a data URI that is not base64"),
        ("data:;base64,A*", "its data URI is not base64"),
        ("data:;base64,AAAA", "3 bytes where 168 should be"),
    ] {
        fs::write(folder.join("bad.gltf"), with(uri)).expect("written");
        let error = read_mesh(&folder.join("bad.gltf")).map_err(|e| e.to_string()).err().unwrap_or_default();
        assert!(error.contains("buffer 0: ") && error.contains(message), "{error:?} does not say {message:?}");
    }
}

#[test]
fn faults_are_named() {
    let with = |from: &str, to: &str| {
        let json = nodes_json(4).replacen(from, to, 1);
        assert_ne!(json, nodes_json(4));
        refused("x.glb", glb(&json, &nodes_bytes()))
    };
    for (from, to, message) in [
        ("\"children\":[1]", "\"children\":[7]", "node 0 has child 7, which is not there"),
        ("\"children\":[1]", "\"children\":[1,1]", "node 1 has two parents"),
        ("\"scale\"", "\"children\":[0],\"scale\"", "node 0 is its own ancestor"),
        ("\"translation\":[10,0,0]", "\"rotation\":[0,0,0,0]", "the rotation of node 0 is no quaternion"),
        ("\"mesh\":0", "\"mesh\":3", "node 0 shows mesh 3, which is not there"),
        ("\"indices\":1", "\"indices\":9", "mesh 0, primitive 0: indices: accessor 9 is not there"),
        ("\"indices\":1", "\"indices\":1,\"material\":2", "mesh 0, primitive 0: material 2 is not there"),
        ("\"POSITION\":0", "\"POSITION\":0,\"NORMAL\":1", "36 entries in NORMAL, but 8 vertices"),
        ("\"count\":8", "\"count\":7", "index 8 points to vertex 7, but there are 7"),
        ("\"count\":8", "\"count\":9", "POSITION: the accessor reaches beyond its buffer view"),
        ("\"VEC3\"", "\"VEC2\"", "POSITION: VEC2 where a vector of 3 should be"),
        ("\"byteOffset\":0,", "\"byteStride\":4,", "POSITION: the buffer view steps 4 bytes, but an element has 12"),
        ("\"byteLength\":168", "\"byteLength\":169", "buffer 0: 168 bytes where 169 should be"),
        ("\"scene\":0", "\"extensionsRequired\":[\"EXT_meshopt_compression\"]", "it requires the extension EXT_meshopt_compression"),
        ("[10,0,0]", "[1e39,0,0]", "position 0 is not finite"),
    ] {
        let error = with(from, to);
        assert!(error.contains(message), "{error:?} does not say {message:?}");
    }
    let mut bytes = nodes_bytes();
    bytes[12..16].copy_from_slice(&f32::NAN.to_le_bytes());
    assert_eq!(refused("x.glb", glb(&nodes_json(4), &bytes)), "position 1 is not finite");
}
