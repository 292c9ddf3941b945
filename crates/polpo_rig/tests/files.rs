//! Rig files give back what was written; whatever else they hold is an error that says so.

mod common;

use std::fs;

use common::{block, moved, rig, two_fingers};
use glam::{Quat, Vec3};
use polpo_rig::{Mesh, Rig, RigError};

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

#[test]
fn an_error_does_not_repeat_the_file() {
    let text = format!("(version: 2, rig: {}())", "é".repeat(10_000));
    let error = Rig::from_ron("long.ron", &text).map_err(|e| e.to_string()).err().unwrap_or_default();
    assert!(error.starts_with("long.ron: not a rig: ") && error.ends_with('…') && error.len() < 400, "{error}");
}

#[test]
fn frames_survive_the_text_format() {
    let mut rig = small();
    rig.particles[0].frame = Quat::from_xyzw(0.1, -0.2, 0.3, 0.4).normalize();
    let text = rig.to_ron().expect("a whole rig");
    assert_eq!(Rig::from_ron("text", &text).expect("its own text").particles[0], rig.particles[0]);
}
