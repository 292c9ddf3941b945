//! Shapes to rig, and what the tests ask of a rig.
#![allow(dead_code, reason = "every test file uses a part of it")]
#![allow(unreachable_pub, reason = "shared by the test files, which have no library of their own")]

use std::collections::BTreeMap;

use glam::{IVec3, Vec3};
use polpo_rig::{Mesh, MeshPart, Recipe, Rig, build_rig};

/// A closed mesh around unit cubes, moved by `place` to where its corners are to be. Sides inside the shape are left out, corners are
/// shared. Every face of a cube is cut into `cuts` × `cuts` squares.
pub fn cubes(cells: &[IVec3], cuts: i32, place: impl Fn(Vec3) -> Vec3) -> Mesh {
    let mut corners: BTreeMap<[i32; 3], u32> = BTreeMap::new();
    let mut mesh = Mesh { name: "cubes".into(), ..Mesh::default() };
    for &cell in cells {
        for axis in 0..3 {
            for side in [0, 1] {
                let mut normal = IVec3::ZERO;
                normal[axis] = 2 * side - 1;
                if cells.contains(&(cell + normal)) {
                    continue;
                }
                let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
                for i in 0..cuts {
                    for j in 0..cuts {
                        let mut corner = |di: i32, dj: i32| {
                            let mut at = cell * cuts;
                            at[axis] += side * cuts;
                            at[u] += i + di;
                            at[v] += j + dj;
                            let next = mesh.positions.len() as u32;
                            *corners.entry(at.to_array()).or_insert_with(|| {
                                mesh.positions.push(place(at.as_vec3() / cuts as f32));
                                next
                            })
                        };
                        let [a, b, c, d] = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)];
                        let outwards = [[a, b, c], [a, c, d]];
                        let inwards = [[a, c, b], [a, d, c]];
                        mesh.triangles.extend(if side == 1 { outwards } else { inwards });
                    }
                }
            }
        }
    }
    mesh.normals = vec![Vec3::Y; mesh.positions.len()];
    mesh
}

/// A box of `counts` cubes, each cut in `cuts`, with the given sides.
pub fn block(counts: [i32; 3], cuts: i32, sides: Vec3) -> Mesh {
    let counts = IVec3::from(counts);
    let scale = sides / counts.as_vec3();
    cubes(&grid(IVec3::ZERO, counts), cuts, |p| p * scale)
}

/// All cells from `low` up to but without `high`.
pub fn grid(low: IVec3, high: IVec3) -> Vec<IVec3> {
    let mut cells = Vec::new();
    for x in low.x..high.x {
        for y in low.y..high.y {
            for z in low.z..high.z {
                cells.push(IVec3::new(x, y, z));
            }
        }
    }
    cells
}

/// Two fingers, 0.22 and 0.2 wide and 1 long, on a palm 0.2 high, with a gap between them as wide as told. They differ so that the
/// gap does not lie in the middle of the voxels.
pub fn two_fingers(gap: f32) -> Mesh {
    let mut cells = grid(IVec3::new(0, 0, 0), IVec3::new(5, 1, 2));
    cells.extend(grid(IVec3::new(0, 1, 0), IVec3::new(2, 6, 2)));
    cells.extend(grid(IVec3::new(3, 1, 0), IVec3::new(5, 6, 2)));
    cubes(&cells, 2, |p| {
        let x = if p.x <= 2.0 {
            p.x * 0.11 - 0.22
        } else if p.x >= 3.0 {
            (p.x - 3.0) * 0.1 + gap
        } else {
            (p.x - 2.0) * gap
        };
        Vec3::new(x, p.y * 0.2, p.z * 0.1)
    })
}

/// Two meshes in one.
pub fn both(mut a: Mesh, b: Mesh) -> Mesh {
    let base = a.positions.len() as u32;
    a.positions.extend(b.positions);
    a.normals.extend(b.normals);
    a.triangles.extend(b.triangles.iter().map(|t| t.map(|v| v + base)));
    a
}

/// A piece of a mesh: names of node, mesh and material, and where its points go.
pub type Piece<'a> = (&'a str, &'a str, &'a str, Mesh, &'a dyn Fn(Vec3) -> Vec3);

/// Meshes in one, a part each.
pub fn assemble(meshes: &[Piece]) -> Mesh {
    let mut whole = Mesh { name: "parts".into(), ..Mesh::default() };
    for &(node, name, material, ref mesh, place) in meshes {
        let [vertices, triangles] = [whole.positions.len() as u32, whole.triangles.len() as u32];
        whole = both(whole, Mesh { positions: mesh.positions.iter().map(|&p| place(p)).collect(), ..mesh.clone() });
        whole.parts.push(MeshPart {
            node: node.into(),
            name: name.into(),
            material: material.into(),
            vertices: vertices..whole.positions.len() as u32,
            triangles: triangles..whole.triangles.len() as u32,
        });
    }
    whole
}

/// Where the wheels of [`truck`] begin.
pub const WHEELS: [[f32; 3]; 4] = [[0.2, 0.0, 0.0], [0.2, 0.0, 0.7], [2.3, 0.0, 0.0], [2.3, 0.0, 0.7]];

/// A chassis of 3 × 0.5 × 1 on four wheels of 0.5 × 0.5 × 0.3 that touch it from below, nodes `Chassis` and `Wheel 0` to `Wheel 3`.
pub fn truck() -> Mesh {
    truck_on(WHEELS)
}

/// [`truck`] with its wheels elsewhere.
pub fn truck_on(wheels: [[f32; 3]; 4]) -> Mesh {
    let chassis = block([3, 1, 1], 2, Vec3::new(3.0, 0.5, 1.0));
    let up = |p: Vec3| p + Vec3::Y * 0.5;
    let mut meshes: Vec<Piece> = vec![("Chassis", "Box", "paint", chassis, &up)];
    let places = wheels.map(|at| move |p: Vec3| p + Vec3::from(at));
    let names = ["Wheel 0", "Wheel 1", "Wheel 2", "Wheel 3"];
    for (name, place) in names.into_iter().zip(&places) {
        meshes.push((name, "Wheel", "rubber", block([1, 1, 1], 1, Vec3::new(0.5, 0.5, 0.3)), place));
    }
    assemble(&meshes)
}

pub fn moved(mut mesh: Mesh, by: Vec3) -> Mesh {
    mesh.positions.iter_mut().for_each(|p| *p += by);
    mesh
}

/// Settings for so many particles and two and a half times the edges.
pub fn settings(particles: usize) -> Recipe {
    Recipe::with_particles(particles)
}

pub fn rig(mesh: &Mesh, particles: usize) -> Rig {
    build_rig(mesh, &settings(particles)).expect("the shape can be rigged")
}

/// In how many pieces the edges leave the particles.
pub fn pieces(rig: &Rig) -> usize {
    let mut piece: Vec<u32> = (0..rig.particles.len() as u32).collect();
    loop {
        let before = piece.clone();
        for &[a, b] in &rig.edges {
            let least = piece[a as usize].min(piece[b as usize]);
            piece[a as usize] = least;
            piece[b as usize] = least;
        }
        if piece == before {
            piece.sort_unstable();
            piece.dedup();
            return piece.len();
        }
    }
}

/// The mean length of the edges.
pub fn spacing(rig: &Rig) -> f32 {
    let length = |e: &[u32; 2]| rig.particles[e[0] as usize].position.distance(rig.particles[e[1] as usize].position);
    rig.edges.iter().map(length).sum::<f32>() / rig.edges.len() as f32
}
