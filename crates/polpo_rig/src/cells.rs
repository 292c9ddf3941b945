//! Cells: how the particles divide the body's volume between them, and where the parts touch.

use std::collections::BTreeSet;

use glam::{DMat3, DVec3, Vec3};
use serde::{Deserialize, Serialize};

use crate::clean::{DisjointSets, Surface};
use crate::edit::Edits;
use crate::ellipsoids::outer;
use crate::facets::{self, Patch};
use crate::fill::Fill;
use crate::recipe::RecipeMaterial;
use crate::sample::Sample;
use crate::{RigFault, limb};

/// What makes a body as stiff as its material: the volume of each particle's cell, and the facets between cells.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Cells {
    /// What the body is made of.
    pub material: RecipeMaterial,
    /// Volume of each particle's cell \[m³\], not negative; one a particle.
    pub volumes: Vec<f32>,
    /// Where cells touch, each pair once, sorted by it.
    pub facets: Vec<Facet>,
    /// If the body is one slender limb, its direction and section.
    pub limb: Option<Limb>,
}

/// Where two cells touch.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Facet {
    /// The particles on its two sides, the smaller index first.
    pub pair: [u32; 2],
    /// Vector area, facing from the first particle to the second \[m²\].
    pub area: Vec3,
    /// Centroid \[m\].
    pub centroid: Vec3,
    /// Second moments of area about the centroid, xx, yy, zz, xy, xz, yz \[m⁴\].
    pub moments: [f32; 6],
}

/// The direction and section of a slender body.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Limb {
    /// Unit vector along it.
    pub axis: Vec3,
    /// Its length \[m\].
    pub length: f32,
    /// Mean area A of its section \[m²\].
    pub area: f32,
    /// Mean second moment I of its section about an axis across it \[m⁴\].
    pub bending: f32,
    /// Torsion constant J of its section \[m⁴\].
    pub torsion: f32,
}

impl Cells {
    /// The cells of a settled sample. `edges` tie what does not touch, and `edits` what they say; the volumes add up to `volume`, in the unit box.
    pub(crate) fn new(
        material: RecipeMaterial,
        surface: &Surface,
        fill: &Fill<'_>,
        sample: &Sample,
        edges: &[[u32; 2]],
        edits: &Edits<'_>,
        volume: f64,
    ) -> Cells {
        let mut volumes = vec![0.0; sample.positions.len()];
        for (&owner, &(share, _)) in sample.owner.iter().zip(&fill.parts) {
            volumes[owner as usize] += share;
        }
        let unit = volume / volumes.iter().sum::<f64>();
        volumes.iter_mut().for_each(|v| *v *= unit);

        let mut patches = facets::between(fill, sample);
        patches.retain(|patch| !edits.cut.contains(&patch.pair));
        let facing: BTreeSet<[u32; 2]> = patches.iter().map(|patch| patch.pair).collect();
        let made = edits.tied.difference(&facing).copied();
        patches.extend(made.filter_map(|pair| tie(pair, sample, &volumes)));
        let mut sets = DisjointSets::new(volumes.len());
        for patch in &patches {
            sets.join(patch.pair[0], patch.pair[1]);
        }
        let ties: Vec<[u32; 2]> = edges.iter().copied().filter(|&[a, b]| sets.join(a, b)).collect();
        patches.extend(ties.into_iter().filter_map(|pair| tie(pair, sample, &volumes)));
        patches.sort_by_key(|p| p.pair);

        let scale = surface.scale;
        let (area, volume) = (scale * scale, scale * scale * scale);
        let facets = patches.iter().map(|p| {
            let [x, y, z] = [p.moments.x_axis, p.moments.y_axis, p.moments.z_axis].map(|c| c * area * area);
            Facet {
                pair: p.pair,
                area: (p.area * area).as_vec3(),
                centroid: (surface.origin + p.centroid * scale).as_vec3(),
                moments: [x.x, y.y, z.z, x.y, x.z, y.z].map(|m| m as f32),
            }
        });
        let limb = limb::find(fill).map(|bar| Limb {
            axis: bar.axis.as_vec3(),
            length: (bar.length * scale) as f32,
            area: (bar.area * area) as f32,
            bending: (bar.bending * area * area) as f32,
            torsion: (bar.torsion * area * area) as f32,
        });
        Cells { material, facets: facets.collect(), volumes: volumes.iter().map(|v| (v * volume) as f32).collect(), limb }
    }

    pub(crate) fn fault(&self, particles: usize) -> Option<RigFault> {
        if self.volumes.len() != particles {
            return Some(RigFault::Cells { what: "there is not one volume a particle", index: self.volumes.len() });
        }
        if let Some(index) = self.volumes.iter().position(|v| !(v.is_finite() && *v >= 0.0)) {
            return Some(RigFault::Cells { what: "a volume is negative or not finite", index });
        }
        if let Some(index) = (1..self.facets.len()).find(|&f| self.facets[f - 1].pair >= self.facets[f].pair) {
            return Some(RigFault::Cells { what: "facets are not sorted by their pairs, or one comes twice", index });
        }
        self.facets.iter().enumerate().find_map(|(index, facet)| {
            let [a, b] = facet.pair;
            let what = if a >= b || b as usize >= particles {
                "a facet's pair is not the smaller index first, or not there"
            } else if !(facet.area.is_finite() && facet.centroid.is_finite() && facet.moments.iter().all(|m| m.is_finite())) {
                "a facet is not finite"
            } else {
                return None;
            };
            Some(RigFault::Cells { what, index })
        })
    }
}

/// The facet between two cells that do not touch: a square halfway, as large as the smaller cell is wide. `None` for two in the same place.
fn tie([a, b]: [u32; 2], sample: &Sample, volumes: &[f64]) -> Option<Patch> {
    let [x, y] = [a, b].map(|i| sample.positions[i as usize]);
    let normal: DVec3 = (y - x).try_normalize()?;
    let side = libm::cbrt(volumes[a as usize].min(volumes[b as usize]));
    let area = side * side;
    Some(Patch {
        pair: [a, b],
        area: normal * area,
        centroid: (x + y) * 0.5,
        moments: (DMat3::IDENTITY - outer(normal)) * (area * area / 12.0),
    })
}
