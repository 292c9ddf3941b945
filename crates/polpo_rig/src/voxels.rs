//! The inside of the mesh as voxels, and which of them touch: the body that the next stages walk *along*.
//!
//! A voxel is inside if most of three rays through its centre, one an axis, say so. Every connected part of the mesh is counted on
//! its own and the parts are united, so that parts which overlap, as eyes in a head, are solid (a cavity is filled as well). A ray
//! that crosses a part an odd number of times went through a hole in it, and abstains.
//!
//! What is thinner than a voxel (sheets, wire, open scraps) has no inside: there the voxels of the surface itself stand in, so it
//! weighs as if it were one voxel thick. Where the inside is resolved they are left out, they would fatten it by half a voxel.

use std::collections::BTreeMap;

use glam::{DVec3, IVec3};

use crate::clean::{DisjointSets, Surface};

/// Voxels wanted a particle: eight to nine across a cell.
const VOXELS_A_PARTICLE: usize = 600;
/// Where the facets between cells are to be known: eleven across.
const VOXELS_A_CELL: usize = 1400;
/// Fewer voxels than this don't show the shape, more cost seconds.
const VOXELS: std::ops::RangeInclusive<usize> = 60_000..=1_000_000;
/// Bounds of the grid around the body: 16 Mi cells of 6 bytes in all, and voxels along one side.
const GRID_CELLS: f64 = 16.0 * 1024.0 * 1024.0;
const GRID_SIDE: f64 = 4096.0;

/// Length of a step to a neighbour across a face, an edge, a corner: 1, √2, √3 in units of 1/58 voxel, off by less than 0.5 %.
pub(crate) const STEPS: [u32; 3] = [58, 82, 100];
/// Steps in a voxel's side.
pub(crate) const STEPS_A_VOXEL: f64 = 58.0;

pub(crate) const NONE: u32 = u32::MAX;
/// Bits of a grid cell, the first three shifted by the axis: the ray says inside; it abstains; the skin goes out and in again
/// between this voxel and the one before it on the axis; the surface passes through.
const INSIDE: u16 = 1;
const ABSTAINS: u16 = 1 << 3;
const WALL: u16 = 1 << 6;
const SURFACE: u16 = 1 << 9;

/// The body: a list of voxels and the links between them, in the unit box of [`Surface`].
pub(crate) struct Voxels {
    /// Side of a voxel.
    pub(crate) size: f64,
    origin: DVec3,
    pub(crate) dims: IVec3,
    /// Index of the voxel at every cell of the grid, or `NONE`.
    pub(crate) grid: Vec<u32>,
    pub(crate) cells: Vec<IVec3>,
    /// `links[first[v]..first[v + 1]]` are the neighbours of v, packed as neighbour · 4 + kind of step.
    first: Vec<u32>,
    links: Vec<u32>,
}

impl Voxels {
    /// Voxelises a surface finely enough for so many particles, or for facets between their cells, as far as memory and time allow.
    pub(crate) fn new(surface: &Surface, particles: usize, facets: bool) -> Voxels {
        let wanted =
            particles.saturating_mul(if facets { VOXELS_A_CELL } else { VOXELS_A_PARTICLE }).clamp(*VOXELS.start(), *VOXELS.end()) as f64;
        let mut grid = Grid::new(surface, 40.0);
        // The count grows with the third power of the resolution in a solid, the second in a sheet, the first in a wire.
        for _ in 0..5 {
            let count = grid.body().count() as f64;
            if (0.7..1.4).contains(&(wanted / count)) {
                break;
            }
            let finer = Grid::new(surface, grid.resolution * libm::cbrt(wanted / count));
            let bounded = finer.dims == grid.dims;
            grid = finer;
            if bounded {
                break;
            }
        }
        grid.link()
    }

    pub(crate) fn len(&self) -> usize {
        self.cells.len()
    }

    /// The centre of a voxel.
    pub(crate) fn centre(&self, voxel: u32) -> DVec3 {
        self.middle(self.cells[voxel as usize])
    }

    /// The centre of a cell of the grid.
    pub(crate) fn middle(&self, cell: IVec3) -> DVec3 {
        self.origin + (cell.as_dvec3() + 0.5) * self.size
    }

