//! How full voxels are: the share of each, and of each face between two, that is in the body.
//!
//! A voxel is in the body or not; a bar of eighteen voxels and a fifth counts eighteen or nineteen across, and bends by a tenth too little. So near the skin what a voxel or a face holds is cut by the skin's plane there, or by
//! two where it has an edge: a box of side s whose middle is d below a plane with normal n is full to ½ + d/(s·|n|₁), exactly so if the plane is along a side. Voxels that the body only reaches into, with less than half of
//! them, count with the nearest one that is the body's.

use glam::{DVec3, IVec3};

use crate::clean::Surface;
use crate::grid::{linear, pieces};
use crate::voxels::{NONE, STEPS, Voxels};

/// Two pieces of skin make an edge if the cosine between their normals is less.
const EDGE: f64 = 0.7;
/// A voxel of the body is never emptier: the particle in it has a mass.
const EMPTIEST: f64 = 0.01;

/// A plane of the skin: a point of it, and its normal.
type Plane = (DVec3, DVec3);

/// The shares of voxels and faces that are in the body.
pub(crate) struct Fill<'a> {
    pub(crate) voxels: &'a Voxels,
    /// For each voxel of the body, the volume that counts with it in voxels, and the middle of that.
    pub(crate) parts: Vec<(f64, DVec3)>,
    planes: Vec<Plane>,
    /// Where a cell of the grid stands in `near`, or `NONE`.
    slot: Vec<u32>,
    /// The nearest planes of the cells near the skin, or `NONE`.
    near: Vec<[u32; 2]>,
    /// Cells that the body reaches into, and the voxel each counts with.
    outer: Vec<(IVec3, u32)>,
    /// The voxel each cell of the grid counts with, or `NONE`.
    host: Vec<u32>,
}

