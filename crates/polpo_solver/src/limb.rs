//! Slender bodies of facets in few substeps.

use glam::{Mat3A, Quat, Vec3A};

use crate::calibrated_edges::{ninth_tenth, weights};
use crate::{CalibratedEdges, CalibrationError, Material, Particles, Rings, Section};

/// The direction and the section of a slender body, for [`CalibratedEdges::cap_stretch`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limb {
    /// Along it, any length but zero, in the axes of the particles' rest positions.
    pub axis: Vec3A,
    /// All of its cross-section, not that of a cell.
    pub section: Section,
}

impl CalibratedEdges {
    /// Makes edges of facets cheap where the body is one slender limb: bending, which such a body shows, keeps its stiffness, and stretch, which asks for many substeps and which nobody sees, gets what little
    /// more than the substeps of bending can give.
    ///
    /// Stretch, shear and rings are multiplied by c ≤ 1, and bend and twist become c·own + (1 − c)·(A/h)·(EI/A, GJ/A of the section) about the limb's axis: the facets' shares A/h of an even moment per area,
    /// which add up to EI and GJ in Voronoi cells, where the sum of A·h·(e·t)² over the facets is the volume. c is such that K = δt²·D/α is twice as great for stretch as for the section's bend and twist, nine
    /// edges in ten each: with the same spin radius r everywhere, 2(1 + ν)·I/(A·r²). 0.12 of the limb's length is usual for r ([`from_facets`](Self::from_facets)). Less makes the limb sag by shear, (1/c − 1) times as
    /// much as the material does, more by too few substeps. Returns c.
    ///
    /// A limb ten times as long as thick needs two fifths of the substeps then, and sags and swings within about 5 %; stretch is 1/c times that of the material. Where bending needs no fewer substeps, or all
    /// particles are pinned, c is 1 and nothing changes. To be called once, right after `from_facets` and with the walls pinned, which then count as unmovable.
    ///
    /// # Errors
    ///
    /// A number out of its range, or an axis without length.
    pub fn cap_stretch(
        &mut self,
        rings: &mut Rings,
        particles: &Particles,
        material: &Material,
        limb: &Limb,
    ) -> Result<f32, CalibrationError> {
        material.check()?;
        limb.section.check()?;
        let length = limb.axis.length();
        let Some(axis) = limb.axis.try_normalize() else {
            return Err(CalibrationError::Range { what: "the length of the limb's axis", value: length, range: "not positive and normal" });
        };
        let (e, g) = (material.youngs_modulus, material.shear_modulus());
        let moments = Vec3A::new(g * limb.section.torsion, e * limb.section.bending, e * limb.section.bending) / limb.section.area;
        // A/h from k = E/(1 + ν)·A/h, which is what is softest.
        let of_section: Vec<Vec3A> =
            self.stretch_compliance.iter().map(|c| moments * ((1.0 + material.poissons_ratio) / (e * c.max_element()))).collect();
        let bend = ninth_tenth(weights(&particles.inverse_inertia, &self.pairs).zip(&of_section).map(|(w, k)| w * k.max_element()));
        let stretch = ninth_tenth(weights(&particles.inverse_mass, &self.pairs).zip(&self.stretch_compliance).map(|(w, c)| w / c.x));
        let cap = match (bend, stretch) {
            (Some(bend), Some(stretch)) if 2.0 * bend < stretch => 2.0 * bend / stretch,
            _ => return Ok(1.0),
        };
        for (edge, section) in of_section.into_iter().enumerate() {
            let own = self.bend_compliance[edge].recip();
            let old = Mat3A::from_quat(self.frame[edge]);
            let along = if old.x_axis.dot(axis) < 0.0 { -axis } else { axis };
            let frame = (Quat::from_rotation_arc(old.x_axis.into(), along.into()) * self.frame[edge]).normalize();
            // What is left of the own stiffness in the limb's frame: the diagonal of Rᵀ·(R₀·K·R₀ᵀ)·R.
            let back = Mat3A::from_quat(frame).transpose() * old;
            let seen = Mat3A::from_cols(back.x_axis * back.x_axis, back.y_axis * back.y_axis, back.z_axis * back.z_axis) * own;
            self.frame[edge] = frame;
            self.bend_compliance[edge] = (seen * cap + section * (1.0 - cap)).recip();
            self.stretch_compliance[edge] /= cap;
        }
        for compliance in &mut rings.compliance {
            *compliance /= cap;
        }
        Ok(cap)
    }
}
