//! The voxelisation: which cells of a grid are inside the mesh.
//!
//! A voxel is inside if most of three rays through its centre, one an axis, say so. Every connected part of the mesh is counted on
//! its own and the parts are united, so that parts which overlap, as eyes in a head, are solid (a cavity is filled as well). A ray
//! that crosses a part an odd number of times went through a hole in it, and abstains. Sheets have no inside, unless several close one.
//!
//! What is thinner than a voxel (sheets, wire, open scraps) has no inside: there the voxels of the surface itself stand in, so it
//! weighs as if it were one voxel thick. Where the inside is resolved they are left out, they would fatten it by half a voxel.

use glam::{DVec3, IVec3};

use crate::clean::Surface;
use crate::voxels::Voxels;

/// Bounds of the grid around the body: 16 Mi cells of 6 bytes in all, and voxels along one side.
const GRID_CELLS: f64 = 16.0 * 1024.0 * 1024.0;
const GRID_SIDE: f64 = 4096.0;

/// Bits of a grid cell, the first three shifted by the axis: the ray says inside; it abstains; the skin goes out and in again
/// between this voxel and the one before it on the axis; the surface passes through.
const INSIDE: u16 = 1;
const ABSTAINS: u16 = 1 << 3;
const WALL: u16 = 1 << 6;
const SURFACE: u16 = 1 << 9;

/// Bits for every cell of the box.
pub(crate) struct Grid {
    resolution: f64,
    /// Side of a voxel.
    pub(crate) size: f64,
    pub(crate) origin: DVec3,
    pub(crate) dims: IVec3,
    pub(crate) bits: Vec<u16>,
}

/// Where a ray crosses the skin: part, column, and the number of voxel centres before the crossing.
pub(crate) type Crossing = (u32, u32, u32);

