//! The mesh as the stages want it: welded, without degenerate or doubled triangles, in a unit box, in f64.

use glam::DVec3;

use crate::{Mesh, MeshError};

/// A part whose area vectors add up to more than this share of its area is a sheet. A closed one adds up to 0, a box without a lid to
/// 0.2, half a ball to 0.5, a flat sheet to 1.
const SHEET: f64 = 0.6;

/// A welded mesh, moved and scaled so that its longest side is 1: the stages that follow see the same shape at every scale.
pub(crate) struct Surface {
    /// Welded vertices, within 0..1.
    pub(crate) positions: Vec<DVec3>,
    /// What is left of the mesh's triangles; they have an area and no two have the same corners.
    pub(crate) triangles: Vec<[u32; 3]>,
    /// The connected part each triangle belongs to, numbered from 0 in the order of the triangles.
    pub(crate) part: Vec<u32>,
    /// +1 or -1 a part: -1 where the triangles wind clockwise seen from outside.
    pub(crate) winding: Vec<f64>,
    /// What each part is counted with where inside and outside are told apart; `None` for a sheet, which has no inside.
    pub(crate) solid: Vec<Option<u32>>,
    /// The welded vertex of every vertex of the mesh.
    pub(crate) welded: Vec<u32>,
    /// A mesh position is `origin + scale · position`.
    pub(crate) origin: DVec3,
    /// The longest side of the mesh's bounding box \[m\], positive.
    pub(crate) scale: f64,
}

impl Surface {
    /// Welds vertices at exactly the same place (-0 is 0): seams of normals and texture coordinates are closed, a crack is not.
    pub(crate) fn new(mesh: &Mesh) -> Result<Surface, MeshError> {
        mesh.validate()?;
        let mut min = DVec3::INFINITY;
        let mut max = DVec3::NEG_INFINITY;
        for p in &mesh.positions {
            min = min.min(p.as_dvec3());
            max = max.max(p.as_dvec3());
        }
        let scale = (max - min).max_element();

        let mut order: Vec<u32> = (0..mesh.positions.len() as u32).collect();
        // Adding 0 turns -0 into 0.
        let key = |v: u32| mesh.positions[v as usize].to_array().map(|x| (x + 0.0).to_bits());
        order.sort_unstable_by_key(|&v| (key(v), v));
        let mut welded = vec![0; mesh.positions.len()];
        let mut first = order[0];
        for &v in &order {
            if key(v) != key(first) {
                first = v;
            }
            welded[v as usize] = first;
        }
        // Welded vertices are numbered in the order of the mesh, so that neighbours in memory stay neighbours.
        let mut positions = Vec::new();
        for v in 0..welded.len() {
            if welded[v] as usize == v {
                welded[v] = positions.len() as u32;
                positions.push((mesh.positions[v].as_dvec3() - min) / scale);
            } else {
                // The first of its place has a smaller index, and is renumbered already.
                welded[v] = welded[welded[v] as usize];
            }
        }

        let sorted = |mut t: [u32; 3]| {
            t.sort_unstable();
            t
        };
        // A sliver whose area f64 rounds to nothing carries no direction either.
        let welded_triangles = mesh.triangles.iter().map(|t| t.map(|v| welded[v as usize]));
        let with_area: Vec<[u32; 3]> = welded_triangles.filter(|&t| area_vector(&positions, t).length_squared() > 1e-40).collect();
        let mut order: Vec<u32> = (0..with_area.len() as u32).collect();
        order.sort_unstable_by_key(|&t| (sorted(with_area[t as usize]), t));
        order.dedup_by_key(|t| sorted(with_area[*t as usize]));
        order.sort_unstable();
        let triangles: Vec<[u32; 3]> = order.into_iter().map(|t| with_area[t as usize]).collect();
        if triangles.is_empty() {
            return Err(MeshError::NoArea { name: mesh.name.clone(), triangles: mesh.triangles.len() });
        }
        let part = parts(positions.len(), &triangles);
        let winding = windings(&positions, &triangles, &part);
        let solid = solids(&positions, &triangles, &part, winding.len());
        Ok(Surface { positions, triangles, part, winding, solid, welded, origin: min, scale })
    }

    /// The corners of a triangle.
    pub(crate) fn corners(&self, triangle: usize) -> [DVec3; 3] {
        self.triangles[triangle].map(|v| self.positions[v as usize])
    }

