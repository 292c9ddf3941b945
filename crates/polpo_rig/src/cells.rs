//! Cells: how the particles divide the body's volume between them, and where the parts touch.

use glam::Vec3;
use serde::{Deserialize, Serialize};

use crate::RigFault;
use crate::recipe::RecipeMaterial;

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