impl Grid {
    /// `resolution` voxels along the longest side, or as many as memory allows.
    pub(crate) fn new(surface: &Surface, resolution: f64) -> Grid {
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

    /// Refines or coarsens a grid until the body has about so many voxels, as far as memory allows.
    pub(crate) fn refined(self, surface: &Surface, wanted: f64) -> Grid {
        let mut grid = self;
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
        grid
    }

    /// A grid without bits, for its rays alone.
    pub(crate) fn empty(resolution: f64, size: f64, origin: DVec3, dims: IVec3) -> Grid {
        Grid { resolution, size, origin, dims, bits: Vec::new() }
    }

    /// Casts a ray along one axis through every column of voxel centres: where each crosses the skin, sorted, and from where to where the parts reach.
    pub(crate) fn crossings(&self, surface: &Surface, axis: usize) -> (Vec<Crossing>, Vec<(u32, u32)>) {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let depth = self.dims[axis] as u32;
        let mut crossings: Vec<Crossing> = Vec::new();
        let mut spans = vec![(depth, 0); surface.solid.len()];
        for t in 0..surface.triangles.len() {
            let Some(part) = surface.solid[surface.part[t] as usize] else { continue };
            let corners = surface.corners(t).map(|p| (p - self.origin) / self.size - 0.5);
            let [a, b, c] = corners;
            let low = a[axis].min(b[axis]).min(c[axis]);
            let high = a[axis].max(b[axis]).max(c[axis]);
            let before = |w: f64| (w.ceil().max(0.0) as u32).min(depth);
            let span = &mut spans[part as usize];
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
    pub(crate) fn column(&self, axis: usize, at: u32) -> IVec3 {
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
                let (from, to) = spans[part as usize];
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

    /// Where a part of the mesh hangs together, but its voxels do not, since it is hardly thicker than they are, the surface stands in
    /// around all pieces but the largest; true if there were any.
    pub(crate) fn mend(&mut self, surface: &Surface, voxels: &Voxels) -> bool {
        let roots = voxels.roots(|_, _| true);
        if roots.iter().all(|&root| root == 0) {
            return false;
        }
        // The voxel part under the surface, at every cell that it passes through.
        let mut through: Vec<(u32, u32, u32)> = Vec::new();
        for (t, &normal) in surface.normals().iter().enumerate() {
            pieces(surface.corners(t), 0.5 * self.size, |centre, _| {
                let cell = ((centre - self.origin) / self.size).floor().as_ivec3();
                let item = (surface.part[t], roots[voxels.under(centre, normal) as usize], linear(self.dims, cell) as u32);
                if through.last() != Some(&item) {
                    through.push(item);
                }
            });
        }
        through.sort_unstable();
        through.dedup();
        // The largest is the one with the most cells.
        let mut largest = vec![(0, u32::MAX); surface.solid.len()];
        for cells in through.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
            let most = &mut largest[cells[0].0 as usize];
            if cells.len() > most.0 {
                *most = (cells.len(), cells[0].1);
            }
        }
        let mut loose = vec![false; self.bits.len()];
        let mut any = false;
        for &(_, _, at) in through.iter().filter(|p| p.1 != largest[p.0 as usize].1) {
            any = true;
            let cell = delinear(self.dims, at);
            for offset in block(IVec3::NEG_ONE, IVec3::ONE) {
                loose[linear(self.dims, cell + offset)] = true;
            }
        }
        through.iter().filter(|p| loose[p.2 as usize]).for_each(|p| self.bits[p.2 as usize] |= SURFACE);
        any
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

    /// Whether the voxel that a point lies in is inside.
    pub(crate) fn holds(&self, point: DVec3) -> bool {
        let cell = ((point - self.origin) / self.size).floor().as_ivec3();
        let there = cell.cmpge(IVec3::ZERO).all() && cell.cmplt(self.dims).all();
        there && self.inside(cell)
    }

    pub(crate) fn surface(&self, cell: IVec3) -> bool {
        self.has(cell, SURFACE)
    }

    /// Whether the skin goes out and in again between a cell and the one before it on an axis.
    pub(crate) fn wall(&self, cell: IVec3, axis: usize) -> bool {
        self.has(cell, WALL << axis)
    }

    /// Whether there is an inside at all, at this resolution.
    pub(crate) fn has_inside(&self) -> bool {
        self.interior().any(|c| self.inside(c))
    }

    /// The cells that can be part of the body: the margin around them never is.
    fn interior(&self) -> impl Iterator<Item = IVec3> + use<> {
        block(IVec3::ONE, self.dims - 2)
    }

    fn has(&self, cell: IVec3, bit: u16) -> bool {
        self.bits[linear(self.dims, cell)] & bit != 0
    }

    pub(crate) fn inside(&self, cell: IVec3) -> bool {
        let bits = self.bits[linear(self.dims, cell)];
        let inside = bits & 0b111;
        let abstains = (bits >> 3) & 0b111 & !inside;
        2 * inside.count_ones() > 3 - abstains.count_ones()
    }

    pub(crate) fn body(&self) -> impl Iterator<Item = IVec3> + '_ {
        self.interior().filter(|&c| self.inside(c) || self.has(c, SURFACE))
    }
}

/// All cells from `min` to `max`, both included, x fastest.
pub(crate) fn block(min: IVec3, max: IVec3) -> impl Iterator<Item = IVec3> {
    (min.z..=max.z).flat_map(move |z| (min.y..=max.y).flat_map(move |y| (min.x..=max.x).map(move |x| IVec3::new(x, y, z))))
}

pub(crate) fn linear(dims: IVec3, cell: IVec3) -> usize {
    ((cell.z as usize * dims.y as usize) + cell.y as usize) * dims.x as usize + cell.x as usize
}

/// The cell at a place of [`linear`].
fn delinear(dims: IVec3, at: u32) -> IVec3 {
    let at = at as i32;
    IVec3::new(at % dims.x, at / dims.x % dims.y, at / (dims.x * dims.y))
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