    /// The volume inside all parts but the sheets, each for itself, if they are closed: every side is walked up as often as down.
    pub(crate) fn volume(&self) -> Option<f64> {
        let mut sides: Vec<([u32; 2], i32)> = Vec::with_capacity(self.triangles.len() * 3);
        let mut volume = 0.0;
        for (t, &[a, b, c]) in self.triangles.iter().enumerate() {
            let part = self.part[t] as usize;
            if self.solid[part].is_none() {
                continue;
            }
            sides.extend([[a, b], [b, c], [c, a]].map(|[a, b]| ([a.min(b), a.max(b)], if a < b { 1 } else { -1 })));
            let [a, b, c] = self.corners(t);
            volume += self.winding[part] * a.dot(b.cross(c)) / 6.0;
        }
        sides.sort_unstable();
        let closed = sides.chunk_by(|a, b| a.0 == b.0).all(|side| side.iter().map(|s| s.1).sum::<i32>() == 0);
        (closed && volume > 0.0).then_some(volume)
    }

    /// The unit normal of every triangle, turned outwards.
    pub(crate) fn normals(&self) -> Vec<DVec3> {
        let normal = |(t, part): (&[u32; 3], &u32)| area_vector(&self.positions, *t).normalize_or_zero() * self.winding[*part as usize];
        self.triangles.iter().zip(&self.part).map(normal).collect()
    }
}

/// Half the cross product of two sides: direction of the normal, length of the area.
fn area_vector(positions: &[DVec3], t: [u32; 3]) -> DVec3 {
    let [a, b, c] = t.map(|v| positions[v as usize]);
    (b - a).cross(c - a) * 0.5
}

/// Numbers the parts that hang together by shared vertices.
fn parts(vertices: usize, triangles: &[[u32; 3]]) -> Vec<u32> {
    let mut sets = DisjointSets::new(vertices);
    for &[a, b, c] in triangles {
        sets.join(a, b);
        sets.join(b, c);
    }
    let mut number = vec![u32::MAX; vertices];
    let mut count = 0;
    let mut part = Vec::with_capacity(triangles.len());
    for t in triangles {
        let slot = &mut number[sets.root(t[0]) as usize];
        if *slot == u32::MAX {
            *slot = count;
            count += 1;
        }
        part.push(*slot);
    }
    part
}

/// The sign of the volume each part encloses, seen from its own middle so that an open part gets its best guess.
fn windings(positions: &[DVec3], triangles: &[[u32; 3]], part: &[u32]) -> Vec<f64> {
    let count = part.iter().max().map_or(0, |&p| p as usize + 1);
    let mut middle = vec![DVec3::ZERO; count];
    let mut area = vec![0.0; count];
    for (t, &p) in triangles.iter().zip(part) {
        let [a, b, c] = t.map(|v| positions[v as usize]);
        let weight = area_vector(positions, *t).length();
        middle[p as usize] += (a + b + c) * (weight / 3.0);
        area[p as usize] += weight;
    }
    let mut volume = vec![0.0; count];
    for (t, &p) in triangles.iter().zip(part) {
        let p = p as usize;
        let [a, b, c] = t.map(|v| positions[v as usize] - middle[p] / area[p]);
        volume[p] += a.dot(b.cross(c));
    }
    volume.into_iter().map(|v| if v < 0.0 { -1.0 } else { 1.0 }).collect()
}

/// What each part is counted with: for itself, unless it faces mostly one way. Such sheets are counted together, since they may close
/// a body between them, as the sides of a box that are not welded; if together they face one way still, as cloth and
/// ground do, they have no inside.
fn solids(positions: &[DVec3], triangles: &[[u32; 3]], part: &[u32], count: usize) -> Vec<Option<u32>> {
    let mut facing = vec![DVec3::ZERO; count];
    let mut area = vec![0.0; count];
    for (t, &p) in triangles.iter().zip(part) {
        let vector = area_vector(positions, *t);
        facing[p as usize] += vector;
        area[p as usize] += vector.length();
    }
    let sheets: Vec<usize> = (0..count).filter(|&p| facing[p].length() > SHEET * area[p]).collect();
    let together: DVec3 = sheets.iter().map(|&p| facing[p]).sum();
    let closes = together.length() <= SHEET * sheets.iter().map(|&p| area[p]).sum::<f64>();
    let mut solid: Vec<Option<u32>> = (0..count as u32).map(Some).collect();
    for &p in &sheets {
        solid[p] = closes.then_some(sheets[0] as u32);
    }
    solid
}

/// Union-find over 0..n; roots are the smallest index of their set.
pub(crate) struct DisjointSets(Vec<u32>);

impl DisjointSets {
    pub(crate) fn new(count: usize) -> DisjointSets {
        DisjointSets((0..count as u32).collect())
    }

    pub(crate) fn root(&mut self, mut item: u32) -> u32 {
        while self.0[item as usize] != item {
            let above = self.0[self.0[item as usize] as usize];
            self.0[item as usize] = above;
            item = above;
        }
        item
    }

    /// Joins the sets of two items; false if they were one already.
    pub(crate) fn join(&mut self, a: u32, b: u32) -> bool {
        let (a, b) = (self.root(a), self.root(b));
        self.0[a.max(b) as usize] = a.min(b);
        a != b
    }
}
