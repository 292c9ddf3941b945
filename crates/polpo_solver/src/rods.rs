//! Rods: calibrated edges of one material and section.

use glam::{Quat, Vec3A};

use crate::coloring::{color_rows, cut};
use crate::lanes::LANES;
use crate::material::not_negative;
use crate::{CalibratedEdges, CalibrationError, Edges, Material, Particles, Section};

impl CalibratedEdges {
    /// Makes the `edges` of a body rods of one material and section, and gives the particles the masses and spin inertias that belong to them.
    ///
    /// Masses are m = ρA·h, half of each edge at either end; a particle without edges keeps its own. The spin inertia is m·r² with r = √(I/A), that of the section, or, given a `spin_radius` \[m\], the largest
    /// of that, h/2 and the section's: the larger, the fewer substeps are needed when the edges are swept ([`recommended_substeps`](Self::recommended_substeps)), and the slower are the higher modes and the
    /// tumbling. 0.12 of a limb's length costs 17 % of the latter. Solved directly ([`DirectEdges`](crate::DirectEdges)), rods are cheap without.
    ///
    /// Where `seam` is true the particle is part of something else besides, the flesh around a bone say: it keeps the mass and the spin inertia it has and gets the rods' on top. Beyond its end nothing is.
    ///
    /// # Errors
    ///
    /// A number out of its range, or an edge without length.
    pub fn rods(
        particles: &mut Particles,
        edges: &Edges,
        material: &Material,
        section: &Section,
        spin_radius: Option<f32>,
        seam: &[bool],
    ) -> Result<Self, CalibrationError> {
        material.check()?;
        section.check()?;
        not_negative("the spin radius", spin_radius.unwrap_or(0.0))?;
        if let Some(edge) = edges.rest_length.iter().position(|&h| h.is_nan() || h <= 0.0) {
            return Err(CalibrationError::Length { edge: edges.input[edge] as usize });
        }
        let (e, g) = (material.youngs_modulus, material.shear_modulus());
        let (order, colors) = color_rows(particles.len(), edges.pairs.iter().map(|p| p.as_slice()));
        let mut this = Self { batches: cut(&colors, LANES), ..Self::default() };
        let mut mass = vec![0.0f32; particles.len()];
        let mut longest = vec![0.0f32; particles.len()];
        for &edge in &order {
            let ([i, j], h) = (edges.pairs[edge as usize], edges.rest_length[edge as usize]);
            for end in [i, j] {
                mass[end as usize] += 0.5 * material.density * section.area * h;
                longest[end as usize] = longest[end as usize].max(h);
            }
            this.pairs.push([i, j]);
            this.input.push(edges.input[edge as usize]);
            this.rest_gap.push(Vec3A::X * h);
            let along = (particles.rest_position[j as usize] - particles.rest_position[i as usize]) / h;
            this.frame.push(Quat::from_rotation_arc(glam::Vec3::X, along.into()));
            let shear = h / (section.shear * g * section.area);
            this.stretch_compliance.push(Vec3A::new(h / (e * section.area), shear, shear));
            let bend = h / (e * section.bending);
            this.bend_compliance.push(Vec3A::new(h / (g * section.torsion), bend, bend));
        }
        let own_radius = (section.bending / section.area).sqrt();
        for i in 0..particles.len() {
            if mass[i] > 0.0 {
                let (own_mass, own_inertia) =
                    if seam.get(i).is_some_and(|&s| s) { (particles.mass[i], particles.inertia[i]) } else { (0.0, 0.0) };
                let radius = spin_radius.map_or(own_radius, |r| own_radius.max(0.5 * longest[i]).max(r));
                particles.set_mass(i, own_mass + mass[i]);
                particles.set_inertia(i, own_inertia + mass[i] * radius * radius);
            }
        }
        Ok(this)
    }
}