    /// The cell of the grid that a point lies in.
    pub(crate) fn cell(&self, point: DVec3) -> IVec3 {
        ((point - self.origin) / self.size).floor().as_ivec3()
    }

    /// Whether a cell is in the grid.
    pub(crate) fn holds(&self, cell: IVec3) -> bool {
        cell.cmpge(IVec3::ZERO).all() && cell.cmplt(self.dims).all()
    }

    /// The neighbours a body's inside leads to directly, with the length of the step.
    pub(crate) fn neighbours(&self, voxel: u32) -> impl ExactSizeIterator<Item = (u32, u32)> {
        let range = self.first[voxel as usize] as usize..self.first[voxel as usize + 1] as usize;
        self.links[range].iter().map(|link| (link >> 2, STEPS[(link & 3) as usize]))
    }

    /// The voxel a point lies in, if that is one of the body's.
    pub(crate) fn at(&self, point: DVec3) -> Option<u32> {
        self.at_cell(self.cell(point))
    }

    /// The voxel at a cell of the grid, if that is one of the body's.
    pub(crate) fn at_cell(&self, cell: IVec3) -> Option<u32> {
        self.holds(cell).then(|| self.grid[linear(self.dims, cell)]).filter(|&v| v != NONE)
    }

    /// The body's voxel under a point of the skin with outward normal `normal`: the nearest to half a voxel below the skin. (A
    /// normal longer than 1 goes deeper.)
    pub(crate) fn under(&self, point: DVec3, normal: DVec3) -> u32 {
        let below = point - normal * (0.5 * self.size);
        if let Some(voxel) = self.at(below) {
            return voxel;
        }
        let middle = self.cell(below);
        let distance = |v: u32| self.centre(v).distance_squared(below);
        for reach in 1..=3 {
            let around = block(IVec3::splat(-reach), IVec3::splat(reach));
            let nearest = around.filter_map(|offset| self.at_cell(middle + offset)).min_by(|&a, &b| distance(a).total_cmp(&distance(b)));
            if let Some(voxel) = nearest {
                return voxel;
            }
        }
        // Out of reach only if the surface is finer than rounding; then any deterministic answer will do.
        let all = 0..self.len() as u32;
        all.min_by(|&a, &b| distance(a).total_cmp(&distance(b))).unwrap_or(0)
    }

    /// The voxels inside each part of the surface, as (part, voxel), sorted: parts that overlap share some, and the skin's own may be in none.
    pub(crate) fn inside(&self, surface: &Surface) -> Vec<(u32, u32)> {
        let grid = Grid { resolution: 1.0 / self.size, size: self.size, origin: self.origin, dims: self.dims, bits: Vec::new() };
        // Part, voxel, whether the ray abstains.
        let mut votes: Vec<(u32, u32, bool)> = Vec::new();
        for axis in 0..3 {
            let (crossings, spans) = grid.crossings(surface, axis);
            for ray in crossings.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
                let (part, at, _) = ray[0];
                let mut cell = grid.column(axis, at);
                let mut vote = |from: u32, to: u32, abstains: bool| {
                    for w in from..to {
                        cell[axis] = w as i32;
                        votes.extend(self.at_cell(cell).map(|voxel| (part, voxel, abstains)));
                    }
                };
                let (solid, odd) = ray.as_chunks::<2>();
                if odd.is_empty() {
                    solid.iter().for_each(|[enter, leave]| vote(enter.2, leave.2, false));
                } else {
                    vote(spans[&part].0, spans[&part].1, true);
                }
            }
        }
        votes.sort_unstable();
        let most = |votes: &&[(u32, u32, bool)]| {
            let abstain = votes.iter().filter(|vote| vote.2).count();
            2 * (votes.len() - abstain) > 3 - abstain
        };
        votes.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)).filter(most).map(|votes| (votes[0].0, votes[0].1)).collect()
    }

    /// The same voxels with those links alone that `keeps` keeps.
    pub(crate) fn divided(&self, keeps: impl Fn(u32, u32) -> bool) -> Voxels {
        let mut first = vec![0];
        let mut links = Vec::with_capacity(self.links.len());
        for (v, range) in (0..).zip(self.first.windows(2)) {
            let here = &self.links[range[0] as usize..range[1] as usize];
            links.extend(here.iter().filter(|link| keeps(v, **link >> 2)));
            first.push(links.len() as u32);
        }
        Voxels { grid: self.grid.clone(), cells: self.cells.clone(), first, links, ..*self }
    }

    /// The voxel that stands for each connected part of the body: its first.
    pub(crate) fn parts(&self) -> Vec<u32> {
        (0..).zip(self.roots(|_, _| true)).filter(|(v, root)| v == root).map(|(v, _)| v).collect()
    }

    /// For every voxel the first one of what it hangs together with, by those links that `keeps` keeps.
    pub(crate) fn roots(&self, keeps: impl Fn(u32, u32) -> bool) -> Vec<u32> {
        let mut sets = DisjointSets::new(self.len());
        for v in 0..self.len() as u32 {
            for (next, _) in self.neighbours(v).filter(|&(next, _)| keeps(v, next)) {
                sets.join(v, next);
            }
        }
        (0..self.len() as u32).map(|v| sets.root(v)).collect()
    }
}

