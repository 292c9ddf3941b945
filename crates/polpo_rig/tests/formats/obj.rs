use glam::Vec3;

use crate::seeds::OBJ;
use crate::{part, read, refused};

#[test]
fn polygons_become_triangles_and_names_parts() {
    let mesh = read("faces.obj", OBJ);
    // The second face is concave at its last corner. Vertices belong to one part, so its corners are vertices of their own.
    assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3], [7, 4, 5], [6, 7, 5]]);
    assert_eq!(mesh.positions[4..], [Vec3::X, Vec3::new(1.0, 1.0, 0.0), Vec3::Y, Vec3::new(0.8, 0.8, 0.0)]);
    assert_eq!(mesh.normals, [Vec3::Z; 8]);
    assert_eq!((mesh.colors[1], mesh.colors[2]), ([1.0, 0.0, 0.0, 1.0], [1.0; 4]));
    assert!(mesh.uvs.is_empty(), "not every corner has one");
    assert_eq!(mesh.parts, [part("one", "left right", "skin", 0..4, 0..2), part("one", "left right", "bone", 4..8, 2..4)]);
}

#[test]
fn a_part_is_a_run_of_faces() {
    let points = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
    let text = format!("{points}f 1 2 3\nusemtl a\nusemtl b\nf 1 2 3\nusemtl b\nf 3 2 1\ng\no x\no\nusemtl a\nf 1 2 3\nf 1 2\no y\n");
    let mesh = read("runs.obj", text);
    let names: Vec<_> = mesh.parts.iter().map(|p| (&*p.material, p.triangles.clone())).collect();
    assert_eq!(names, [("", 0..1), ("b", 1..3), ("a", 3..4)], "neither names without faces nor those said again");
    assert_eq!(mesh.positions.len(), 9);
}

#[test]
fn computed_normals_do_not_see_parts() {
    let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nusemtl a\nf 1 2 3\nusemtl b\nf 1 4 2\n";
    let mesh = read("fold.obj", text);
    let shared = Vec3::new(0.0, 1.0, 1.0).normalize();
    assert!(mesh.normals[0].distance(shared) < 1e-6 && mesh.normals[3].distance(shared) < 1e-6, "{:?}", mesh.normals);
}

#[test]
fn some_corners_may_have_normals() {
    let mesh = read("some.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 2 0 0\nf 1//1 2 3\n");
    assert_eq!(mesh.normals, [Vec3::X, Vec3::Z, Vec3::Z]);
}

#[test]
fn old_encodings_and_line_ends_are_read() {
    let text = b"# M\xfcller\r\nv 0 0 0\r\nv 1 0 0\r\nv 0 1 0\r\no Sch\xe4del\r\nf 1 2 3\r\n";
    assert_eq!(read("old.obj", text).parts[0].node, "Sch\u{fffd}del");
}

#[test]
fn faults_name_the_line() {
    for (text, message) in [
        ("v 0 0 0\nf 1 2 3\n", "line 2: vertex 2 is not among the 1 read so far"),
        ("v 0 0\n", "line 1: 2 numbers where 3 should be"),
        ("v 0 0 zero\n", "line 1: \"zero\" is not a number"),
        ("v 0 0 nan\n", "line 1: \"nan\" is not finite"),
        ("v 0 0 1e39\n", "line 1: \"1e39\" is not finite"),
        ("v 0 0 0 1 0 inf\n", "line 1: \"inf\" is not finite"),
        ("v 0 \\\n0 0\nv x\n", "line 3: \"x\" is not a number"),
        ("v 0 0 0\nf 1 0 1\n", "line 2: vertex 0 is not among the 1 read so far"),
        ("v 0 0 0\nf 1 9223372036854775807 -9223372036854775808\n", "line 2: vertex 9223372036854775807"),
        ("v 0 0 0\nf 1 1/ /\n", "line 2: corner \"/\" has no vertex"),
        ("v 0 0 0\nf 1 1/1 1\n", "line 2: texture coordinate 1 is not among the 0 read so far"),
        ("", "the mesh is empty"),
    ] {
        let error = refused("x.obj", text);
        assert!(error.contains(message), "{error:?} does not say {message:?}");
    }
}
