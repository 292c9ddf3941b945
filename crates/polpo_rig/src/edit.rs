//! Edits: what an artist changed by hand, told by places so that it holds for a mesh that was changed a little.
//!
//! Particles are moved, added and removed as soon as they are spread, and the voxels divided between them anew, so that all that is made
//! from cells fits. Edges are tied and cut when all else of them is done.

use std::collections::BTreeSet;

use glam::{DVec3, Vec3};
use serde::{Deserialize, Serialize};

use crate::clean::{DisjointSets, Surface};
use crate::domain::Domain;
use crate::flood::Cells;
use crate::recipe::check;
use crate::sample::{Sample, touching};
use crate::voxels::Voxels;
use crate::{Note, RigError};

/// One change by hand, in the mesh's unit and axes. A place \[m\] means the particle whose centre is nearest, if it is at most twice as far away as that particle's cell reaches.
///
/// Particles are moved, added and removed first, then edges; each in the order of the recipe, a place meaning what the edits before it have left. All other particles stay where they are, and share what
/// there is to share: cells, shapes and skin weights are made for the edited particles. Edits come on top of the numbers that the recipe asks for.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase", deny_unknown_fields)]
pub enum Edit {
    /// Ties the particles at two places by an edge, if they aren't; by a facet, too, where the recipe has a material.
    Connect([[f32; 3]; 2]),
    /// Takes away the edge between the particles at two places, and the facet, unless the body would fall apart.
    Disconnect([[f32; 3]; 2]),
    /// Moves the particle at the first place to the second, which is in the body or so near that it can be drawn into it. A part or a region keeps one at least.
    Move([[f32; 3]; 2]),
    /// Adds a particle at a place in the body, after all others in the list.
    Add([f32; 3]),
    /// Takes away the particle at a place; those after it move up in the list. The last of a part or a region stays.
    Remove([f32; 3]),
}

impl Edit {
    /// The places that it tells.
    pub fn places(&self) -> Vec<[f32; 3]> {
        match *self {
            Edit::Connect(places) | Edit::Disconnect(places) | Edit::Move(places) => places.to_vec(),
            Edit::Add(place) | Edit::Remove(place) => vec![place],
        }
    }

    pub(crate) fn validate(&self) -> Result<(), RigError> {
        let worst = self.places().into_iter().flatten().find(|x| !x.is_finite());
        worst.map_or(Ok(()), |x| check("edit", x.into(), false, "finite"))
    }
}

/// The edits of a recipe on their way into a rig, and those that could not be done.
pub(crate) struct Edits<'a> {
    edits: &'a [Edit],
    surface: &'a Surface,
    left: Vec<(usize, &'static str)>,
    /// What pairs were tied and cut, the smaller index first.
    pub(crate) tied: BTreeSet<[u32; 2]>,
    pub(crate) cut: BTreeSet<[u32; 2]>,
}

impl<'a> Edits<'a> {
    pub(crate) fn new(edits: &'a [Edit], surface: &'a Surface) -> Self {
        Edits { edits, surface, left: Vec::new(), tied: BTreeSet::new(), cut: BTreeSet::new() }
    }

    /// A place in the unit box.
    fn point(&self, place: [f32; 3]) -> DVec3 {
        (Vec3::from(place).as_dvec3() - self.surface.origin) / self.surface.scale
    }

    /// Does one edit after the other; `act` says whether it was one of its kind, and why it could not be done.
    fn each(&mut self, mut act: impl FnMut(&Self, Edit) -> Result<(), &'static str>) {
        for (index, &edit) in self.edits.iter().enumerate() {
            if let Err(what) = act(self, edit) {
                self.left.push((index, what));
            }
        }
    }

