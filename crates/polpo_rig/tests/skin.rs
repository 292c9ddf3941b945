//! Skin weights are a partition of unity that changes smoothly over the skin, stays within a limb, and bends well.

mod common;

use std::f32::consts::{FRAC_PI_2, TAU};

use common::{block, both, cubes, grid, moved, rig, settings, spacing, two_fingers};
use glam::{IVec3, Quat, Vec3};
use polpo_rig::{Influences, Mesh, Recipe, Rig, build_rig};

fn rig_of(mesh: &Mesh, particles: usize, influences: usize) -> Rig {
    build_rig(mesh, &Recipe { influences, ..settings(particles) }).expect("the shape can be rigged")
}

fn weight(influences: &Influences, particle: u32) -> f32 {
    influences.used().filter(|used| used.0 == particle).map(|used| used.1).sum()
}

/// Half the sum of all changes of weight between two vertices: 0 for the same weights, 1 for other particles.
fn change(a: &Influences, b: &Influences) -> f32 {
    let mut particles: Vec<u32> = a.used().chain(b.used()).map(|used| used.0).collect();
    particles.sort_unstable();
    particles.dedup();
    particles.iter().map(|&p| (weight(a, p) - weight(b, p)).abs()).sum::<f32>() * 0.5
}

/// The steepest change of weights: how many times they change from one particle wholly to another on the way of one spacing. Sides
/// shorter than a twentieth of the spacing count as that long, so that a jump is seen as one and rounding is not. A jump by 1 is 20;
/// linear B-splines in a row have 1; longer sides show less than there is.
fn steepest(mesh: &Mesh, rig: &Rig) -> f32 {
    let spacing = spacing(rig);
    let sides = mesh.triangles.iter().flat_map(|t| [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])]);
    let steepness = sides.map(|(a, b)| {
        let length = mesh.positions[a as usize].distance(mesh.positions[b as usize]) / spacing;
        change(&rig.skin[a as usize], &rig.skin[b as usize]) / length.max(0.05)
    });
    steepness.fold(0.0, f32::max)
}

fn sphere(cuts: i32) -> Mesh {
    cubes(&[IVec3::ZERO], cuts, |p| (p - 0.5).map(|x| libm::tanf(x * 1.57)).normalize())
}

/// A bar whose triangles are up to twenty times as long at one end as at the other.
fn uneven_bar() -> Mesh {
    let uneven = |p: Vec3| Vec3::new(0.05 * p.x * p.x + 0.1 * p.x, p.y, p.z) * Vec3::new(0.5, 0.2, 0.2);
    cubes(&grid(IVec3::ZERO, IVec3::new(4, 1, 1)), 24, uneven)
}

/// A tube along a line, which runs from 0 to 1.
fn tube(rings: u32, radius: f32, line: impl Fn(f32) -> Vec3) -> Mesh {
    const AROUND: u32 = 16;
    let mut mesh = Mesh { name: "tube".into(), ..Mesh::default() };
    for i in 0..=rings {
        let s = i as f32 / rings as f32;
        let along = (line(s + 1e-3) - line(s - 1e-3)).normalize();
        let turn = Quat::from_rotation_arc(Vec3::Z, along);
        for j in 0..AROUND {
            let (sin, cos) = libm::sincosf(j as f32 / AROUND as f32 * TAU);
            mesh.positions.push(line(s) + turn * Vec3::new(cos, sin, 0.0) * radius);
        }
    }
    for i in 0..rings * AROUND {
        let next = if i % AROUND == AROUND - 1 { i + 1 - AROUND } else { i + 1 };
        mesh.triangles.extend([[i, next, next + AROUND], [i, next + AROUND, i + AROUND]]);
    }
    for (ring, turned) in [(0, true), (rings, false)] {
        let middle = mesh.positions.len() as u32;
        mesh.positions.push(line(ring as f32 / rings as f32));
        for j in 0..AROUND {
            let (a, b) = (ring * AROUND + j, ring * AROUND + (j + 1) % AROUND);
            mesh.triangles.push(if turned { [middle, b, a] } else { [middle, a, b] });
        }
    }
    mesh.normals = vec![Vec3::Y; mesh.positions.len()];
    mesh
}

