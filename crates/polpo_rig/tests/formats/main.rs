//! What the mesh formats say is what is read, in order and part by part; what they can't say is named.

mod gltf;
mod obj;
mod ply;
mod stl;

#[path = "../seeds/mod.rs"]
mod seeds;

use glam::Vec3;
use polpo_rig::{Mesh, MeshPart, parse_mesh};

/// The mesh of a file that must be one.
fn read(name: &str, bytes: impl AsRef<[u8]>) -> Mesh {
    parse_mesh(name, bytes.as_ref()).unwrap_or_else(|e| panic!("{e}"))
}

/// What is said of a file that must not be one, without its name.
fn refused(name: &str, bytes: impl AsRef<[u8]>) -> String {
    let error = parse_mesh(name, bytes.as_ref()).err().unwrap_or_else(|| panic!("{name} is read"));
    let text = error.to_string();
    text.strip_prefix(&format!("{name}: ")).unwrap_or_else(|| panic!("{text:?} doesn't begin with its file")).to_owned()
}

fn part(node: &str, name: &str, material: &str, vertices: std::ops::Range<u32>, triangles: std::ops::Range<u32>) -> MeshPart {
    MeshPart { node: node.into(), name: name.into(), material: material.into(), vertices, triangles }
}

fn volume(mesh: &Mesh, triangles: std::ops::Range<usize>) -> f32 {
    let middle = mesh.positions.iter().sum::<Vec3>() / mesh.positions.len() as f32;
    let corner = |v: u32| mesh.positions[v as usize] - middle;
    mesh.triangles[triangles].iter().map(|t| corner(t[0]).dot(corner(t[1]).cross(corner(t[2]))) / 6.0).sum()
}

#[test]
fn parts_tile_the_mesh() {
    let whole = read("cube.obj", seeds::OBJ);
    assert_eq!(whole.parts.len(), 2);
    let cases: [(fn(&mut Mesh), &str); 6] = [
        (|m| m.parts[0].triangles.end = 1, "part 1: its triangles are 2..4, but must start at 1 and end within 4"),
        (|m| m.parts[1].vertices.end = 9, "part 1: its vertices are 4..9, but must start at 4 and end within 8"),
        (|m| m.parts[0].vertices = 0..3, "part 0: triangle 1 points to vertex 3, which is not of 0..3"),
        (|m| m.parts.truncate(1), "part 0: it is the last, but its vertices end at 4 and not at 8"),
        (|m| m.parts[1].triangles.end = 3, "part 1: it is the last, but its triangles end at 3 and not at 4"),
        (|m| m.parts[0].triangles = std::ops::Range { start: 0, end: u32::MAX }, "part 0: its triangles are 0..4294967295, but"),
    ];
    for (spoil, message) in cases {
        let mut mesh = whole.clone();
        spoil(&mut mesh);
        let error = mesh.validate().map_err(|e| e.to_string()).err().unwrap_or_default();
        assert!(error.starts_with(&format!("cube.obj: {message}")), "{error}");
    }
    assert!(Mesh { parts: Vec::new(), ..whole }.validate().is_ok(), "no parts are one without a name");
}

#[test]
fn any_unit_and_any_place() {
    for scale in [1e-15_f32, 1.0, 1e15] {
        for offset in [0.0, 1e4 * scale] {
            let points = seeds::corners().into_iter().map(|p| p * scale + offset);
            let points: String = points.map(|p| format!("v {} {} {}\n", p.x, p.y, p.z)).collect();
            let faces: String = seeds::SIDES.iter().map(|[a, b, c, d]| format!("f {} {} {} {}\n", a + 1, b + 1, c + 1, d + 1)).collect();
            let mesh = read("far.obj", points + &faces);
            let at =
                |positions: &[Vec3], triangles: &[[u32; 3]]| triangles.iter().map(|t| t.map(|v| positions[v as usize])).collect::<Vec<_>>();
            let placed: Vec<Vec3> = seeds::corners().into_iter().map(|p| p * scale + offset).collect();
            assert_eq!(at(&mesh.positions, &mesh.triangles), at(&placed, &seeds::triangles()));
            let outwards = |(p, n): (&Vec3, &Vec3)| n.dot((*p - offset) / scale - 0.5) > 0.7;
            assert!(mesh.positions.iter().zip(&mesh.normals).all(outwards), "{scale} {offset}: {:?}", mesh.normals);
        }
    }
}
