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
    /// No c makes the limb stretch by more than a hundredth where it hangs by one end in 10 m/s²: soft ones, which would, keep more of their stretch or all of it.
    ///
    /// Bend that strong makes cells turn together, not each as the body does where it is: the shear that is left then holds as much of a twist as if it were twice as stiff and nothing warped. That much the section's twist is less.
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
        let (first, last) =
            particles.rest_position.iter().map(|x| x.dot(axis)).fold((f32::MAX, f32::MIN), |(a, b), x| (a.min(x), b.max(x)));
        let hanging = 0.5 * material.density * 10.0 * (last - first) / e;
        let cap = match (bend, stretch) {
            (Some(bend), Some(stretch)) => (2.0 * bend / stretch).max(hanging / 0.01),
            _ => 1.0,
        };
        if cap.is_nan() || cap >= 1.0 {
            return Ok(1.0);
        }
        let twist = self.twist_left(particles, axis, cap, &of_section);
        for (edge, section) in of_section.into_iter().enumerate() {
            let own = self.bend_compliance[edge].recip();
            let old = Mat3A::from_quat(self.frame[edge]);
            let along = if old.x_axis.dot(axis) < 0.0 { -axis } else { axis };
            let frame = (Quat::from_rotation_arc(old.x_axis.into(), along.into()) * self.frame[edge]).normalize();
            // What is left of the own stiffness in the limb's frame: the diagonal of Rᵀ·(R₀·K·R₀ᵀ)·R.
            let back = Mat3A::from_quat(frame).transpose() * old;
            let seen = Mat3A::from_cols(back.x_axis * back.x_axis, back.y_axis * back.y_axis, back.z_axis * back.z_axis) * own;
            self.frame[edge] = frame;
            self.bend_compliance[edge] = (seen * cap + section * Vec3A::new(twist, 1.0 - cap, 1.0 - cap)).recip();
            self.stretch_compliance[edge] /= cap;
        }
        for compliance in &mut rings.compliance {
            *compliance /= cap;
        }
        Ok(cap)
    }

    /// The share of the section's twist, `of_section`.x, with which all of the limb twists as the section does. With cells that turn as one at each place along the axis t, a twist of φ′ opens a facet by φ′·(d·t)·|r|, where
    /// r is how far it lies off the axis, and turns its ends by φ′·(d·t): with k and b the stiffness of its shear and own twist, what is left is 1 − c·Σ(k·r² + b)(d·t)² / Σ of_section·(d·t)², not below 0.
    fn twist_left(&self, particles: &Particles, axis: Vec3A, cap: f32, of_section: &[Vec3A]) -> f32 {
        let ends = |edge: usize| self.pairs[edge].map(|i| particles.rest_position[i as usize]);
        // What is no facet acts halfway.
        let place = |edge: usize| {
            let [i, j] = ends(edge);
            self.contact.get(edge).map_or((i + j) * 0.5, |[from_first, _]| i + *from_first)
        };
        let (mut middle, mut weight) = (Vec3A::ZERO, 0.0);
        for (edge, section) in of_section.iter().enumerate() {
            middle += place(edge) * section.x;
            weight += section.x;
        }
        middle /= weight;
        let (mut held, mut whole) = (0.0, 0.0);
        for (edge, section) in of_section.iter().enumerate() {
            let [i, j] = ends(edge);
            let reach = (j - i).dot(axis);
            let own = Mat3A::from_quat(self.frame[edge]).transpose() * axis;
            let own = (own * own).dot(self.bend_compliance[edge].recip());
            let off = (place(edge) - middle).reject_from_normalized(axis).length_squared();
            held += (off / self.stretch_compliance[edge].max_element() + own) * reach * reach;
            whole += section.x * reach * reach;
        }
        (1.0 - cap * held / whole).max(0.0)
    }
}
