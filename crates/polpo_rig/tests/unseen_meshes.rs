//! Meshes of every kind that an artist may hand over, and what must hold for the rig of each.

mod common;

use common::{block, both, cubes, grid, moved, pieces};
use glam::{IVec3, Quat, Vec3};
use libm::{cosf, sinf};
use polpo_rig::{Built, Mesh, Note, Placement, Recipe, build_rig_with, coverage};

const PLACEMENTS: [Placement; 4] = [Placement::Auto, Placement::Surface, Placement::Volume, Placement::Medial];

/// A mesh, its volume [m³] where it has one, and the number of parts that lie apart.
struct Case {
    name: &'static str,
    mesh: Mesh,
    volume: Option<f32>,
    parts: usize,
}

fn whole(name: &'static str, mesh: Mesh, volume: f32) -> Case {
    Case { name, mesh, volume: Some(volume), parts: 1 }
}

fn thin(name: &'static str, mesh: Mesh) -> Case {
    Case { name, mesh, volume: None, parts: 1 }
}

fn size(mesh: &Mesh) -> f32 {
    let (low, high) = mesh.positions.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |b, p| (b.0.min(*p), b.1.max(*p)));
    (high - low).max_element()
}

fn build(case: &Case, placement: Placement) -> Built {
    let recipe = Recipe { placement, ..Recipe::with_particles(40) };
    build_rig_with(&case.mesh, &recipe, &mut |_| {}).unwrap_or_else(|e| panic!("{}: {e}", case.name))
}

fn holds(case: &Case, placement: Placement) {
    let Case { name, mesh, volume, parts } = case;
    let Built { rig, notes } = build(case, placement);
    let what = format!("{name}, {placement:?}");
    rig.validate().unwrap_or_else(|e| panic!("{what}: {e}"));
    assert_eq!((rig.particles.len(), pieces(&rig)), (40, 1), "{what}");
    let tied = if *parts > 1 { vec![Note::Tied { parts: *parts }] } else { vec![] };
    assert_eq!(notes, tied, "{what}");
    let size = size(mesh);
    for (i, particle) in rig.particles.iter().enumerate() {
        assert!(particle.radii.max_element() < 0.9 * size, "{what}: particle {i} is larger than the body: {particle:?}");
    }
    if let Some(volume) = volume {
        let mass: f64 = rig.particles.iter().map(|p| f64::from(p.mass)).sum();
        let ratio = mass / (1000.0 * f64::from(*volume));
        // An open body is counted in voxels, to half of one at every side.
        assert!((ratio - 1.0).abs() < 0.07, "{what}: {ratio} times its mass");
    }
    let found = coverage(mesh, &rig);
    // In a cube 40 cells are chunks that no ellipsoid fills.
    assert!(found.covered > 0.8, "{what}: only {} of the skin is covered", found.covered);
    assert!(found.overhang < 0.03 * size, "{what}: ellipsoids stick out by {} of {size}", found.overhang);
}

fn quad(a: Vec3, b: Vec3, c: Vec3, d: Vec3) -> Mesh {
    Mesh {
        name: "quad".into(),
        positions: vec![a, b, c, d],
        normals: vec![Vec3::Y; 4],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..Mesh::default()
    }
}

fn flipped(mut mesh: Mesh) -> Mesh {
    mesh.triangles.iter_mut().for_each(|t| t.swap(0, 1));
    mesh
}