#[test]
fn weights_sum_to_one() {
    let mesh = two_fingers(0.05);
    for (particles, most) in [(1, 4), (3, 8), (40, 1), (40, 3), (40, 4), (40, 8)] {
        let rig = rig_of(&mesh, particles, most);
        for (v, influences) in rig.skin.iter().enumerate() {
            let sum: f32 = influences.weights.iter().sum();
            assert!((sum - 1.0).abs() <= 1e-6, "vertex {v}: {sum}");
            assert!(influences.weights.is_sorted_by(|a, b| a >= b), "vertex {v}: heaviest first: {influences:?}");
            assert!(influences.used().count() <= most, "vertex {v} follows more than {most}");
            for slot in 0..influences.weights.len() {
                if influences.weights[slot] == 0.0 {
                    assert_eq!(influences.particles[slot], influences.particles[0], "vertex {v}, slot {slot}");
                }
            }
        }
        let most_used = rig.skin.iter().map(|i| i.used().count()).max();
        assert!(particles < 40 || most_used == Some(most), "{most_used:?} of {particles} with {most} influences");
    }
}

#[test]
fn weights_change_smoothly() {
    let apart = both(sphere(24), moved(sphere(24), Vec3::X * 2.5));
    let slab = cubes(&grid(IVec3::ZERO, IVec3::new(12, 4, 3)), 10, |p| {
        let p = p * 0.1;
        Vec3::new(p.x, p.y + 0.4 * p.x * p.x, p.z)
    });
    let bar = || block([5, 1, 1], 24, Vec3::new(1.0, 0.2, 0.2));
    let fingers = || cubes(&fingers(), 8, |p| p * Vec3::new(0.1, 0.2, 0.1));
    let shapes = [
        ("a sphere", sphere(40), 60, 4, 2.8),
        ("a bar", bar(), 20, 4, 2.8),
        ("a bar", bar(), 20, 8, 1.5),
        ("uneven triangles", uneven_bar(), 20, 4, 2.5),
        ("two fingers", fingers(), 30, 4, 3.0),
        ("two fingers", fingers(), 30, 8, 2.7),
        ("a sheet", cubes(&grid(IVec3::ZERO, IVec3::new(60, 60, 1)), 1, |p| p * Vec3::new(0.016, 0.016, 0.01)), 30, 4, 2.8),
        ("two balls", apart, 40, 4, 2.8),
        ("a bent slab", slab, 20, 4, 2.8),
    ];
    for (name, mesh, particles, most, bound) in shapes {
        let steepest = steepest(&mesh, &rig_of(&mesh, particles, most));
        println!("{name}, {most} influences: {steepest}");
        assert!(steepest < bound, "{name}, {most} influences: {steepest}");
    }
}

/// Two fingers on a palm.
fn fingers() -> Vec<IVec3> {
    let mut cells = grid(IVec3::ZERO, IVec3::new(5, 1, 2));
    cells.extend(grid(IVec3::new(0, 1, 0), IVec3::new(2, 4, 2)));
    cells.extend(grid(IVec3::new(3, 1, 0), IVec3::new(5, 4, 2)));
    cells
}

#[test]
fn how_finely_a_mesh_is_divided_does_not_matter() {
    let coarse = block([5, 2, 2], 1, Vec3::new(1.0, 0.2, 0.2));
    let fine = block([5, 2, 2], 12, Vec3::new(1.0, 0.2, 0.2));
    let (coarse_rig, fine_rig) = (rig(&coarse, 20), rig(&fine, 20));
    for (p, influences) in coarse.positions.iter().zip(&coarse_rig.skin) {
        let same = fine.positions.iter().position(|q| q.distance(*p) < 1e-5).expect("the fine mesh has all vertices of the coarse one");
        let change = change(influences, &fine_rig.skin[same]);
        assert!(change < 0.02, "{p}: {change}");
    }
}

#[test]
fn doubled_vertices_have_the_same_weights() {
    let whole = block([5, 2, 2], 4, Vec3::new(1.0, 0.2, 0.2));
    let corners: Vec<u32> = whole.triangles.iter().flatten().copied().collect();
    let split = Mesh {
        positions: corners.iter().map(|&v| whole.positions[v as usize]).collect(),
        normals: vec![Vec3::Y; corners.len()],
        triangles: (0..corners.len() as u32 / 3).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect(),
        ..Mesh::default()
    };
    let (whole_rig, split_rig) = (rig(&whole, 20), rig(&split, 20));
    for (at, &v) in corners.iter().enumerate() {
        assert_eq!(split_rig.skin[at], whole_rig.skin[v as usize], "vertex {at}");
    }
}

#[test]
fn a_vertex_follows_what_it_is_near() {
    let mesh = two_fingers(0.05);
    let rig = rig(&mesh, 40);
    let spacing = spacing(&rig);
    for (p, influences) in mesh.positions.iter().zip(&rig.skin) {
        let middle: Vec3 = influences.used().map(|(particle, weight)| rig.particles[particle as usize].position * weight).sum();
        assert!(middle.distance(*p) < 1.5 * spacing, "{p} follows {middle}");
    }
}

