//! Files that say more than they hold, and files that hold as much of one thing as they can.

use std::time::Instant;

use polpo_rig::{parse_mesh, read_mesh};

use crate::counting::peak;
use crate::seeds::{OBJ, floats, glb, nodes_bytes, nodes_json, ply, stl_binary};

/// Reads it, and gives the error, without its name, and the bytes of memory for each of the file's.
fn read(name: &str, bytes: &[u8]) -> (String, usize) {
    let begin = Instant::now();
    let (result, peak) = peak(|| parse_mesh(name, bytes));
    assert!(begin.elapsed().as_secs() < 20, "{name} takes {:?}", begin.elapsed());
    let error = result.err().map_or("read".into(), |e| e.to_string());
    (error.strip_prefix(&format!("{name}: not a readable mesh: ")).unwrap_or(&error).to_owned(), peak / bytes.len())
}

const TOO_LARGE: &str = "the file grows to over 16 bytes a byte and 64 MiB";

/// A small file must be refused before it takes the memory it asks for.
#[test]
fn counts_without_bytes_are_refused() {
    let with = |from: &str, to: &str| {
        let json = nodes_json(4).replacen(from, to, 1);
        assert_ne!(json, nodes_json(4));
        glb(&json, &nodes_bytes())
    };
    let many = "\"count\":4000000000";
    let zeros = format!("{{\"componentType\":5126,{many},\"type\":\"VEC3\"}},{{\"x\":0,");
    let sparse = format!(
        "{{\"componentType\":5126,{many},\"type\":\"VEC3\",\"sparse\":{{\"count\":1,\"indices\":{{\"bufferView\":0,\"componentType\":5121}},\
         \"values\":{{\"bufferView\":0}}}}}},{{"
    );
    let far = format!(
        "\"sparse\":{{{many},\"indices\":{{\"bufferView\":0,\"componentType\":5121}},\"values\":{{\"bufferView\":0}}}},\"count\":8"
    );
    let line = "\"accessors\":[{";
    let cases = [
        ("zeros.glb", with(line, &format!("\"accessors\":[{zeros}")), "mesh 0, primitive 0: POSITION: 4000000000 vertices, and "),
        ("sparse.glb", with(line, &format!("\"accessors\":[{sparse}")), "mesh 0, primitive 0: POSITION: 4000000000 vertices, and "),
        ("far.glb", with("\"count\":8", &far), "mesh 0, primitive 0: POSITION: sparse: the accessor reaches beyond its buffer view"),
        ("count.glb", with("\"count\":8", many), "mesh 0, primitive 0: POSITION: 4000000000 vertices, and "),
        (
            "wide.glb",
            with("\"count\":8", "\"count\":18446744073709551615"),
            "mesh 0, primitive 0: POSITION: 18446744073709551615 vertices, and ",
        ),
        (
            "indices.glb",
            with("\"bufferView\":1,\"componentType\":5123,\"count\":36", &format!("\"componentType\":5123,{many}")),
            "mesh 0, primitive 0: indices: 4000000000 of them, and ",
        ),
        (
            "view.glb",
            with("\"byteLength\":96", "\"byteLength\":18446744073709551615"),
            "mesh 0, primitive 0: POSITION: the buffer view reaches",
        ),
        ("nested.glb", glb(&format!("{{\"x\":{}", "[".repeat(100_000)), &[]), "EOF while parsing a list"),
        ("nested.gltf", format!("{{\"nodes\":{}", "[{\"children\":".repeat(100_000)).into(), "invalid type"),
        ("count.ply", ply_with("vertex 8", "vertex 4000000000"), "vertex 11 of 4000000000: failed to fill whole buffer"),
        ("list.ply", ply_with("list uchar uint vertex_indices", "list uint uint vertex_indices"), "face 0 of 5: "),
        (
            "empty.ply",
            ply_with("element camera 1\nproperty float view\nproperty list uchar short marks\n", "element camera 4000000000\n"),
            "",
        ),
        ("count.stl", [&stl_binary("")[..80], &[255; 4], &stl_binary("")[84..]].concat(), "4294967295 triangles announced"),
    ];
    for (name, bytes, message) in cases {
        let (error, _) = read(name, &bytes);
        let (_, memory) = peak(|| parse_mesh(name, &bytes));
        assert!(error.starts_with(message), "{name}: {error:?} is not {message:?}");
        assert!(memory < 1 << 20, "{name} takes {memory} bytes");
    }
}

fn ply_with(from: &str, to: &str) -> Vec<u8> {
    let bytes = ply("binary_little_endian");
    let at = bytes.windows(from.len()).position(|w| w == from.as_bytes()).expect("it is there");
    [&bytes[..at], to.as_bytes(), &bytes[at + from.len()..]].concat()
}

