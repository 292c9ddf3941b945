//! A mesh or setting that can't be rigged is an error that names the culprit; an ugly mesh is rigged.

mod common;

use std::path::Path;

use common::{block, both, cubes, grid, moved, pieces, rig, settings};
use glam::{IVec3, Vec3};
use polpo_rig::{EdgeAmount, Mesh, Recipe, build_rig, parse_glb, read_mesh};

/// One way to spoil a box of 8 vertices and 12 triangles, and the error that must name it.
type Spoiler = (fn(&mut Mesh), &'static str);

#[test]
fn a_mesh_that_cannot_be_rigged_is_named() {
    let cases: [Spoiler; 13] = [
        (|m| m.positions[5].y = f32::NAN, "cubes: position 5 is not finite"),
        (|m| m.positions[0].z = f32::INFINITY, "cubes: position 0 is not finite"),
        (|m| m.normals[2].x = f32::NAN, "cubes: normal 2 is not finite"),
        (|m| m.colors = vec![[1.0, 1.0, f32::NAN, 1.0]; 8], "cubes: color 0 is not finite"),
        (|m| m.colors = vec![[1.0; 4]; 7], "cubes: 7 entries in colors, but 8 vertices"),
        (|m| m.normals.clear(), "cubes: 0 entries in normals, but 8 vertices"),
        (|m| m.triangles[3][1] = 8, "cubes: triangle 3 points to vertex 8, but there are 8"),
        (|m| m.triangles[11][2] = u32::MAX, "cubes: triangle 11 points to vertex 4294967295, but there are 8"),
        (|m| m.triangles.clear(), "cubes: the mesh has no triangles"),
        (|m| *m = Mesh { name: "cubes".into(), ..Mesh::default() }, "cubes: the mesh is empty, it has no vertices"),
        (|m| m.positions.fill(Vec3::splat(3.0)), "cubes: the mesh has no extent, all its vertices lie in one point"),
        (|m| m.positions.iter_mut().for_each(|p| *p = Vec3::X * p.x), "cubes: none of the 12 triangles has an area"),
        (|m| m.triangles.iter_mut().for_each(|t| t[1] = t[0]), "cubes: none of the 12 triangles has an area"),
    ];
    for (spoil, message) in cases {
        let mut mesh = block([1, 1, 1], 1, Vec3::ONE);
        assert_eq!((mesh.positions.len(), mesh.triangles.len()), (8, 12));
        spoil(&mut mesh);
        let error = build_rig(&mesh, &settings(5)).map(|_| ()).map_err(|e| e.to_string());
        assert_eq!(error, Err(message.to_string()));
    }
}

#[test]
fn a_setting_out_of_range_is_named() {
    let mesh = block([1, 1, 1], 1, Vec3::ONE);
    let cases = [
        (settings(0), "setting `particles` is 0: 1 to 100000"),
        (Recipe { density: 0.0, ..settings(5) }, "setting `density` is 0: finite and positive"),
        (Recipe { density: f32::NAN, ..settings(5) }, "setting `density` is NaN: finite and positive"),
        (settings(100_001), "setting `particles` is 100001: 1 to 100000"),
    ];
    for (settings, message) in cases {
        let error = build_rig(&mesh, &settings).map(|_| ()).map_err(|e| e.to_string());
        assert!(error.as_ref().is_err_and(|e| e.starts_with(message)), "{error:?} is not {message:?}");
    }
}

#[test]
fn more_particles_than_voxels_is_named() {
    let wire = block([1, 1, 1], 1, Vec3::new(1.0, 1e-6, 1e-6));
    let error = build_rig(&wire, &settings(50_000)).map(|_| ()).map_err(|e| e.to_string());
    let message = "cubes: 50000 particles wanted, but the body has only";
    assert!(error.as_ref().is_err_and(|e| e.starts_with(message)), "{error:?}");
}

#[test]
fn a_body_whose_masses_f32_cannot_hold_is_named() {
    for side in [1e-17, 1e14] {
        let mesh = block([1, 1, 1], 1, Vec3::splat(side));
        let error = build_rig(&mesh, &settings(5)).map(|_| ()).map_err(|e| e.to_string());
        assert!(error.as_ref().is_err_and(|e| e.contains("particle 0: mass is")), "{error:?}");
    }
}

#[test]
fn a_file_that_is_no_mesh_is_named() {
    let error = |path: &str| read_mesh(Path::new(path)).map(|_| ()).map_err(|e| e.to_string());
    let no_file = error("no/such/file.glb");
    assert!(no_file.as_ref().is_err_and(|e| e.starts_with("no/such/file.glb: cannot be read")), "{no_file:?}");
    let no_format = error("mesh.fbx");
    assert!(no_format.as_ref().is_err_and(|e| e.starts_with("mesh.fbx: extension \"fbx\"")), "{no_format:?}");
    let no_mesh = parse_glb("noise", b"not a mesh at all").map(|_| ()).map_err(|e| e.to_string());
    assert!(no_mesh.as_ref().is_err_and(|e| e.starts_with("noise: not a readable mesh")), "{no_mesh:?}");
}

#[test]
fn doubled_and_degenerate_triangles_change_nothing() {
    let clean = block([2, 1, 1], 2, Vec3::new(2.0, 1.0, 1.0));
    let mut ugly = clean.clone();
    ugly.triangles.extend_from_within(..);
    ugly.triangles.extend([[0, 0, 1], [2, 2, 2], [3, 4, 3]]);
    let (clean, ugly) = (rig(&clean, 20), rig(&ugly, 20));
    assert_eq!(clean.particles, ugly.particles);
    assert_eq!(clean.edges, ugly.edges);
    assert_eq!(clean.skin, ugly.skin);
}

#[test]
fn seams_are_closed() {
    let whole = block([1, 1, 1], 3, Vec3::ONE);
    // Three vertices of its own for every triangle, as a mesh with flat normals has.
    let torn = Mesh {
        positions: whole.triangles.iter().flatten().map(|&v| whole.positions[v as usize]).collect(),
        normals: vec![Vec3::Y; whole.triangles.len() * 3],
        triangles: (0..whole.triangles.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect(),
        ..whole.clone()
    };
    let (whole_rig, torn_rig) = (rig(&whole, 20), rig(&torn, 20));
    assert_eq!(whole_rig.particles, torn_rig.particles);
    for (corner, &v) in whole.triangles.iter().flatten().enumerate() {
        assert_eq!(torn_rig.skin[corner], whole_rig.skin[v as usize], "doubled vertices follow the same particles");
    }
}

#[test]
fn an_open_body_is_filled() {
    let mut open = block([1, 1, 1], 4, Vec3::ONE);
    // The lid off: every triangle all of whose corners are at the top.
    open.triangles.retain(|t| !t.iter().all(|&v| open.positions[v as usize].y == 1.0));
    let rig = rig(&open, 30);
    let mass: f32 = rig.particles.iter().map(|p| p.mass).sum();
    assert!((mass - 1000.0).abs() < 50.0, "{mass} kg for a cubic metre");
}

#[test]
fn flipped_triangles_are_filled_just_as_well() {
    let mut inside_out = block([1, 1, 1], 4, Vec3::ONE);
    inside_out.triangles.iter_mut().for_each(|t| t.swap(0, 1));
    let mass: f32 = rig(&inside_out, 30).particles.iter().map(|p| p.mass).sum();
    assert!((mass - 1000.0).abs() < 50.0, "{mass} kg for a cubic metre");
}

#[test]
fn a_sheet_without_any_inside_is_rigged() {
    let mut sheet = block([8, 1, 8], 1, Vec3::ONE);
    sheet.triangles.retain(|t| t.iter().all(|&v| sheet.positions[v as usize].y == 1.0));
    let rig = rig(&sheet, 40);
    assert_eq!((rig.particles.len(), pieces(&rig)), (40, 1));
    for particle in &rig.particles {
        assert!((particle.position.y - 1.0).abs() < 0.03, "{particle:?} is off the sheet");
        assert!(particle.radii.min_element() < 0.3 * particle.radii.max_element(), "{particle:?} is not flat");
    }
}

#[test]
fn parts_are_tied_and_each_has_a_particle() {
    let part = block([1, 1, 1], 2, Vec3::splat(0.3));
    let mut mesh = part.clone();
    for i in 1..6 {
        mesh = both(mesh, moved(part.clone(), Vec3::new(i as f32, 0.2 * (i % 2) as f32, 0.0)));
    }
    // Even if fewer are wanted than there are parts.
    for (wanted, met) in [(20, 20), (2, 6)] {
        let rig = rig(&mesh, wanted);
        assert_eq!((rig.particles.len(), pieces(&rig)), (met, 1));
        for i in 0..6 {
            let in_part = |x: f32| x > i as f32 - 0.1 && x < i as f32 + 0.4;
            assert!(rig.particles.iter().any(|p| in_part(p.position.x)), "part {i} has no particle");
        }
    }
}

#[test]
fn parts_that_overlap_are_solid() {
    let a = block([1, 1, 1], 2, Vec3::ONE);
    let b = moved(block([1, 1, 1], 2, Vec3::splat(0.5)), Vec3::new(0.75, 0.25, 0.25));
    let mass: f32 = rig(&both(a, b), 30).particles.iter().map(|p| p.mass).sum();
    // A cube, and the half of the small one that stands out.
    assert!((mass - 1062.5).abs() < 50.0, "{mass} kg");
}

#[test]
fn every_wish_for_edges_is_met_where_it_can_be() {
    let mesh = cubes(&grid(IVec3::ZERO, IVec3::new(4, 1, 1)), 1, |p| p);
    for (wanted, met) in [(0, 19), (19, 19), (50, 50), (77, 77), (190, 190), (1000, 190)] {
        let rig = build_rig(&mesh, &Recipe { edges: EdgeAmount::Count(wanted), ..settings(20) }).expect("a bar can be rigged");
        assert_eq!((rig.edges.len(), pieces(&rig)), (met, 1), "{wanted} edges wanted");
    }
}
