use glam::{Vec2, Vec3};

use crate::seeds::{corners, ply};
use crate::{part, read, refused, volume};

#[test]
fn text_and_both_binaries_say_the_same() {
    for format in ["ascii", "binary_little_endian", "binary_big_endian"] {
        let mesh = read("cube.ply", ply(format));
        assert_eq!(mesh.positions, corners());
        // Five quads, and a strip for the sixth side; after -1 another begins.
        assert_eq!(mesh.triangles[10..], [[1, 3, 5], [3, 7, 5], [0, 1, 2]]);
        assert!((volume(&mesh, 0..12) - 1.0).abs() < 1e-6);
        assert_eq!(mesh.normals, [Vec3::Z; 8], "those of the file");
        // 55 of 255 in sRGB.
        let [red, green, blue, alpha] = mesh.colors[3];
        assert!(red == 1.0 && green == 0.0 && alpha == 1.0 && (blue - 0.038_204).abs() < 1e-5, "{:?}", mesh.colors[3]);
        assert_eq!(mesh.parts, [part("", "", "", 0..8, 0..13)]);
    }
}

const SQUARE: &str = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float32 x\nproperty float32 y\nproperty float32 z\n\
    property float red\nproperty float green\nproperty float blue\nproperty float s\nproperty float t\n\
    element face 1\nproperty list uint8 int32 vertex_index\nend_header\n\
    0 0 0 0.5 0 0 0 0\n1 0 0 0.5 0 0 1 0\n0.2 0.2 0 0.5 0 0 1 1\n0 1 0 0.5 0 0 0 1\n4 0 1 2 3\n";

#[test]
fn floats_are_linear_and_normals_computed() {
    for text in [SQUARE.to_owned(), SQUARE.replace('\n', "\r\n")] {
        let mesh = read("square.ply", text);
        assert_eq!(mesh.colors[0], [0.5, 0.0, 0.0, 1.0]);
        assert_eq!(mesh.uvs[2], Vec2::ONE);
        assert_eq!(mesh.normals, [Vec3::Z; 4]);
        assert_eq!(mesh.triangles, [[0, 1, 2], [3, 0, 2]], "concave at corner 2");
    }
}

#[test]
fn lists_may_be_of_any_integer() {
    for (length, kind) in
        [("char", "char"), ("uchar", "short"), ("short", "ushort"), ("int", "uint"), ("uint32", "uint8"), ("int8", "int16")]
    {
        let text = SQUARE.replace("list uint8 int32", &format!("list {length} {kind}"));
        assert_eq!(read("square.ply", text).triangles.len(), 2);
    }
    assert!(refused("x.ply", SQUARE.replace("uint8 int32", "uint8 float")).ends_with("no list vertex_indices of integers"));
}

#[test]
fn comments_may_be_in_old_encodings() {
    let bytes = SQUARE.replace("1.0\n", "1.0\ncomment M?\n").replace('?', "\u{1}").into_bytes();
    let bytes: Vec<u8> = bytes.into_iter().map(|b| if b == 1 { 0xfc } else { b }).collect();
    assert_eq!(read("old.ply", bytes).triangles.len(), 2);
}

#[test]
fn faults_are_named() {
    let cloud: String = SQUARE.replace("element face 1\nproperty list uint8 int32 vertex_index\n", "");
    for (text, message) in [
        (SQUARE.replace("4 0 1 2 3", "4 0 1 2 9"), "face 0 of 1: vertex 9 is not among the 4 read so far"),
        (SQUARE.replace("4 0 1 2 3", "4 0 1 2 -1"), "face 0 of 1: vertex -1 is not among the 4 read so far"),
        (SQUARE.replace("4 0 1 2 3", "4 0 1 2"), "face 0 of 1: Expected 4 list elements, but found only 3"),
        (SQUARE.replace("4 0 1 2 3\n", ""), "face 0 of 1: the file ends"),
        (SQUARE.replace("vertex 4", "vertex 4000000000"), "vertex 4 of 4000000000: "),
        (SQUARE.replace("1 0 0 0.5", "1 0 1e39 0.5"), "vertex 1 of 4: position [1, 0, inf] is not finite"),
        (SQUARE.replace("1 0 0 0.5", "1 0 nan 0.5"), "vertex 1 of 4: "),
        (SQUARE.replace("float32 z", "float32 w"), "its vertices have no x, y and z"),
        (SQUARE.replace("end_header", "end"), "it has no end_header"),
        (SQUARE.replace("1.0", "9"), "Line 2: "),
        (cloud, "the mesh has no triangles"),
        ("solid".into(), "it has no end_header"),
    ] {
        let error = refused("x.ply", text);
        assert!(error.contains(message), "{error:?} does not say {message:?}");
    }
    let short = ply("binary_big_endian");
    assert!(refused("x.ply", &short[..short.len() - 4]).contains("tristrips 0 of 1: "));
}