impl Fill<'_> {
    pub(crate) fn new<'a>(surface: &Surface, voxels: &'a Voxels) -> Fill<'a> {
        let (slot, host) = (vec![NONE; voxels.index.len()], voxels.index.clone());
        let mut fill = Fill { voxels, parts: Vec::new(), planes: Vec::new(), slot, near: Vec::new(), outer: Vec::new(), host };
        fill.gather(surface);
        fill.find_nearest();
        fill.parts = (0..voxels.len() as u32).map(|v| fill.part(voxels.cells[v as usize], EMPTIEST)).collect();
        fill.reach_out();
        fill
    }

    /// The pieces of the skin that have the outside on one side.
    fn gather(&mut self, surface: &Surface) {
        let size = self.voxels.size;
        let body = |place: DVec3| self.voxels.at(place).is_some();
        let mut planes = Vec::new();
        for (t, &normal) in surface.normals().iter().enumerate() {
            pieces(surface.corners(t), 0.5 * size, |middle, _| {
                let within = body(middle + normal * (1.1 * size)) && body(middle - normal * (1.1 * size));
                if !within {
                    planes.push((middle, normal));
                }
            });
        }
        self.planes = planes;
    }

    /// The nearest plane of every cell near the skin, then the nearest that makes an edge with it.
    fn find_nearest(&mut self) {
        let voxels = self.voxels;
        for second in [false, true] {
            for k in 0..self.planes.len() {
                let (point, normal) = self.planes[k];
                let middle = voxels.cell(point);
                for offset in around() {
                    let cell = middle + offset;
                    if !voxels.holds(cell) {
                        continue;
                    }
                    let slot = &mut self.slot[linear(voxels.dims, cell)];
                    if *slot == NONE {
                        *slot = self.near.len() as u32;
                        self.near.push([NONE; 2]);
                    }
                    let near = &mut self.near[*slot as usize];
                    if second && self.planes[near[0] as usize].1.dot(normal) > EDGE {
                        continue;
                    }
                    let best = &mut near[usize::from(second)];
                    let centre = voxels.middle(cell);
                    if *best == NONE || centre.distance_squared(point) < centre.distance_squared(self.planes[*best as usize].0) {
                        *best = k as u32;
                    }
                }
            }
        }
    }

    /// The planes near a cell, the nearest first.
    fn planes_at(&self, cell: IVec3) -> impl Iterator<Item = Plane> {
        let slot = self.slot[linear(self.voxels.dims, cell)];
        let near = if slot == NONE { [NONE; 2] } else { self.near[slot as usize] };
        near.into_iter().filter(|&k| k != NONE).map(|k| self.planes[k as usize])
    }

    /// What of a cell is in the body, at least `least`, and its middle.
    fn part(&self, cell: IVec3, least: f64) -> (f64, DVec3) {
        let mut cuts = self.planes_at(cell);
        cut([cuts.next(), cuts.next()], self.voxels.middle(cell), self.voxels.size, DVec3::ONE, least)
    }

    /// Finds the cells outside that the body reaches into, and adds what they hold to the voxel beside them.
    fn reach_out(&mut self) {
        let voxels = self.voxels;
        let mut found = Vec::new();
        for &cell in &voxels.cells {
            // Across a face if there is one, across a corner if need be.
            found.extend(around().map(|o| cell + o).filter(|&c| voxels.holds(c) && voxels.index[linear(voxels.dims, c)] == NONE));
        }
        found.sort_unstable_by_key(|&c| linear(voxels.dims, c));
        found.dedup();
        for cell in found {
            let (share, middle) = self.part(cell, 0.0);
            if share <= 0.0 || self.planes_at(cell).next().is_none() {
                continue;
            }
            let beside = around().filter_map(|o| Some((o.length_squared(), voxels.at_cell(cell + o)?)));
            let Some((_, host)) = beside.min() else { continue };
            let (sum, mean) = &mut self.parts[host as usize];
            *mean = (*mean * *sum + middle * share) / (*sum + share);
            *sum += share;
            self.host[linear(voxels.dims, cell)] = host;
            self.outer.push((cell, host));
        }
    }

    /// Visits the faces between voxels, or what counts with them, that `differ`: the two voxels, the axis along which the second lies after the first, the middle of the face and the share of it that is in the body; and whether
    /// both are voxels of the body that touch, not across the air.
    pub(crate) fn faces(&self, differ: impl Fn(u32, u32) -> bool, mut visit: impl FnMut([u32; 2], usize, DVec3, f64, bool)) {
        let voxels = self.voxels;
        let mut face = |cell: IVec3, next: IVec3, ends: [u32; 2], axis: usize, touch: bool| {
            let place = (voxels.middle(cell) + voxels.middle(next)) * 0.5;
            let mut planes: Vec<Plane> = self.planes_at(cell).chain(self.planes_at(next)).collect();
            planes.sort_by(|a, b| place.distance_squared(a.0).total_cmp(&place.distance_squared(b.0)));
            let first = planes.first().copied();
            let second = first.and_then(|a| planes.into_iter().find(|b| a.1.dot(b.1) <= EDGE));
            let mut across = DVec3::ONE;
            across[axis] = 0.0;
            let (share, middle) = cut([first, second], place, voxels.size, across, 0.0);
            if share > 0.0 {
                visit(ends, axis, middle, share, touch);
            }
        };
        for v in 0..voxels.len() as u32 {
            let cell = voxels.cells[v as usize];
            for (next, step) in voxels.neighbours(v) {
                let to = voxels.cells[next as usize];
                let axis = (0..3).find(|&axis| to[axis] > cell[axis]);
                if let Some(axis) = axis
                    && step == STEPS[0]
                    && differ(v, next)
                {
                    face(cell, to, [v, next], axis, true);
                }
            }
        }
        for &(cell, host) in &self.outer {
            for axis in 0..3 {
                for by in [-1, 1] {
                    let mut to = cell;
                    to[axis] += by;
                    let other = if voxels.holds(to) { self.host[linear(voxels.dims, to)] } else { NONE };
                    // Of two outer cells the first visits.
                    let both_outer = other != NONE && voxels.index[linear(voxels.dims, to)] == NONE;
                    if other == NONE || both_outer && by < 0 || !differ(host, other) {
                        continue;
                    }
                    if by > 0 { face(cell, to, [host, other], axis, false) } else { face(to, cell, [other, host], axis, false) }
                }
            }
        }
    }
}

/// How much of a box of side `size` around `middle`, as far as it extends `across`, is below two planes, and where the middle of that is.
fn cut(planes: [Option<Plane>; 2], middle: DVec3, size: f64, across: DVec3, least: f64) -> (f64, DVec3) {
    let below = |(point, normal): Plane| {
        let normal_across = normal * across;
        let width = normal_across.abs().element_sum();
        let share = (0.5 + (point - middle).dot(normal) / (size * width.max(1e-9))).clamp(0.0, 1.0);
        (share, normal_across / width.max(1e-9) * (-0.5 * size * (1.0 - share)))
    };
    let [Some(first), second] = planes else { return (1.0, middle) };
    let (a, shift) = below(first);
    let Some(second) = second else { return (a.max(least), middle + shift) };
    let (b, other_shift) = below(second);
    let share = if first.1.dot(second.1) < -0.5 {
        // The two sides of a sheet.
        (a + b - 1.0).max(0.0)
    } else if (second.0 - first.0).dot(first.1) < 0.0 {
        a * b
    } else {
        return ((a + b - a * b).max(least), middle);
    };
    (share.max(least), middle + shift + other_shift)
}

/// A cell and those around it.
fn around() -> impl Iterator<Item = IVec3> {
    (-1..=1).flat_map(|z| (-1..=1).flat_map(move |y| (-1..=1).map(move |x| IVec3::new(x, y, z))))
}