/// A prism of so many sides along a line, closed at its ends.
fn tube(line: &[Vec3], radius: f32, sides: u32) -> Mesh {
    let mut mesh = Mesh { name: "tube".into(), ..Mesh::default() };
    for (i, &p) in line.iter().enumerate() {
        let along = (line[(i + 1).min(line.len() - 1)] - line[i.saturating_sub(1)]).normalize();
        let turn = Quat::from_rotation_arc(Vec3::Z, along);
        for k in 0..sides {
            let angle = std::f32::consts::TAU * k as f32 / sides as f32;
            mesh.positions.push(p + turn * Vec3::new(cosf(angle), sinf(angle), 0.0) * radius);
            if i > 0 {
                let (a, b) = (i as u32 * sides + k, i as u32 * sides + (k + 1) % sides);
                mesh.triangles.extend([[a - sides, b - sides, b], [a - sides, b, a]]);
            }
        }
    }
    let last = (line.len() as u32 - 1) * sides;
    for k in 2..sides {
        mesh.triangles.extend([[0, k, k - 1], [last, last + k - 1, last + k]]);
    }
    mesh.normals = vec![Vec3::Y; mesh.positions.len()];
    mesh
}

fn wire() -> Vec<Vec3> {
    (0..=60).map(|i| i as f32 / 60.0).map(|t| Vec3::new(t, 0.2 * sinf(6.0 * t), 0.1 * cosf(9.0 * t))).collect()
}

/// A cloth with waves, and its two triangles where they are all.
fn cloth(cuts: i32) -> Mesh {
    let mut sheet = block([cuts, 1, cuts], 1, Vec3::ONE);
    sheet.triangles.retain(|t| t.iter().all(|&v| sheet.positions[v as usize].y == 1.0));
    sheet.positions.iter_mut().for_each(|p| p.y = 0.06 * sinf(9.0 * p.x) * cosf(7.0 * p.z));
    sheet
}

#[test]
fn solids_of_every_make() {
    let cube = || block([1, 1, 1], 3, Vec3::ONE);
    let mut open = cube();
    open.triangles.retain(|t| !t.iter().all(|&v| open.positions[v as usize].y == 1.0));
    // Two cubes that share an edge, and a wall in one of them: four triangles at a side, and three.
    let mut tangled = cubes(&[IVec3::ZERO, IVec3::new(1, 1, 0)], 2, |p| p * 0.5);
    let wall = quad(Vec3::new(0.25, 0.0, 0.0), Vec3::new(0.25, 0.5, 0.0), Vec3::new(0.25, 0.5, 0.5), Vec3::new(0.25, 0.0, 0.5));
    tangled = both(tangled, wall);
    // Six sides that almost meet.
    let mut cracked = cube();
    let corners: Vec<[Vec3; 3]> = cracked.triangles.iter().map(|t| t.map(|v| cracked.positions[v as usize])).collect();
    cracked.positions.clear();
    for [a, b, c] in corners {
        let out = (b - a).cross(c - a).normalize();
        cracked.positions.extend([a, b, c].map(|p| p + out * 1e-4));
    }
    cracked.triangles = (0..cracked.positions.len() as u32 / 3).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
    cracked.normals = vec![Vec3::Y; cracked.positions.len()];
    let inner = moved(block([1, 1, 1], 2, Vec3::splat(0.5)), Vec3::splat(0.25));
    // A bar that is bent until it crosses itself.
    let crossing: Vec<Vec3> = (0..=40).map(|i| i as f32 / 40.0 * 5.5).map(|t| Vec3::new(sinf(t), sinf(2.0 * t) * 0.5, 0.0)).collect();
    let cases = [
        whole("closed", cube(), 1.0),
        whole("open", open, 1.0),
        whole("non-manifold", tangled, 0.25),
        whole("cracked", cracked, 1.0),
        whole("boxes in boxes", both(cube(), inner.clone()), 1.0),
        whole("boxes in boxes, one of them inside out", both(cube(), flipped(inner)), 1.0),
        whole("inside out", flipped(cube()), 1.0),
        Case { name: "crossing itself", mesh: tube(&crossing, 0.15, 8), volume: None, parts: 1 },
    ];
    for case in &cases {
        holds(case, Placement::Auto);
    }
}