/// All cells from `min` to `max`, both included, x fastest.
fn block(min: IVec3, max: IVec3) -> impl Iterator<Item = IVec3> {
    (min.z..=max.z).flat_map(move |z| (min.y..=max.y).flat_map(move |y| (min.x..=max.x).map(move |x| IVec3::new(x, y, z))))
}

/// Where a cell stands in the lists of a grid.
pub(crate) fn linear(dims: IVec3, cell: IVec3) -> usize {
    ((cell.z as usize * dims.y as usize) + cell.y as usize) * dims.x as usize + cell.x as usize
}

/// The voxelisation at work: bits for every cell of the box.
struct Grid {
    resolution: f64,
    size: f64,
    origin: DVec3,
    dims: IVec3,
    bits: Vec<u16>,
}

/// Where a ray crosses the skin: part, column, and the number of voxel centres before the crossing.
type Crossing = (u32, u32, u32);

impl Grid {
    /// `resolution` voxels along the longest side, or as many as memory allows.
    fn new(surface: &Surface, resolution: f64) -> Grid {
        let extent = surface.positions.iter().fold(DVec3::ZERO, |a, p| a.max(*p));
        // The box in the middle of the grid, so that a symmetric body has symmetric voxels, with about two voxels of margin. The odd
        // rounding keeps the box's sides off the voxels' centres, where rounding would decide what is inside.
        let dims_at = |n: f64| (extent * n + 0.37).floor() + 4.0;
        let mut resolution = resolution.clamp(1.0, GRID_SIDE).floor();
        while dims_at(resolution).element_product() > GRID_CELLS {
            resolution = (resolution * 0.97).floor();
        }
        let size = 1.0 / resolution;
        let dims = dims_at(resolution).as_ivec3();
        let bits = vec![0; dims.as_usizevec3().element_product()];
        let origin = (extent - dims_at(resolution) * size) * 0.5;
        let mut grid = Grid { resolution, size, origin, dims, bits };
        for axis in 0..3 {
            grid.cast_rays(surface, axis);
        }
        grid.mark_surface(surface);
        grid
    }

    /// Casts a ray along one axis through every column of voxel centres: where each crosses the skin, sorted, and from where to where the parts reach.
    fn crossings(&self, surface: &Surface, axis: usize) -> (Vec<Crossing>, BTreeMap<u32, (u32, u32)>) {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let depth = self.dims[axis] as u32;
        let mut crossings: Vec<Crossing> = Vec::new();
        let mut spans: BTreeMap<u32, (u32, u32)> = BTreeMap::new();
        for t in 0..surface.triangles.len() {
            let part = surface.part[t];
            let corners = surface.corners(t).map(|p| (p - self.origin) / self.size - 0.5);
            let [a, b, c] = corners;
            let low = a[axis].min(b[axis]).min(c[axis]);
            let high = a[axis].max(b[axis]).max(c[axis]);
            let before = |w: f64| (w.ceil().max(0.0) as u32).min(depth);
            let span = spans.entry(part).or_insert((depth, 0));
            *span = (span.0.min(before(low)), span.1.max(before(high)));

            let normal = (b - a).cross(c - a);
            let rows = a[v].min(b[v]).min(c[v]).ceil() as i32..=a[v].max(b[v]).max(c[v]).floor() as i32;
            for row in rows {
                let Some((from, to)) = self.row(surface.triangles[t], corners, row, u, v) else { continue };
                // Half open, from ≤ column < to: a ray through a shared side hits exactly one of its two triangles.
                for column in from.ceil() as i32..to.ceil() as i32 {
                    let du = f64::from(column) - a[u];
                    let dv = f64::from(row) - a[v];
                    let w = a[axis] - (normal[u] * du + normal[v] * dv) / normal[axis];
                    let w = if w.is_nan() { low } else { w.clamp(low, high) };
                    let at = column as u32 * self.dims[v] as u32 + row as u32;
                    crossings.push((part, at, before(w)));
                }
            }
        }
        crossings.sort_unstable();
        (crossings, spans)
    }