/// One thing said hundreds of thousands of times takes a small multiple of the file.
#[test]
fn crowds_take_a_small_multiple_of_their_file() {
    let many = |piece: &str| piece.repeat(1_000_000 / piece.len());
    let json = |lists: String| format!("{{{}\"meshes\":[{{\"primitives\":[]}}]}}", lists).into_bytes();
    let points = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\n";
    let concave = "v 0 0 0\nv 1 0 0\nv 0.2 0.2 0\nv 0 1 0\n";
    let ply_head = |face: &str| {
        format!(
            "ply\nformat ascii 1.0\nelement vertex 3\nproperty char x\nproperty char y\nproperty char z\n\
             element face 200000\nproperty list uchar {face} vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n"
        )
    };
    let cases: Vec<(&str, Vec<u8>)> = vec![
        ("nodes.gltf", json(format!("\"nodes\":[{}{{}}],", many("{},")))),
        ("shown.gltf", json(format!("\"nodes\":[{}{{}}],", many("{\"mesh\":0},")))),
        ("children.gltf", json(format!("\"nodes\":[{{\"children\":[{}0]}}],", many("1,")))),
        ("materials.gltf", json(format!("\"materials\":[{}{{}}],", many("{},")))),
        ("required.gltf", json(format!("\"extensionsRequired\":[{}\"\"],", many("\"\",")))),
        ("escaped.gltf", json(format!("\"extensionsRequired\":[{}\"\"],", many("\"\\u0020\",")))),
        ("buffers.gltf", json(format!("\"buffers\":[{0}{{\"byteLength\":0}}],", many("{\"byteLength\":0,\"uri\":\"data:;base64,\"},")))),
        ("points.obj", many("v 1 2 3\n").into()),
        ("colours.obj", many("v 1 2 3 4 5 6\n").into()),
        ("corners.obj", format!("{points}f{}\n", many(" 1")).into()),
        ("faces.obj", format!("{points}{}", many("f 1 2 3\n")).into()),
        ("vertices.obj", format!("{points}vn 0 0 1\n{}", many("v 0 0 1\nf -1 -1/1 -1//1\n")).into()),
        ("parts.obj", format!("{points}{}", many("g a\nf 1 2 3\ng\nf 1 2 3\n")).into()),
        ("concave.obj", format!("{concave}{}", many("f 1 2 3 4\n")).into()),
        ("star.obj", format!("{concave}f{}\n", many(" 1 3 2 4")).into()),
        ("going on.obj", many("\\\n").into()),
        ("word.obj", format!("v {}", many("x")).into()),
        ("faces.ply", format!("{}{}", ply_head("char"), many("0\n")).into()),
        ("corners.ply", format!("{}2000 {}", ply_head("int"), many("0 ")).into()),
        ("properties.ply", format!("ply\nformat ascii 1.0\nelement vertex 1\n{}end_header\n0\n", many("property char x\n")).into()),
        (
            "elements.ply",
            format!("ply\nformat ascii 1.0\n{}end_header\n0\n", (0..70_000).map(|i| format!("element e{i} 0\n")).collect::<String>())
                .into(),
        ),
        ("comments.ply", format!("ply\nformat ascii 1.0\n{}end_header\n0\n", many("comment\n")).into()),
        ("solids.stl", many("solid\nendsolid\n").into()),
        ("facets.stl", format!("solid\n{}endsolid", many("vertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendfacet\n")).into()),
        ("corners.stl", format!("solid\n{}endsolid", many("vertex 0 0 0\n")).into()),
    ];
    for (name, bytes) in cases {
        let begin = Instant::now();
        let (error, times) = read(name, &bytes);
        println!("{name}: {times} times its size in {:?}, {error}", begin.elapsed());
        assert!(times < 100, "{name} takes {times} times its size");
    }
}

#[test]
fn a_file_is_read_once_whatever_it_is_called() {
    let folder = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("bombs");
    std::fs::create_dir_all(folder.join("below")).expect("the target folder can be written");
    std::fs::write(folder.join("large.bin"), vec![0; 1 << 20]).expect("written");
    let buffers: Vec<String> = (0..200).map(|i| format!("{{\"byteLength\":9,\"uri\":\"{}large.bin\"}}", "below/../".repeat(i))).collect();
    std::fs::write(folder.join("names.gltf"), format!("{{\"buffers\":[{}]}}", buffers.join(","))).expect("written");
    let (result, memory) = peak(|| read_mesh(&folder.join("names.gltf")));
    assert!(result.is_err_and(|e| e.to_string().ends_with("the mesh is empty, it has no vertices")));
    assert!(memory < 3 << 20, "{memory} bytes");
}

/// What is shown again and again is paid for again and again.
#[test]
fn what_multiplies_is_refused() {
    let nodes = |count: usize, node: &str| format!("\"nodes\":[{}]", vec![node; count].join(","));
    let shown = |node: &str, name: &str| {
        let vertices = floats((0..30_000).map(|i| (i % 7) as f32));
        let json = format!(
            "{{{},\"meshes\":[{{\"name\":\"{name}\",\"primitives\":[{{\"attributes\":{{\"POSITION\":0}}}}]}}],\
             \"accessors\":[{{\"bufferView\":0,\"componentType\":5126,\"count\":9999,\"type\":\"VEC3\"}}],\
             \"bufferViews\":[{{\"buffer\":0,\"byteLength\":120000}}],\"buffers\":[{{\"byteLength\":120000}}]}}",
            nodes(20_000, node)
        );
        glb(&json, &vertices)
    };
    let named = format!("{OBJ}g {}\n{}", "x".repeat(100_000), "usemtl a\nf 1 2 3\nusemtl b\nf 1 2 3\n".repeat(3000));
    let chain: Vec<String> = (0..100_000).map(|i| format!("{{\"children\":[{}]}}", i + 1)).collect();
    for (name, bytes, message) in [
        ("shown.glb", shown("{\"mesh\":0}", ""), TOO_LARGE),
        ("named.glb", shown("{\"mesh\":0}", &"x".repeat(100_000)), TOO_LARGE),
        ("named.obj", named.into(), TOO_LARGE),
        // Deep, but not too deep.
        ("chain.gltf", format!("{{\"nodes\":[{},{{}}]}}", chain.join(",")).into(), "the mesh is empty"),
    ] {
        let begin = Instant::now();
        let (result, memory) = peak(|| parse_mesh(name, &bytes));
        let error = result.map(|_| ()).map_err(|e| e.to_string()).err().unwrap_or_default();
        assert!(error.contains(message), "{name}: {error:?} does not say {message:?}");
        assert!(memory < 128 << 20, "{name} takes {memory} bytes");
        assert!(begin.elapsed().as_secs() < 20, "{name} takes {:?}", begin.elapsed());
    }
}