#[test]
fn thin_ones_of_every_make() {
    let [a, b, c, d] = [Vec3::ZERO, Vec3::X, Vec3::X + Vec3::Z, Vec3::Z];
    // Two wings and a keel that share a fold.
    let (nose, tail) = (Vec3::ZERO, Vec3::new(0.0, 0.0, 1.0));
    let wing = |x: f32| quad(nose, tail, tail + Vec3::new(x, 0.1, 0.0), nose + Vec3::new(0.01 * x, 0.001, 0.0));
    let keel = quad(nose, tail, tail - Vec3::Y * 0.15, nose - Vec3::Y * 0.01);
    let cases = [
        thin("quad", quad(a, b, c, d)),
        thin("quad at a slant", quad(a, b + Vec3::Y * 0.3, c + Vec3::Y * 0.5, d + Vec3::Y * 0.2)),
        thin("paper plane", both(both(wing(0.4), wing(-0.4)), keel)),
        thin("cloth with waves", cloth(24)),
        whole("card", block([1, 1, 1], 2, Vec3::new(1.0, 0.001, 0.7)), 0.0007),
        whole("needle", block([1, 1, 1], 1, Vec3::new(0.001, 1.0, 0.001)), 1e-6),
        thin("wire", tube(&wire(), 0.001, 3)),
    ];
    for case in &cases {
        holds(case, Placement::Auto);
    }
}

#[test]
fn waves_of_a_sheet_are_not_filled() {
    let case = thin("cloth with waves", cloth(24));
    for particle in &build(&case, Placement::Auto).rig.particles {
        let p = particle.position;
        let sheet = 0.06 * sinf(9.0 * p.x) * cosf(7.0 * p.z);
        assert!((p.y - sheet).abs() < 0.02, "{particle:?} is {} off the sheet", p.y - sheet);
    }
}

#[test]
fn parts_that_lie_apart_are_tied_and_told() {
    let mut mesh = block([1, 1, 1], 2, Vec3::splat(0.3));
    for i in 1..5 {
        mesh = both(mesh, moved(block([1, 1, 1], 2, Vec3::splat(0.3)), Vec3::new(0.5 * i as f32, 0.2 * (i % 2) as f32, 0.0)));
    }
    let case = Case { name: "apart", mesh, volume: Some(5.0 * 0.027), parts: 5 };
    PLACEMENTS.iter().for_each(|&p| holds(&case, p));
}

#[test]
fn every_placement_takes_solids_sheets_and_wires() {
    let cases = [
        whole(
            "bar with a fin",
            cubes(&[grid(IVec3::ZERO, IVec3::new(8, 2, 2)), vec![IVec3::new(3, 2, 0), IVec3::new(3, 3, 0)]].concat(), 1, |p| p * 0.125),
            34.0 / 512.0,
        ),
        thin("cloth with waves", cloth(12)),
        whole(
            "wire",
            tube(&wire(), 0.01, 6),
            6.0 * 0.5 * 0.01 * 0.01 * 0.866 * wire().windows(2).map(|w| w[0].distance(w[1])).sum::<f32>(),
        ),
    ];
    for case in &cases {
        PLACEMENTS.iter().for_each(|&p| holds(case, p));
    }
}

#[test]
fn units_and_distance_from_the_origin_change_nothing() {
    let bar = || block([4, 2, 1], 3, Vec3::new(1.0, 0.5, 0.25));
    for unit in [1e-3_f32, 1e4] {
        let mut mesh = bar();
        mesh.positions.iter_mut().for_each(|p| *p *= unit);
        holds(&whole("another unit", mesh, 0.125 * unit * unit * unit), Placement::Auto);
    }
    // There f32 steps by a millimetre.
    let far = Vec3::new(10_000.0, -5_000.0, 7_000.0);
    let near = build(&whole("near", bar(), 0.125), Placement::Auto).rig;
    let case = whole("far", moved(bar(), far), 0.125);
    holds(&case, Placement::Auto);
    let away = build(&case, Placement::Auto).rig;
    assert_eq!(near.edges, away.edges);
    for (a, b) in near.particles.iter().zip(&away.particles) {
        assert!((b.position - far).distance(a.position) < 2e-3, "{a:?} {b:?}");
    }
}