    /// The first cell of a ray.
    fn column(&self, axis: usize, at: u32) -> IVec3 {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let mut cell = IVec3::ZERO;
        cell[u] = (at / self.dims[v] as u32) as i32;
        cell[v] = (at % self.dims[v] as u32) as i32;
        cell
    }

    /// Marks what the rays along one axis say.
    fn cast_rays(&mut self, surface: &Surface, axis: usize) {
        let (crossings, spans) = self.crossings(surface, axis);
        for ray in crossings.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
            let (part, at, _) = ray[0];
            let cell = self.column(axis, at);
            if ray.len() % 2 == 1 {
                let (from, to) = spans[&part];
                self.set(cell, axis, from..to, ABSTAINS << axis);
                continue;
            }
            let (solid, _) = ray.as_chunks::<2>();
            for [enter, leave] in solid {
                self.set(cell, axis, enter.2..leave.2, INSIDE << axis);
            }
            for pair in solid.windows(2) {
                let [[a, b], [c, d]] = [pair[0], pair[1]];
                let gap = b.2 == c.2 && a.2 < b.2 && c.2 < d.2;
                if gap {
                    self.set(cell, axis, c.2..c.2 + 1, WALL << axis);
                }
            }
        }
    }

    /// Where the line v = `row` enters and leaves a triangle, if it does. Every side is evaluated the same way for both triangles
    /// that share it (from the vertex with the smaller index), so that no ray slips between them.
    fn row(&self, triangle: [u32; 3], corners: [DVec3; 3], row: i32, u: usize, v: usize) -> Option<(f64, f64)> {
        let at = f64::from(row);
        let mut hits = [0.0; 3];
        let mut count = 0;
        for (i, j) in [(0, 1), (1, 2), (2, 0)] {
            let (i, j) = if triangle[i] < triangle[j] { (i, j) } else { (j, i) };
            let (a, b) = (corners[i], corners[j]);
            if (a[v] > at) != (b[v] > at) {
                hits[count] = a[u] + (at - a[v]) * (b[u] - a[u]) / (b[v] - a[v]);
                count += 1;
            }
        }
        (count == 2).then(|| (hits[0].min(hits[1]), hits[0].max(hits[1])))
    }

    fn set(&mut self, mut cell: IVec3, axis: usize, range: std::ops::Range<u32>, bit: u16) {
        for w in range {
            cell[axis] = w as i32;
            let at = linear(self.dims, cell);
            self.bits[at] |= bit;
        }
    }

    fn mark_surface(&mut self, surface: &Surface) {
        for t in 0..surface.triangles.len() {
            pieces(surface.corners(t), 0.5 * self.size, |centre, _| {
                let cell = ((centre - self.origin) / self.size).floor().as_ivec3();
                let at = linear(self.dims, cell);
                self.bits[at] |= SURFACE;
            });
        }
        // Where the inside is resolved the surface isn't needed; where it isn't, keep it, and its link to what is.
        let uncovered: Vec<IVec3> = self
            .interior()
            .filter(|&c| self.has(c, SURFACE) && !self.inside(c))
            .filter(|&c| !block(IVec3::NEG_ONE, IVec3::ONE).any(|o| self.inside(c + o)))
            .collect();
        let mut keep = vec![false; if uncovered.is_empty() { 0 } else { self.bits.len() }];
        for cell in uncovered {
            for offset in block(IVec3::NEG_ONE, IVec3::ONE) {
                keep[linear(self.dims, cell + offset)] = true;
            }
        }
        for (at, bits) in self.bits.iter_mut().enumerate() {
            if !keep.get(at).is_some_and(|&k| k) {
                *bits &= !SURFACE;
            }
        }
    }

    /// The cells that can be part of the body: the margin around them never is.
    fn interior(&self) -> impl Iterator<Item = IVec3> + use<> {
        block(IVec3::ONE, self.dims - 2)
    }

    fn has(&self, cell: IVec3, bit: u16) -> bool {
        self.bits[linear(self.dims, cell)] & bit != 0
    }

    fn inside(&self, cell: IVec3) -> bool {
        let bits = self.bits[linear(self.dims, cell)];
        let inside = bits & 0b111;
        let abstains = (bits >> 3) & 0b111 & !inside;
        2 * inside.count_ones() > 3 - abstains.count_ones()
    }

    fn body(&self) -> impl Iterator<Item = IVec3> + '_ {
        self.interior().filter(|&c| self.inside(c) || self.has(c, SURFACE))
    }

    /// Lists the body's voxels and links the ones that touch. Across an edge or a corner they are linked only if steps across
    /// faces, none of them through the skin, lead there too: not over a gap thinner than a voxel. Where the surface stands in for
    /// an inside that rule would tear holes, and touching is enough.
    fn link(self) -> Voxels {
        let cells: Vec<IVec3> = self.body().collect();
        let mut grid = vec![NONE; self.bits.len()];
        for (v, &cell) in cells.iter().enumerate() {
            grid[linear(self.dims, cell)] = v as u32;
        }
        let present = |c: IVec3| grid[linear(self.dims, c)] != NONE;
        let face_step = |from: IVec3, axis: usize, by: i32| {
            let mut to = from;
            to[axis] += by;
            let upper = if by > 0 { to } else { from };
            (present(to) && !self.has(upper, WALL << axis)).then_some(to)
        };
        let mut first = vec![0];
        let mut links = Vec::with_capacity(cells.len() * 26);
        for &cell in &cells {
            for offset in block(IVec3::NEG_ONE, IVec3::ONE) {
                let to = cell + offset;
                if offset == IVec3::ZERO || !present(to) {
                    continue;
                }
                let linked = reaches(cell, offset, &face_step)
                    || (offset.abs().element_sum() > 1 && (self.has(cell, SURFACE) || self.has(to, SURFACE)));
                if linked {
                    let kind = offset.abs().element_sum() as u32 - 1;
                    links.push(grid[linear(self.dims, to)] << 2 | kind);
                }
            }
            first.push(links.len() as u32);
        }
        Voxels { size: self.size, origin: self.origin, dims: self.dims, grid, cells, first, links }
    }
}