    /// Moves, adds and removes particles. `voxels` are those that the sample was spread over.
    pub(crate) fn place(&mut self, voxels: &Voxels, domain: &Domain, sample: &mut Sample) {
        if !self.edits.iter().any(|edit| matches!(edit, Edit::Move(_) | Edit::Add(_) | Edit::Remove(_))) {
            return;
        }
        let mut seats = Seats::new(voxels, sample);
        self.each(|this, edit| match edit {
            Edit::Move([from, to]) => seats.relocate(this.point(from), this.point(to)),
            Edit::Add(place) => seats.add(this.point(place)),
            Edit::Remove(place) => seats.remove(this.point(place)),
            Edit::Connect(_) | Edit::Disconnect(_) => Ok(()),
        });
        *sample = seats.sample(domain);
    }

    /// Ties and cuts edges, which are and stay sorted.
    pub(crate) fn tie(&mut self, voxels: &Voxels, sample: &Sample, edges: &mut Vec<[u32; 2]>) {
        if !self.edits.iter().any(|edit| matches!(edit, Edit::Connect(_) | Edit::Disconnect(_))) {
            return;
        }
        let reaches = reaches(voxels, sample);
        let pair = |this: &Self, places: [[f32; 3]; 2]| {
            let [a, b] = places.map(|place| nearest(this.point(place), &sample.positions, &reaches));
            let (a, b) = (a? as u32, b? as u32);
            if a == b { Err("both places mean the same particle") } else { Ok([a.min(b), a.max(b)]) }
        };
        let mut all: BTreeSet<[u32; 2]> = edges.iter().copied().collect();
        let (mut tied, mut cut) = (BTreeSet::new(), BTreeSet::new());
        self.each(|this, edit| match edit {
            Edit::Connect(places) => {
                let pair = pair(this, places)?;
                all.insert(pair);
                tied.insert(pair);
                cut.remove(&pair);
                Ok(())
            }
            Edit::Disconnect(places) => {
                let pair = pair(this, places)?;
                if !all.remove(&pair) {
                    return Err("there is no edge between these particles");
                }
                let mut sets = DisjointSets::new(sample.positions.len());
                for &[a, b] in &all {
                    sets.join(a, b);
                }
                if sets.root(pair[0]) == sets.root(pair[1]) {
                    tied.remove(&pair);
                    cut.insert(pair);
                    return Ok(());
                }
                all.insert(pair);
                Err("without this edge the body would fall apart")
            }
            Edit::Move(_) | Edit::Add(_) | Edit::Remove(_) => Ok(()),
        });
        *edges = all.into_iter().collect();
        (self.tied, self.cut) = (tied, cut);
    }

    /// What to tell of the edits that were left, in their order.
    pub(crate) fn notes(mut self) -> impl Iterator<Item = Note> {
        self.left.sort_unstable();
        self.left.into_iter().map(|(edit, what)| Note::EditLeft { edit, what })
    }
}

/// Particles while they are edited: each sits in a voxel of its own, and every part of the body has one.
struct Seats<'a> {
    voxels: &'a Voxels,
    positions: Vec<DVec3>,
    voxel: Vec<u32>,
    reaches: Vec<f64>,
    /// Of every voxel the part that it is in, by its first voxel, and how many particles are there.
    part: Vec<u32>,
    count: Vec<u32>,
}

