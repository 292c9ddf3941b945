//! From rules to voxels: skin is cut into pieces, each piece marks the voxel under it, and marks spread inwards.
//!
//! A voxel takes the rule of the skin that is nearest along the body, among the skins that it is inside of: what lies in a car beside a
//! wheel is no wheel, however near. Inside of several, the last rule counts, as it does on the skin.

use crate::clean::Surface;
use crate::flood::Front;
use crate::grid::pieces;
use crate::voxels::Voxels;
use crate::{Mesh, MeshPart, RegionRule};

/// A piece of skin.
pub(crate) struct Hit {
    /// The surface's part that it belongs to, or the one that it closes together with others.
    part: u32,
    /// The voxel under it.
    pub(crate) voxel: u32,
    /// The last rule that holds, counted from 1; 0 if none does.
    pub(crate) rule: u32,
    /// Index of the mesh's triangle that it was cut from.
    pub(crate) triangle: u32,
    /// Its area, in the unit box.
    area: f64,
}

/// The pieces of skin, sorted by part, voxel and rule. Sets which rules hold anywhere.
pub(crate) fn hits(mesh: &Mesh, surface: &Surface, voxels: &Voxels, rules: &[RegionRule], holds: &mut [bool]) -> Vec<Hit> {
    // All triangles of the mesh: of a wall that two regions share the surface has kept one side, and the other's would be lost.
    let mut part_of = vec![0; surface.positions.len()];
    for (triangle, &part) in surface.triangles.iter().zip(&surface.part) {
        triangle.iter().for_each(|&v| part_of[v as usize] = part);
    }
    let nameless = MeshPart { triangles: 0..u32::MAX, ..MeshPart::default() };
    let mut named: Vec<(&MeshPart, Vec<usize>)> = Vec::new();
    for part in mesh.parts.iter().chain([&nameless]) {
        named.push((part, (0..rules.len()).filter(|&rule| rules[rule].holds_for(part)).collect()));
    }
    let mut at = 0;
    let mut hits = Vec::new();
    for (t, corners) in (0..).zip(&mesh.triangles) {
        while at < mesh.parts.len() && named[at].0.triangles.end <= t {
            at += 1;
        }
        let colors = (!mesh.colors.is_empty()).then(|| corners.map(|v| mesh.colors[v as usize]));
        let rules_here: Vec<usize> = named[at].1.iter().copied().filter(|&rule| rules[rule].holds_for_colors(colors)).collect();
        let welded = corners.map(|v| surface.welded[v as usize]);
        let [a, b, c] = welded.map(|v| surface.positions[v as usize]);
        let own = part_of[welded[0] as usize];
        let part = surface.solid[own as usize].unwrap_or(own);
        let normal = (b - a).cross(c - a) * surface.winding[own as usize];
        // What the surface has dropped carries no direction either.
        if normal.length_squared() <= 4e-40 {
            continue;
        }
        let normal = normal.normalize_or_zero();
        pieces([a, b, c], 0.7 * voxels.size, |middle, area| {
            let place = (surface.origin + middle * surface.scale).as_vec3();
            let mut last = 0;
            for &rule in &rules_here {
                if rules[rule].within.is_none_or(|within| within.holds(place)) {
                    // One that a later one overrides holds all the same.
                    holds[rule] = true;
                    last = last.max(rule as u32 + 1);
                }
            }
            hits.push(Hit { part, voxel: voxels.under(middle, normal), rule: last, triangle: t, area });
        });
    }
    hits.sort_by_key(|hit| (hit.part, hit.voxel, hit.rule, hit.triangle));
    hits
}

/// The rule of every voxel, counted from 1, or 0.
pub(crate) fn spread(surface: &Surface, voxels: &Voxels, hits: &[Hit]) -> Vec<u32> {
    let apart = surface.winding.len() > 1;
    let inside = if apart { voxels.inside(surface) } else { Vec::new() };
    // One more than the rule, so that 0 is not known yet.
    let mut known = vec![0_u32; voxels.len()];
    let mut fill = Fill::new(voxels.len());
    for skin in hits.chunk_by(|a, b| a.part == b.part) {
        let part = skin[0].part;
        let seeds: Vec<(u32, u32)> = skin.chunk_by(|a, b| a.voxel == b.voxel).map(|here| (here[0].voxel, most(here))).collect();
        if apart {
            let range = inside.partition_point(|i| i.0 < part)..inside.partition_point(|i| i.0 <= part);
            fill.open(inside[range].iter().map(|i| i.1));
        } else {
            fill.open(0..voxels.len() as u32);
        }
        for (voxel, rule) in fill.flood(voxels, &seeds) {
            known[voxel as usize] = known[voxel as usize].max(rule + 1);
        }
    }
    // What is inside of nothing, as a voxel that bridges two skins, follows its neighbours.
    let seeds: Vec<(u32, u32)> = (0..).zip(&known).filter(|(_, k)| **k > 0).map(|(voxel, k)| (voxel, k - 1)).collect();
    fill.open((0..).zip(&known).filter(|(_, k)| **k == 0).map(|(voxel, _)| voxel));
    let mut rules: Vec<u32> = known.iter().map(|k| k.saturating_sub(1)).collect();
    for (voxel, rule) in fill.flood(voxels, &seeds) {
        rules[voxel as usize] = rule;
    }
    rules
}

/// The rule of most of the area of some skin; the first of equals.
fn most(skin: &[Hit]) -> u32 {
    let mut most = (0.0, 0);
    for same in skin.chunk_by(|a, b| a.rule == b.rule) {
        let area: f64 = same.iter().map(|hit| hit.area).sum();
        if area > most.0 {
            most = (area, same[0].rule);
        }
    }
    most.1
}

/// Spreads the rule of the nearest seed over the voxels that are open.
struct Fill {
    /// Distance along the body in steps; 0 for a voxel that is not open.
    distance: Vec<u32>,
    rule: Vec<u32>,
    open: Vec<u32>,
    front: Front<u32>,
}

impl Fill {
    fn new(voxels: usize) -> Fill {
        Fill { distance: vec![0; voxels], rule: vec![0; voxels], open: Vec::new(), front: Front::new() }
    }

    fn open(&mut self, voxels: impl Iterator<Item = u32>) {
        for voxel in voxels {
            self.distance[voxel as usize] = u32::MAX;
            self.open.push(voxel);
        }
    }

    /// The open voxels and seeds that are reached, with their rules; closes all.
    fn flood(&mut self, voxels: &Voxels, seeds: &[(u32, u32)]) -> Vec<(u32, u32)> {
        let mut reached = Vec::new();
        for &(voxel, rule) in seeds {
            if self.distance[voxel as usize] == 0 {
                self.open.push(voxel);
            }
            // Distances begin with 1, since 0 is closed.
            self.distance[voxel as usize] = 1;
            self.rule[voxel as usize] = rule;
            self.front.push(1, voxel);
        }
        while let Some((distance, voxel)) = self.front.pop() {
            if self.distance[voxel as usize] < distance {
                continue;
            }
            for (next, step) in voxels.neighbours(voxel) {
                if distance + step < self.distance[next as usize] {
                    self.distance[next as usize] = distance + step;
                    self.rule[next as usize] = self.rule[voxel as usize];
                    self.front.push(distance + step, next);
                }
            }
        }
        for voxel in self.open.drain(..) {
            let distance = std::mem::take(&mut self.distance[voxel as usize]);
            if distance != u32::MAX {
                reached.push((voxel, self.rule[voxel as usize]));
            }
        }
        reached
    }
}