/// Whether face steps lead from a cell to `cell + offset`, in any order of the axes.
fn reaches(cell: IVec3, offset: IVec3, face_step: &impl Fn(IVec3, usize, i32) -> Option<IVec3>) -> bool {
    if offset == IVec3::ZERO {
        return true;
    }
    (0..3).filter(|&axis| offset[axis] != 0).any(|axis| {
        let mut rest = offset;
        rest[axis] = 0;
        face_step(cell, axis, offset[axis]).is_some_and(|next| reaches(next, rest, face_step))
    })
}

/// Cuts a triangle at its longest side until no side is longer than `longest`, and hands out middle and area of every piece.
pub(crate) fn pieces(triangle: [DVec3; 3], longest: f64, mut visit: impl FnMut(DVec3, f64)) {
    let mut stack = vec![triangle];
    while let Some([a, b, c]) = stack.pop() {
        let sides = [a.distance_squared(b), b.distance_squared(c), c.distance_squared(a)];
        let side = sides[0].max(sides[1]).max(sides[2]);
        if side <= longest * longest {
            visit((a + b + c) / 3.0, (b - a).cross(c - a).length() * 0.5);
        } else if side == sides[0] {
            let m = (a + b) * 0.5;
            stack.extend([[a, m, c], [m, b, c]]);
        } else if side == sides[1] {
            let m = (b + c) * 0.5;
            stack.extend([[b, m, a], [m, c, a]]);
        } else {
            let m = (c + a) * 0.5;
            stack.extend([[c, m, b], [m, a, b]]);
        }
    }
}
