//! Solids to rig: made of cubes and then shaped, clamped at x = 0.

use std::collections::BTreeMap;

use glam::{DVec3, IVec3, Quat, Vec3};
use polpo_rig::Mesh;

/// A solid of cubes on a grid, whose corners `place` moves to where they are to be \[m\].
#[derive(Clone, Copy)]
pub(crate) struct Solid {
    pub(crate) name: &'static str,
    /// Cubes along each axis.
    pub(crate) counts: [i32; 3],
    pub(crate) has: fn(IVec3) -> bool,
    pub(crate) place: fn(Vec3) -> Vec3,
}

impl Solid {
    pub(crate) fn cubes(&self) -> Vec<IVec3> {
        let [x, y, z] = self.counts;
        let all = (0..x).flat_map(|i| (0..y).flat_map(move |j| (0..z).map(move |k| IVec3::new(i, j, k))));
        all.filter(|&c| (self.has)(c)).collect()
    }

    /// The skin, turned and moved.
    pub(crate) fn mesh(&self, turn: Quat, by: Vec3) -> Mesh {
        let cubes = self.cubes();
        let mut corners: BTreeMap<[i32; 3], u32> = BTreeMap::new();
        let mut mesh = Mesh { name: self.name.into(), ..Mesh::default() };
        for &cube in &cubes {
            for axis in 0..3 {
                for side in [0, 1] {
                    let mut normal = IVec3::ZERO;
                    normal[axis] = 2 * side - 1;
                    if cubes.contains(&(cube + normal)) {
                        continue;
                    }
                    let mut corner = |u: i32, v: i32| {
                        let mut at = cube;
                        at[axis] += side;
                        at[(axis + 1) % 3] += u;
                        at[(axis + 2) % 3] += v;
                        *corners.entry(at.to_array()).or_insert_with(|| {
                            mesh.positions.push(turn * (self.place)(at.as_vec3()) + by);
                            mesh.positions.len() as u32 - 1
                        })
                    };
                    let [a, b, c, d] = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)];
                    mesh.triangles.extend(if side == 1 { [[a, b, c], [a, c, d]] } else { [[a, c, b], [a, d, c]] });
                }
            }
        }
        mesh.normals = vec![Vec3::Y; mesh.positions.len()];
        mesh
    }

    /// The face at one end of the x axis in small squares: their middles and areas. At the wall, or the far one.
    pub(crate) fn face(&self, far: bool) -> Vec<(DVec3, f64)> {
        const CUTS: i32 = 60;
        let cubes = self.cubes();
        let end = if far { self.counts[0] } else { 0 };
        let mut squares = Vec::new();
        for cube in cubes.iter().filter(|c| c.x == if far { end - 1 } else { 0 }) {
            // Faces of many cubes take fewer cuts each.
            let cuts = (CUTS / self.counts[1].max(self.counts[2])).max(4);
            for i in 0..cuts {
                for j in 0..cuts {
                    let at = |u: f32, v: f32| {
                        (self.place)(Vec3::new(
                            end as f32,
                            cube.y as f32 + (i as f32 + u) / cuts as f32,
                            cube.z as f32 + (j as f32 + v) / cuts as f32,
                        ))
                        .as_dvec3()
                    };
                    let area = (at(1.0, 0.0) - at(0.0, 0.0)).cross(at(0.0, 1.0) - at(0.0, 0.0)).length();
                    squares.push((at(0.5, 0.5), area));
                }
            }
        }
        squares
    }
}

pub(crate) const SLENDER: Solid =
    Solid { name: "bar 10 : 1", counts: [1, 1, 1], has: |_| true, place: |p| (p - Vec3::new(0.0, 0.5, 0.5)) * Vec3::new(1.0, 0.1, 0.1) };

pub(crate) const STOUT: Solid =
    Solid { name: "bar 5 : 1", counts: [1, 1, 1], has: |_| true, place: |p| (p - Vec3::new(0.0, 0.5, 0.5)) * Vec3::new(1.0, 0.2, 0.2) };

/// So thin that its cells are a chain.
pub(crate) const WIRE: Solid =
    Solid { name: "wire 33 : 1", counts: [1, 1, 1], has: |_| true, place: |p| (p - Vec3::new(0.0, 0.5, 0.5)) * Vec3::new(1.0, 0.03, 0.03) };

/// From 0.12 to 0.06 m thick.
pub(crate) const TAPERED: Solid = Solid {
    name: "tapered limb",
    counts: [1, 1, 1],
    has: |_| true,
    place: |p| {
        let side = 0.12 - 0.06 * p.x;
        (p - Vec3::new(0.0, 0.5, 0.5)) * Vec3::new(1.0, side, side)
    },
};

/// Of 0.2 m square, 1 m out of the wall and 1 m up.
pub(crate) const ANGLE: Solid =
    Solid { name: "L", counts: [5, 5, 1], has: |c| c.y == 0 || c.x == 4, place: |p| (p - Vec3::new(0.0, 0.5, 0.5)) * 0.2 };

pub(crate) const BLOCK: Solid = Solid { name: "block", counts: [5, 4, 3], has: |_| true, place: |p| (p - Vec3::new(0.0, 2.0, 1.5)) * 0.2 };
