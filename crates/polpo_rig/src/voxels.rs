//! The body as voxels, and which of them touch: what the next stages walk *along*.

use glam::{DVec3, IVec3};

use crate::clean::{DisjointSets, Surface};
use crate::grid::{Grid, block, linear};
use crate::sample::Wanted;

/// Voxels wanted a particle: eight to nine across a cell.
const VOXELS_A_PARTICLE: usize = 600;
/// Where the facets between cells are to be known: eleven across.
const VOXELS_A_CELL: usize = 1400;
/// Fewer voxels than this don't show the shape, more cost seconds.
const VOXELS: std::ops::RangeInclusive<usize> = 60_000..=1_000_000;
/// Voxels of skin wanted a particle where particles lie on the skin alone, and how many times as many voxels that may take.
const SKIN_A_PARTICLE: f64 = 30.0;
const SHELL: usize = 4;
/// Length of a step to a neighbour across a face, an edge, a corner: 1, √2, √3 in units of 1/58 voxel, off by less than 0.5 %.
pub(crate) const STEPS: [u32; 3] = [58, 82, 100];
/// Steps in a voxel's side.
pub(crate) const STEPS_A_VOXEL: f64 = 58.0;

/// No voxel.
pub(crate) const NONE: u32 = u32::MAX;

/// The body: a list of voxels and the links between them, in the unit box of [`Surface`].
pub(crate) struct Voxels {
    /// Side of a voxel.
    pub(crate) size: f64,
    origin: DVec3,
    pub(crate) dims: IVec3,
    /// Index of the voxel at every cell of the grid, or `NONE`.
    pub(crate) index: Vec<u32>,
    pub(crate) cells: Vec<IVec3>,
    /// How many of them only stand in for an inside thinner than they are.
    thin: usize,
    /// `links[first[v]..first[v + 1]]` are the neighbours of v, packed as neighbour · 4 + kind of step.
    first: Vec<u32>,
    links: Vec<u32>,
}

impl Voxels {
    /// Voxelises a surface finely enough for so many particles, as far as memory and time allow.
    ///
    /// `shell` is for particles on the skin alone, `facets` for facets between their cells.
    pub(crate) fn new(surface: &Surface, particles: Wanted, shell: bool, facets: bool) -> Voxels {
        let each = if facets { VOXELS_A_CELL } else { VOXELS_A_PARTICLE };
        let most = if shell { *VOXELS.end() * SHELL } else { *VOXELS.end() };
        let voxels = match particles {
            Wanted::Count(n) => {
                // A solid of N voxels has about 6 N^⅔ on its skin.
                let face = if shell { n as f64 * SKIN_A_PARTICLE / 6.0 } else { 0.0 };
                let skin = (face * face.sqrt()) as usize;
                n.saturating_mul(each).min(*VOXELS.end()).max(skin)
            }
            Wanted::Spacing(_) => 0,
        };
        let mut grid = Grid::new(surface, 40.0).refined(surface, voxels.clamp(*VOXELS.start(), most) as f64);
        if let Wanted::Spacing(apart) = particles {
            // As finely as with a number of particles, across and not by volume.
            let across = libm::cbrt(each as f64);
            if grid.size * across > apart {
                grid = Grid::new(surface, across / apart);
                if grid.body().count() > most {
                    grid = grid.refined(surface, most as f64);
                }
            }
        }
        let voxels = Voxels::link(&grid);
        if grid.mend(surface, &voxels) { Voxels::link(&grid) } else { voxels }
    }

    /// Whether the body may have such a volume inside its solid parts, as far as its voxels say: those of the surface stand for less
    /// than a voxel each, a part may cross itself a little, and parts that overlap have less together than each for itself. Sheets
    /// that stand out have a volume that only the voxels know.
    pub(crate) fn may_be(&self, volume: f64, surface: &Surface) -> bool {
        let voxel = self.size * self.size * self.size;
        let (all, solid) = (self.len() as f64, (self.len() - self.thin) as f64);
        let most = if surface.solid.iter().flatten().count() == 1 { 1.25 } else { 1.05 };
        let sheets = surface.solid.contains(&None) && self.thin > 0;
        !sheets && (0.8 * solid..most * all).contains(&(volume / voxel))
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
        self.holds(cell).then(|| self.index[linear(self.dims, cell)]).filter(|&v| v != NONE)
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

    /// Whether a voxel lies at the skin: it has not every neighbour.
    pub(crate) fn is_skin(&self, voxel: u32) -> bool {
        self.neighbours(voxel).len() < 26
    }

    /// The voxels inside each part of the surface, as (part, voxel), sorted: parts that overlap share some, and the skin's own may be in none.
    pub(crate) fn inside(&self, surface: &Surface) -> Vec<(u32, u32)> {
        let grid = Grid::empty(1.0 / self.size, self.size, self.origin, self.dims);
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
                    vote(spans[part as usize].0, spans[part as usize].1, true);
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
        Voxels { index: self.index.clone(), cells: self.cells.clone(), first, links, ..*self }
    }

    /// In how many parts the body is.
    pub(crate) fn parts(&self) -> usize {
        (0..).zip(self.roots(|_, _| true)).filter(|(v, root)| v == root).count()
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

    /// Whether a straight way leads from one place in the body to another, over voxels that are linked.
    pub(crate) fn sees(&self, from: DVec3, to: DVec3) -> bool {
        let count = (from.distance(to) / (0.5 * self.size)).ceil().max(1.0);
        let mut last = self.at(from);
        (0..=count as u32).all(|i| {
            let at = self.at(from.lerp(to, f64::from(i) / count));
            let linked = match (last, at) {
                (Some(a), Some(b)) => a == b || self.neighbours(a).any(|n| n.0 == b),
                _ => false,
            };
            last = at;
            linked
        })
    }

    /// Lists the body's voxels and links the ones that touch. Across an edge or a corner they are linked only if steps across
    /// faces, none of them through the skin, lead there too: not over a gap thinner than a voxel. Where the surface stands in for
    /// an inside that rule would tear holes, and touching is enough.
    fn link(grid: &Grid) -> Voxels {
        let cells: Vec<IVec3> = grid.body().collect();
        let thin = cells.iter().filter(|&&c| !grid.inside(c)).count();
        let mut index = vec![NONE; grid.bits.len()];
        for (v, &cell) in cells.iter().enumerate() {
            index[linear(grid.dims, cell)] = v as u32;
        }
        let present = |c: IVec3| index[linear(grid.dims, c)] != NONE;
        let face_step = |from: IVec3, axis: usize, by: i32| {
            let mut to = from;
            to[axis] += by;
            let upper = if by > 0 { to } else { from };
            (present(to) && !grid.wall(upper, axis)).then_some(to)
        };
        let mut first = vec![0];
        let mut links = Vec::with_capacity(cells.len() * 26);
        for &cell in &cells {
            for offset in block(IVec3::NEG_ONE, IVec3::ONE) {
                let to = cell + offset;
                if offset == IVec3::ZERO || !present(to) {
                    continue;
                }
                let linked =
                    reaches(cell, offset, &face_step) || (offset.abs().element_sum() > 1 && (grid.surface(cell) || grid.surface(to)));
                if linked {
                    let kind = offset.abs().element_sum() as u32 - 1;
                    links.push(index[linear(grid.dims, to)] << 2 | kind);
                }
            }
            first.push(links.len() as u32);
        }
        Voxels { size: grid.size, origin: grid.origin, dims: grid.dims, index, cells, thin, first, links }
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
