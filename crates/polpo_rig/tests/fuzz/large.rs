//! What a million triangles take. The files are written once, to the target folder:
//! `cargo test --release -p polpo_rig --test fuzz -- --ignored --nocapture --test-threads 1 large`.

use std::fmt::Write;
use std::fs;
use std::path::Path;
use std::time::Instant;

use glam::Vec3;
use polpo_rig::read_mesh;

use crate::counting::peak;
use crate::seeds::{floats, glb};

/// Squares along either side of a sheet, with waves that no two vertices share.
const SIDE: u32 = 708;

fn sheet() -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let row = SIDE + 1;
    let point = |i: u32| {
        let (x, y) = ((i % row) as f32 / row as f32, (i / row) as f32 / row as f32);
        Vec3::new(x, y, 0.1 * (x * x - y) * (1.0 + x * y))
    };
    let square = |i: u32| {
        let a = i / SIDE * row + i % SIDE;
        [[a, a + 1, a + row + 1], [a, a + row + 1, a + row]]
    };
    ((0..row * row).map(point).collect(), (0..SIDE * SIDE).flat_map(square).collect())
}

/// Reads the file, which `write` makes if it is not there.
fn measure(name: &str, write: impl FnOnce() -> Vec<u8>) {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    if !path.exists() {
        fs::write(&path, write()).expect("written");
    }
    let size = fs::metadata(&path).expect("it is there").len() as f64 / 1e6;
    let begin = Instant::now();
    let (mesh, memory) = peak(|| read_mesh(&path).expect("a mesh"));
    let seconds = begin.elapsed().as_secs_f64();
    println!("{name}: {} triangles, {size:.0} MB, {seconds:.2} s, {:.0} MB of memory", mesh.triangles.len(), memory as f64 / 1e6);
    assert_eq!(mesh.triangles.len(), (2 * SIDE * SIDE) as usize);
}

#[test]
#[ignore = "measures"]
fn large_glb() {
    measure("large.glb", || {
        let (positions, triangles) = sheet();
        let mut bytes = floats(positions.iter().flat_map(|p| p.to_array()));
        let at = bytes.len();
        bytes.extend(triangles.iter().flatten().flat_map(|v| v.to_le_bytes()));
        let json = format!(
            r#"{{"nodes":[{{"mesh":0}}],"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"indices":1}}]}}],
            "accessors":[{{"bufferView":0,"componentType":5126,"count":{},"type":"VEC3"}},
            {{"bufferView":1,"componentType":5125,"count":{},"type":"SCALAR"}}],
            "bufferViews":[{{"buffer":0,"byteLength":{at}}},{{"buffer":0,"byteOffset":{at},"byteLength":{}}}],
            "buffers":[{{"byteLength":{}}}]}}"#,
            positions.len(),
            3 * triangles.len(),
            bytes.len() - at,
            bytes.len()
        );
        glb(&json, &bytes)
    });
}

#[test]
#[ignore = "measures"]
fn large_obj() {
    measure("large.obj", || {
        let (positions, triangles) = sheet();
        let mut text = String::new();
        positions.iter().for_each(|p| writeln!(text, "v {} {} {}\nvt {} {}", p.x, p.y, p.z, p.x, p.y).expect("a string"));
        for [a, b, c] in triangles.iter().map(|t| t.map(|v| v + 1)) {
            writeln!(text, "f {a}/{a} {b}/{b} {c}/{c}").expect("a string");
        }
        text.into()
    });
}

#[test]
#[ignore = "measures"]
fn large_binary_stl() {
    measure("large.stl", || {
        let (positions, triangles) = sheet();
        let mut bytes = vec![0; 80];
        bytes.extend((triangles.len() as u32).to_le_bytes());
        for t in triangles {
            bytes.extend([0; 12]);
            bytes.extend(floats(t.iter().flat_map(|&v| positions[v as usize].to_array())));
            bytes.extend([0, 0]);
        }
        bytes
    });
}

#[test]
#[ignore = "measures"]
fn large_text_stl() {
    measure("large text.stl", || {
        let (positions, triangles) = sheet();
        let mut text = "solid sheet\n".to_owned();
        for t in triangles {
            text += "facet normal 0 0 1\nouter loop\n";
            t.map(|v| positions[v as usize]).iter().for_each(|p| writeln!(text, "vertex {} {} {}", p.x, p.y, p.z).expect("a string"));
            text += "endloop\nendfacet\n";
        }
        (text + "endsolid sheet\n").into()
    });
}

fn ply(format: &str, positions: usize, triangles: usize) -> String {
    format!(
        "ply\nformat {format} 1.0\nelement vertex {positions}\nproperty float x\nproperty float y\nproperty float z\n\
         element face {triangles}\nproperty list uchar int vertex_indices\nend_header\n"
    )
}

#[test]
#[ignore = "measures"]
fn large_binary_ply() {
    measure("large.ply", || {
        let (positions, triangles) = sheet();
        let mut bytes = ply("binary_little_endian", positions.len(), triangles.len()).into_bytes();
        bytes.extend(floats(positions.iter().flat_map(|p| p.to_array())));
        for t in triangles {
            bytes.push(3);
            bytes.extend(t.iter().flat_map(|v| v.to_le_bytes()));
        }
        bytes
    });
}

#[test]
#[ignore = "measures"]
fn large_text_ply() {
    measure("large text.ply", || {
        let (positions, triangles) = sheet();
        let mut text = ply("ascii", positions.len(), triangles.len());
        positions.iter().for_each(|p| writeln!(text, "{} {} {}", p.x, p.y, p.z).expect("a string"));
        triangles.iter().for_each(|[a, b, c]| writeln!(text, "3 {a} {b} {c}").expect("a string"));
        text.into()
    });
}
