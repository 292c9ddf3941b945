use glam::Vec3;

use crate::seeds::{corners, stl_binary, stl_text, triangles};
use crate::{part, read, refused, volume};

#[test]
fn binary_solids_are_read() {
    // A header may begin as a text does.
    for (header, name) in [("solid cube", "cube"), ("made by hand", "made by hand"), ("", "")] {
        let mesh = read("cube.stl", stl_binary(header));
        let expected: Vec<Vec3> = triangles().iter().flatten().map(|&v| corners()[v as usize]).collect();
        assert_eq!(mesh.positions, expected);
        assert!((volume(&mesh, 0..12) - 1.0).abs() < 1e-6);
        assert_eq!(mesh.normals[..3], [Vec3::NEG_Z; 3], "of the triangle; the file says nothing");
        assert_eq!(mesh.parts, [part("", name, "", 0..36, 0..12)]);
    }
}

#[test]
fn text_solids_are_parts() {
    for text in
        [stl_text(), stl_text().replace('\n', "\r\n"), stl_text().to_uppercase().replace("TOP", "top").replace("UNDER SIDE", "under side")]
    {
        let mesh = read("two.stl", text);
        assert_eq!(mesh.parts, [part("", "under side", "", 0..6, 0..2), part("", "top", "", 6..12, 2..4)]);
        assert_eq!((mesh.normals[0], mesh.normals[6]), (Vec3::NEG_Z, Vec3::Z));
        assert_eq!(mesh.positions[0], Vec3::ZERO);
    }
}

#[test]
fn faults_are_named() {
    let mut many = stl_binary("cube");
    many[80..84].fill(255);
    let mut solid = stl_binary("solid cube");
    solid[80] = 13;
    let mut nan = stl_binary("cube");
    nan[96..100].copy_from_slice(&f32::NAN.to_le_bytes());
    for (bytes, message) in [
        (many, "4294967295 triangles announced, but the 600 bytes after the header are 12 and 0 more"),
        (solid, "13 triangles announced, but the 600 bytes after the header are 12 and 0 more"),
        (stl_binary("cube")[..200].to_vec(), "12 triangles announced, but the 116 bytes after the header are 2 and 16 more"),
        (stl_binary("cube")[..80].to_vec(), "neither a text that begins with \"solid\" nor as long as a binary header"),
        (nan, "position 0 is not finite"),
        (stl_text().replace("1e0 0 0", "1e0 0").into(), "line 13: fewer than 3 numbers"),
        (stl_text().replace("1e0 0 0", "1e0 0 nan").into(), "line 13: \"nan\" is not finite"),
        (stl_text().replacen("    endloop\n", "vertex 0 0 0\n", 1).into(), "line 8: a facet of 4 corners"),
        (stl_text().replacen("  endfacet\n", "", 1).into(), "line 8: \"facet\" is out of place"),
        (stl_text().replacen("endsolid", "solid", 1).into(), "line 16: \"solid\" is out of place"),
        (stl_text().trim_end().trim_end_matches("endsolid top").into(), "it ends within the solid \"top\""),
        (b"solid\nendsolid\n".to_vec(), "the mesh is empty"),
    ] {
        let error = refused("x.stl", bytes);
        assert!(error.contains(message), "{error:?} does not say {message:?}");
    }
}