#[test]
fn fingers_do_not_follow_each_other() {
    for gap in [0.05, 0.002] {
        let mesh = two_fingers(gap);
        for most in [4, 8] {
            let rig = rig_of(&mesh, 40, most);
            for (p, influences) in mesh.positions.iter().zip(&rig.skin).filter(|(p, _)| p.y > 0.45) {
                let other = |particle: u32| (rig.particles[particle as usize].position.x > 0.5 * gap) != (p.x > 0.5 * gap);
                let share: f32 = influences.used().filter(|used| other(used.0)).map(|used| used.1).sum();
                assert!(share == 0.0, "gap {gap}, {most} influences, {p}: {share} of the other finger");
            }
        }
    }
}

#[test]
fn coils_do_not_follow_each_other() {
    let ring = |s: f32| {
        let (sin, cos) = libm::sincosf(s * (TAU - 0.23));
        Vec3::new(cos, sin, 0.0)
    };
    let coil = |s: f32| {
        let angle = 3.0 + 13.0 * s;
        let (sin, cos) = libm::sincosf(angle);
        Vec3::new(cos, sin, 0.0) * (0.036 * angle)
    };
    let lines: [(&str, &dyn Fn(f32) -> Vec3, u32); 2] = [("a ring", &ring, 200), ("a coil", &coil, 400)];
    for (name, line, rings) in lines {
        let mesh = tube(rings, 0.1, line);
        let rig = rig_of(&mesh, 60, 8);
        // Where along the line a particle lies, in rings.
        let at = |p: Vec3| {
            (0..=rings).min_by(|&a, &b| line(a as f32 / rings as f32).distance(p).total_cmp(&line(b as f32 / rings as f32).distance(p)))
        };
        let places: Vec<u32> = rig.particles.iter().map(|p| at(p.position).expect("there are rings")).collect();
        for (v, influences) in rig.skin.iter().enumerate().take(16 * rings as usize) {
            let ring = v as u32 / 16;
            // Half a turn.
            let share: f32 = influences.used().filter(|used| places[used.0 as usize].abs_diff(ring) > 100).map(|used| used.1).sum();
            assert!(share == 0.0, "{name}, vertex {v}: {share} from afar");
        }
    }
}

/// A turn about z \[rad\].
fn turn(angle: f32) -> Quat {
    let (sin, cos) = libm::sincosf(0.5 * angle);
    Quat::from_xyzw(0.0, 0.0, sin, cos)
}

/// Bends a bar by a quarter turn, each particle rigidly, and compares with the bend itself: how far a vertex is off in units of the bar's
/// thickness, and by how many degrees a triangle is turned.
fn bend(mesh: &Mesh, rig: &Rig, thickness: f32) -> (f32, f32) {
    let radius = 1.0 / FRAC_PI_2;
    let bent = |p: Vec3| {
        let (sin, cos) = libm::sincosf(p.x * FRAC_PI_2);
        let radius = radius + p.y - 0.5 * thickness;
        Vec3::new(radius * sin, radius * cos, p.z)
    };
    let follow = |(p, influences): (&Vec3, &Influences)| {
        let moved = |(particle, weight): (u32, f32)| {
            let centre = rig.particles[particle as usize].position;
            (bent(centre) + turn(-centre.x * FRAC_PI_2) * (*p - centre)) * weight
        };
        influences.used().map(moved).sum::<Vec3>()
    };
    let wanted: Vec<Vec3> = mesh.positions.iter().map(|&p| bent(p)).collect();
    let found: Vec<Vec3> = mesh.positions.iter().zip(&rig.skin).map(follow).collect();
    let off = wanted.iter().zip(&found).map(|(a, b)| a.distance(*b)).fold(0.0, f32::max) / thickness;
    let normal = |at: &[Vec3], t: &[u32; 3]| {
        let [a, b, c] = t.map(|v| at[v as usize]);
        (b - a).cross(c - a)
    };
    let turned = mesh.triangles.iter().map(|t| normal(&wanted, t).angle_between(normal(&found, t)).to_degrees());
    (off, turned.fold(0.0, f32::max))
}

#[test]
fn a_bent_bar_has_no_spikes() {
    let mesh = block([5, 1, 1], 24, Vec3::new(1.0, 0.2, 0.2));
    // With 20 particles a rigid piece is a ninth of the bend: its ends are off by that much.
    for (particles, most, furthest, steepest) in [(20, 4, 0.1, 14.0), (20, 8, 0.1, 11.0), (100, 4, 0.045, 7.5), (100, 8, 0.045, 7.0)] {
        let (off, turned) = bend(&mesh, &rig_of(&mesh, particles, most), 0.2);
        println!("{particles} particles, {most} influences: {off}, {turned}°");
        assert!(off < furthest, "{particles} particles, {most} influences: {off} of the thickness");
        assert!(turned < steepest, "{particles} particles, {most} influences: {turned}°");
    }
}