impl Seats<'_> {
    fn new<'a>(voxels: &'a Voxels, sample: &Sample) -> Seats<'a> {
        let part = voxels.roots(|_, _| true);
        let mut count = vec![0; voxels.len()];
        sample.voxel.iter().for_each(|&voxel| count[part[voxel as usize] as usize] += 1);
        let (positions, voxel) = (sample.positions.clone(), sample.voxel.clone());
        Seats { voxels, positions, voxel, reaches: reaches(voxels, sample), part, count }
    }

    fn count(&mut self, voxel: u32) -> &mut u32 {
        &mut self.count[self.part[voxel as usize] as usize]
    }

    /// The voxel for a particle at a point, and where in it: just there, or for a point out of the body, but not by more than half a cell, in the middle of the nearest.
    fn seat(&self, point: DVec3) -> Result<(u32, DVec3), &'static str> {
        if let Some(voxel) = self.voxels.at(point) {
            return Ok((voxel, point));
        }
        let near = nearest(point, &self.positions, &self.reaches)?;
        let distance = |voxel: u32| self.voxels.centre(voxel).distance(point);
        let all = 0..self.voxels.len() as u32;
        let voxel = all.min_by(|&a, &b| distance(a).total_cmp(&distance(b))).filter(|&v| distance(v) <= 0.5 * self.reaches[near]);
        voxel.map(|voxel| (voxel, self.voxels.centre(voxel))).ok_or("the place is not in the body")
    }

    /// No two particles in one voxel, nor nearer than a tenth of a cell: they would be one particle twice.
    fn is_free(&self, voxel: u32, point: DVec3, but: Option<usize>) -> Result<(), &'static str> {
        let crowds = |p: usize| self.voxel[p] == voxel || self.positions[p].distance(point) < 0.1 * self.reaches[p];
        let free = (0..self.positions.len()).all(|p| Some(p) == but || !crowds(p));
        if free { Ok(()) } else { Err("there is a particle at that place") }
    }

    fn relocate(&mut self, from: DVec3, to: DVec3) -> Result<(), &'static str> {
        let particle = nearest(from, &self.positions, &self.reaches)?;
        let (voxel, position) = self.seat(to)?;
        let before = self.voxel[particle];
        self.is_free(voxel, position, Some(particle))?;
        if self.part[voxel as usize] != self.part[before as usize] && *self.count(before) == 1 {
            return Err(LAST);
        }
        *self.count(before) -= 1;
        *self.count(voxel) += 1;
        (self.voxel[particle], self.positions[particle]) = (voxel, position);
        Ok(())
    }

    fn add(&mut self, point: DVec3) -> Result<(), &'static str> {
        let (voxel, position) = self.seat(point)?;
        self.is_free(voxel, position, None)?;
        // As far as the cell that it takes its own from.
        let reach = nearest(point, &self.positions, &self.reaches).map_or(self.voxels.size, |near| self.reaches[near]);
        *self.count(voxel) += 1;
        self.voxel.push(voxel);
        self.positions.push(position);
        self.reaches.push(reach);
        Ok(())
    }

    fn remove(&mut self, point: DVec3) -> Result<(), &'static str> {
        let particle = nearest(point, &self.positions, &self.reaches)?;
        let voxel = self.voxel[particle];
        if *self.count(voxel) == 1 {
            return Err(LAST);
        }
        *self.count(voxel) -= 1;
        self.voxel.remove(particle);
        self.positions.remove(particle);
        self.reaches.remove(particle);
        Ok(())
    }

    /// The particles with the voxels divided between them.
    fn sample(self, domain: &Domain) -> Sample {
        let mut cells = Cells::new(self.voxels);
        cells.flood(self.voxels, &domain.weights, &self.voxel, 0);
        let touching = touching(self.voxels, &cells.owner, domain.shell);
        if domain.shell {
            cells.fill(self.voxels);
        }
        let mut volumes = vec![0; self.voxel.len()];
        cells.owner.iter().for_each(|&owner| volumes[owner as usize] += 1);
        Sample { positions: self.positions, volumes, owner: cells.owner, voxel: self.voxel, touching }
    }
}

const LAST: &str = "it is the last particle of its part or region";

/// How far the voxels of every cell are from its particle, at most.
fn reaches(voxels: &Voxels, sample: &Sample) -> Vec<f64> {
    let mut reaches = vec![voxels.size; sample.positions.len()];
    for (voxel, &owner) in (0..).zip(&sample.owner) {
        let reach = &mut reaches[owner as usize];
        *reach = reach.max(voxels.centre(voxel).distance(sample.positions[owner as usize]));
    }
    reaches
}

/// The particle whose centre is nearest, if its cell is near.
fn nearest(point: DVec3, positions: &[DVec3], reaches: &[f64]) -> Result<usize, &'static str> {
    let distance = |particle: usize| positions[particle].distance(point);
    let nearest = (0..positions.len()).min_by(|&a, &b| distance(a).total_cmp(&distance(b)));
    nearest.filter(|&particle| distance(particle) <= 2.0 * reaches[particle]).ok_or("no particle is near that place")
}
