//! Marks: which region every voxel is in.
//!
//! Where marks change, links are cut before the particles are spread: no cell then is in two regions, a wheel and its car share
//! none. Edges, ellipsoids and skin see the whole body again. A scrap far smaller than a cell, as where two skins cross, would get
//! a particle of its own: it takes the mark around it.

use std::collections::{BTreeMap, BTreeSet};

use crate::clean::Surface;
use crate::paint::{Hit, hits, spread};
use crate::region::Region;
use crate::sample::Sample;
use crate::voxels::Voxels;
use crate::{Mesh, RegionRule};

/// The mark of what is in no region.
const NONE: u32 = u32::MAX;
/// A piece smaller than this share of a cell is a scrap, unless it is the largest of its region.
const SCRAP: usize = 8;

/// The regions on the voxels.
pub(crate) struct Marks {
    /// Index into `areas` for every voxel, or `NONE`.
    of: Vec<u32>,
    areas: Vec<Area>,
    /// The names in the order of the rules, each once, and whether a rule of that name took nothing.
    names: Vec<(String, bool)>,
}

/// A region before it has particles.
struct Area {
    region: Region,
    density: Option<f32>,
    /// Index of its name.
    name: usize,
}

impl Marks {
    /// Marks a body's voxels by rules, of which the last that holds counts. `cell` is how many voxels a particle gets.
    pub(crate) fn new(mesh: &Mesh, surface: &Surface, voxels: &Voxels, rules: &[RegionRule], cell: usize) -> Marks {
        let (mut areas, mut names) = (Vec::<Area>::new(), Vec::<(String, bool)>::new());
        let mut area_of = Vec::new();
        for rule in rules {
            let name = names.iter().position(|(name, _)| *name == rule.name).unwrap_or(names.len());
            if name == names.len() {
                names.push((rule.name.clone(), false));
                areas.push(Area { region: Region { name: rule.name.clone(), ..Region::default() }, density: None, name });
            }
            let area = &mut areas[name];
            area.density = rule.density.or(area.density);
            area.region.stiffness = rule.stiffness.or(area.region.stiffness);
            area.region.friction = rule.friction.or(area.region.friction);
            area.region.group = rule.group.or(area.region.group);
            area_of.push(name as u32);
        }
        let mut holds = vec![false; rules.len()];
        let hits = hits(mesh, surface, voxels, rules, &mut holds);
        for (area, _) in area_of.iter().zip(holds).filter(|(_, holds)| !holds) {
            names[*area as usize].1 = true;
        }
        let mut of = spread(surface, voxels, &hits);
        of.iter_mut().for_each(|rule| *rule = rule.checked_sub(1).map_or(NONE, |rule| area_of[rule as usize]));
        absorb(voxels, &mut of, (cell / SCRAP).max(1));
        let mut marks = Marks { of, areas, names };
        marks.split(voxels, &hits, &area_of);
        marks
    }

    /// The voxels without the links between regions.
    pub(crate) fn divide(&self, voxels: &Voxels) -> Voxels {
        voxels.divided(|a, b| self.of[a as usize] == self.of[b as usize])
    }

    /// The density of a voxel, if its region has one.
    pub(crate) fn density(&self, voxel: u32) -> Option<f32> {
        self.areas.get(self.of[voxel as usize] as usize).and_then(|area| area.density)
    }

    /// The regions with their particles, each by most of its cell; and the names of those that have none, or of whose rules one took nothing.
    pub(crate) fn regions(self, sample: &Sample) -> (Vec<Region>, Vec<String>) {
        let mut votes: Vec<(u32, u32)> = sample.owner.iter().copied().zip(self.of).collect();
        votes.sort_unstable();
        let mut areas = self.areas;
        for cell in votes.chunk_by(|a, b| a.0 == b.0) {
            // The last of the longest would win; the first shall.
            let most = cell.chunk_by(|a, b| a.1 == b.1).rev().max_by_key(|same| same.len());
            let area = most.and_then(|same| areas.get_mut(same[0].1 as usize));
            if let Some(area) = area {
                area.region.particles.push(cell[0].0);
            }
        }
        areas.retain(|area| !area.region.particles.is_empty());
        let empty = |(name, (text, unmet)): (usize, (String, bool))| (unmet || areas.iter().all(|a| a.name != name)).then_some(text);
        let empty = self.names.into_iter().enumerate().filter_map(empty).collect();
        (areas.into_iter().map(|area| area.region).collect(), empty)
    }
}

impl Marks {
    /// Makes a region of every piece of one that is a group, in the order of the mesh's triangles.
    fn split(&mut self, voxels: &Voxels, hits: &[Hit], area_of_rule: &[u32]) {
        let grouped: Vec<bool> = self.areas.iter().map(|area| area.region.group.is_some()).collect();
        if !grouped.contains(&true) {
            return;
        }
        let is_grouped = |mark: u32| grouped.get(mark as usize) == Some(&true);
        let roots = pieces_of(voxels, &self.of);
        let mut first: BTreeMap<u32, u32> = BTreeMap::new();
        for (&root, &mark) in roots.iter().zip(&self.of) {
            if is_grouped(mark) {
                first.entry(root).or_insert(u32::MAX);
            }
        }
        for hit in hits {
            let voxel = hit.voxel as usize;
            let own = hit.rule.checked_sub(1).is_some_and(|rule| area_of_rule[rule as usize] == self.of[voxel]);
            if let Some(least) = first.get_mut(&roots[voxel]).filter(|_| own) {
                *least = hit.triangle.min(*least);
            }
        }
        let mut order: Vec<(u32, u32)> = first.into_iter().map(|(root, triangle)| (triangle, root)).collect();
        order.sort_unstable();

        let mut names: BTreeSet<String> = self.names.iter().map(|(name, _)| name.clone()).collect();
        let mut counts = vec![0_usize; grouped.len()];
        let mut area_of: BTreeMap<u32, u32> = BTreeMap::new();
        for (_, root) in order {
            let mark = self.of[root as usize];
            let Area { ref region, density, name } = self.areas[mark as usize];
            let count = &mut counts[mark as usize];
            *count += 1;
            if *count == 1 {
                area_of.insert(root, mark);
                continue;
            }
            let mut region = region.clone();
            region.name = loop {
                let numbered = format!("{} {count}", self.names[name].0);
                if names.insert(numbered.clone()) {
                    break numbered;
                }
                *count += 1;
            };
            area_of.insert(root, self.areas.len() as u32);
            self.areas.push(Area { region, density, name });
        }
        for (mark, root) in self.of.iter_mut().zip(roots) {
            *mark = area_of.get(&root).copied().unwrap_or(*mark);
        }
    }
}

/// The first voxel of the piece that each voxel is in; where marks change another piece begins.
fn pieces_of(voxels: &Voxels, marks: &[u32]) -> Vec<u32> {
    voxels.roots(|a, b| marks[a as usize] == marks[b as usize])
}

/// Gives scraps, pieces of less than `least` voxels, the mark that most of what they touch has. The largest piece of a region is none.
fn absorb(voxels: &Voxels, marks: &mut [u32], least: usize) {
    // Each round ends scraps, or is the last.
    loop {
        let roots = pieces_of(voxels, marks);
        let mut sizes: BTreeMap<u32, usize> = BTreeMap::new();
        for &root in &roots {
            *sizes.entry(root).or_insert(0) += 1;
        }
        let mut largest: BTreeMap<u32, (usize, u32)> = BTreeMap::new();
        for (&root, &size) in &sizes {
            let most = largest.entry(marks[root as usize]).or_insert((0, root));
            if size > most.0 {
                *most = (size, root);
            }
        }
        largest.remove(&NONE);
        let kept: BTreeSet<u32> = largest.values().map(|most| most.1).collect();
        sizes.retain(|root, size| *size < least && !kept.contains(root));
        let mut votes: BTreeMap<(u32, u32), usize> = BTreeMap::new();
        for (v, root) in (0..).zip(&roots).filter(|(_, root)| sizes.contains_key(root)) {
            for (next, _) in voxels.neighbours(v).filter(|(next, _)| !sizes.contains_key(&roots[*next as usize])) {
                *votes.entry((*root, marks[next as usize])).or_insert(0) += 1;
            }
        }
        let mut winners: BTreeMap<u32, (usize, u32)> = BTreeMap::new();
        for ((root, mark), count) in votes {
            let most = winners.entry(root).or_insert((0, mark));
            if count > most.0 {
                *most = (count, mark);
            }
        }
        if winners.is_empty() {
            return;
        }
        for (mark, root) in marks.iter_mut().zip(&roots) {
            if let Some(winner) = winners.get(root) {
                *mark = winner.1;
            }
        }
    }
}
