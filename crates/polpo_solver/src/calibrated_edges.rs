//! Calibrated edges: stretch, shear, bend and twist from a material and a section, without tuning.

use core::f32::consts::PI;

use glam::{Mat3A, Quat, Vec3A};

use crate::coloring::color_rows;
use crate::{Edges, Particles};

/// What an edge is made of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Material {
    /// Young's modulus E \[Pa\], positive. Rubber has about 1e6, wood 1e10.
    pub youngs_modulus: f32,
    /// Poisson's ratio ν, −1 … 0.5; the shear modulus is E/(2(1 + ν)).
    pub poissons_ratio: f32,
    /// ρ \[kg/m³\], positive.
    pub density: f32,
}

/// The cross-section of an edge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Section {
    /// A \[m²\]
    pub area: f32,
    /// Second moment of area I, the same about both axes \[m⁴\].
    pub bending: f32,
    /// Torsion constant J \[m⁴\].
    pub torsion: f32,
    /// Shear factor κ: how much of the area counts against shear.
    pub shear: f32,
}

impl Section {
    /// A full circle of `radius` \[m\].
    pub fn circle(radius: f32) -> Self {
        let r2 = radius * radius;
        Self { area: PI * r2, bending: 0.25 * PI * r2 * r2, torsion: 0.5 * PI * r2 * r2, shear: 0.9 }
    }

    /// A full square of `side` \[m\].
    pub fn square(side: f32) -> Self {
        let a2 = side * side;
        Self { area: a2, bending: a2 * a2 / 12.0, torsion: 0.1406 * a2 * a2, shear: 5.0 / 6.0 }
    }
}

/// Why edges could not be calibrated.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum CalibrationError {
    /// A number of the material or the section is out of its range.
    #[error("{what} is {value}, {range}")]
    Range {
        /// Which number.
        what: &'static str,
        /// What it is.
        value: f32,
        /// What it should be.
        range: &'static str,
    },
    /// An edge has no length to calibrate.
    #[error("edge {edge}: its ends are in the same place at rest")]
    Length {
        /// Which edge.
        edge: usize,
    },
}

/// Edges that carry stretch, shear, bend and twist, sorted by colour.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CalibratedEdges {
    /// Ends of each edge.
    pub pairs: Vec<[u32; 2]>,
    /// Length at rest \[m\].
    pub rest_length: Vec<f32>,
    /// The edge's axes at rest, x along it.
    pub frame: Vec<Quat>,
    /// h/EA, h/κGA, h/κGA along the edge's axes \[m/N\].
    pub stretch_compliance: Vec<Vec3A>,
    /// h/GJ, h/EI, h/EI about the edge's axes \[rad/(N·m)\].
    pub bend_compliance: Vec<Vec3A>,
}

impl CalibratedEdges {
    /// Makes the `edges` of a body rods of one material and section, and gives the particles the masses and spin inertias that belong to them.
    ///
    /// Masses are m = ρA·h, half of each edge at either end; a particle without edges keeps its own. The spin inertia is m·r² with r the largest of √(I/A), h/2 and `spin_radius` \[m\] (0: none): the
    /// larger, the fewer substeps are needed ([`recommended_substeps`](Self::recommended_substeps)), and the slower are the higher modes and the tumbling: 0.12 of a limb's length costs 17 % of the
    /// latter and is a good start.
    ///
    /// # Errors
    ///
    /// A number out of its range, or an edge without length.
    pub fn rods(
        particles: &mut Particles,
        edges: &Edges,
        material: &Material,
        section: &Section,
        spin_radius: f32,
    ) -> Result<Self, CalibrationError> {
        let positive = [
            ("Young's modulus", material.youngs_modulus),
            ("the density", material.density),
            ("the area", section.area),
            ("the second moment of area", section.bending),
            ("the torsion constant", section.torsion),
            ("the shear factor", section.shear),
        ];
        for (what, value) in positive {
            if !(value > 0.0 && value.is_normal()) {
                return Err(CalibrationError::Range { what, value, range: "not positive and normal" });
            }
        }
        let nu = material.poissons_ratio;
        if !(nu > -1.0 && nu <= 0.5) {
            return Err(CalibrationError::Range { what: "Poisson's ratio", value: nu, range: "not above -1 and at most 0.5" });
        }
        if !(spin_radius >= 0.0 && spin_radius.is_finite()) {
            return Err(CalibrationError::Range { what: "the spin radius", value: spin_radius, range: "not 0 or more" });
        }
        if let Some(edge) = edges.rest_length.iter().position(|&h| h.is_nan() || h <= 0.0) {
            return Err(CalibrationError::Length { edge: edges.input[edge] as usize });
        }
        let e = material.youngs_modulus;
        let g = e / (2.0 * (1.0 + nu));
        let (order, _) = color_rows(particles.len(), edges.pairs.iter().map(|p| p.as_slice()));
        let mut this = Self::default();
        let mut mass = vec![0.0f32; particles.len()];
        let mut longest = vec![0.0f32; particles.len()];
        for &edge in &order {
            let ([i, j], h) = (edges.pairs[edge as usize], edges.rest_length[edge as usize]);
            for end in [i, j] {
                mass[end as usize] += 0.5 * material.density * section.area * h;
                longest[end as usize] = longest[end as usize].max(h);
            }
            this.pairs.push([i, j]);
            this.rest_length.push(h);
            let along = (particles.rest_position[j as usize] - particles.rest_position[i as usize]) / h;
            this.frame.push(Quat::from_rotation_arc(glam::Vec3::X, along.into()));
            let shear = h / (section.shear * g * section.area);
            this.stretch_compliance.push(Vec3A::new(h / (e * section.area), shear, shear));
            let bend = h / (e * section.bending);
            this.bend_compliance.push(Vec3A::new(h / (g * section.torsion), bend, bend));
        }
        for i in 0..particles.len() {
            if mass[i] > 0.0 {
                particles.set_mass(i, mass[i]);
                let radius = (section.bending / section.area).sqrt().max(0.5 * longest[i]).max(spin_radius);
                particles.set_inertia(i, particles.mass[i] * radius * radius);
            }
        }
        Ok(this)
    }

    /// How many substeps a step of `dt` \[s\] needs for the stiffness to be what the material says, within about 5 % in sag and frequency: K = δt²·D/α ≤ ⅔ for the stiffest edge in bending. With fewer
    /// than half of it the answer is stable and means nothing.
    pub fn recommended_substeps(&self, particles: &Particles, dt: f32) -> u32 {
        let mut most = 0.0f32;
        for (&[i, j], compliance) in self.pairs.iter().zip(&self.bend_compliance) {
            let d = 1.0 / particles.inertia[i as usize] + 1.0 / particles.inertia[j as usize];
            most = most.max(d / compliance.y);
        }
        // Saturates, also for an infinity.
        (dt * (1.5 * most).sqrt()).ceil().max(1.0) as u32
    }
}

/// Solves every edge once, in a substep of `dt` \[s\].
///
/// The edge is a group of two whose rotation is the mean of its ends': R = mat(normalise(q_i + q_j)·F), with q_j flipped so that q_i·q_j ≥ 0. With d = x_j − x_i its strains are γ = Rᵀd − h·e_x and
/// φ = Rᵀ·4·vec(p)/(1 + p_w), p = q_j·q_i⁻¹. Each of the six rows C has its compliance α and λ = −C/max(α/δt² + ½D, D), with
///
/// ```text
/// D_axial = w_i + w_j,   D_shear = D_axial + ¼(1/I_i + 1/I_j)|d|²,   D_φ = 1/I_i + 1/I_j
/// ```
///
/// The ½D: a cold Gauss–Seidel sweep adds that much compliance on the average, and taking it off makes the answer independent of δt. The force f = R·λ_γ acts at the middle, so each end takes the moment
/// ½·f×d besides ±R·λ_φ: linear and angular momentum are kept to first order. Stable at every δt; see [`CalibratedEdges::recommended_substeps`] for what it is worth there.
pub fn solve_calibrated_edges(edges: &CalibratedEdges, particles: &mut Particles, dt: f32) {
    let rate = 1.0 / dt;
    let rate2 = rate * rate;
    for (e, &[i, j]) in edges.pairs.iter().enumerate() {
        let (i, j) = (i as usize, j as usize);
        let (wi, wj) = (particles.inverse_mass[i], particles.inverse_mass[j]);
        let (ui, uj) = (particles.inverse_inertia[i], particles.inverse_inertia[j]);
        let d = particles.position[j] - particles.position[i];
        let qi = particles.rotation[i];
        let qj = if qi.dot(particles.rotation[j]) < 0.0 { -particles.rotation[j] } else { particles.rotation[j] };
        let r = Mat3A::from_quat((qi + qj).normalize() * edges.frame[e]);
        let back = r.transpose();
        let gamma = back * d - Vec3A::X * edges.rest_length[e];
        let p = qj * qi.inverse();
        let phi = back * (Vec3A::new(p.x, p.y, p.z) * (4.0 / (1.0 + p.w)));

        let axial = wi + wj;
        let shear = axial + 0.25 * (ui + uj) * d.length_squared();
        let weight = Vec3A::new(axial, shear, shear);
        let force = r * -over(gamma, (edges.stretch_compliance[e] * rate2 + weight * 0.5).max(weight));
        let weight = Vec3A::splat(ui + uj);
        let moment = r * -over(phi, (edges.bend_compliance[e] * rate2 + weight * 0.5).max(weight));

        let arm = force.cross(d) * 0.5;
        for (k, sign, w, u) in [(i, -1.0, wi, ui), (j, 1.0, wj, uj)] {
            if w > 0.0 {
                particles.displace(k, force * (sign * w), rate);
            } else if let Some(reaction) = particles.reaction.get_mut(k) {
                *reaction += force * (sign * rate);
            }
            if u > 0.0 {
                particles.turn(k, (arm + moment * sign) * u, rate);
            }
        }
    }
}

/// a/b, zero where b is not positive.
#[inline]
fn over(a: Vec3A, b: Vec3A) -> Vec3A {
    Vec3A::select(b.cmpgt(Vec3A::ZERO), a / b, Vec3A::ZERO)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{Random, line};
    use crate::{integrate, momentum, predict, quat_exp};

    const DENSITY: f32 = 1000.0;
    const SIDE: f32 = 0.075;
    const NU: f32 = 0.3;

    /// A bar of 1 m, clamped at its first particle, whose own weight bends it by 5 cm without shear.
    fn cantilever(n: usize) -> (Particles, CalibratedEdges) {
        let section = Section::square(SIDE);
        let e = DENSITY * 9.81 * section.area / (8.0 * section.bending * 0.05);
        let mut p = line(n, 1.0 / (n - 1) as f32, 0.02);
        let pairs: Vec<[u32; 2]> = (1..n as u32).map(|i| [i - 1, i]).collect();
        let edges = Edges::new(&p, &pairs).unwrap();
        let material = Material { youngs_modulus: e, poissons_ratio: NU, density: DENSITY };
        let rods = CalibratedEdges::rods(&mut p, &edges, &material, &section, 0.12).unwrap();
        p.pin(0, true, true);
        (p, rods)
    }

    /// ρgAL⁴/(8EI) + ρgL²/(2κG)
    fn exact_sag() -> f32 {
        let section = Section::square(SIDE);
        let e = DENSITY * 9.81 * section.area / (8.0 * section.bending * 0.05);
        0.05 + DENSITY * 9.81 / (2.0 * section.shear * e / (2.0 * (1.0 + NU)))
    }

    fn sag(n: usize, rate: f32, substeps: u32) -> f32 {
        let (mut p, rods) = cantilever(n);
        let dt = 1.0 / (rate * substeps as f32);
        let (mut sum, mut count) = (0.0, 0);
        for step in 0..(6.0 * rate) as usize {
            let late = step as f32 > 3.0 * rate;
            for _ in 0..substeps {
                // Damped on the way down, free at the end.
                integrate(&mut p, dt, if late { 0.5 } else { 6.0 });
                predict(&mut p, Vec3A::new(0.0, -9.81, 0.0), dt);
                solve_calibrated_edges(&rods, &mut p, dt);
            }
            if step as f32 > 5.0 * rate {
                sum -= p.position[n - 1].y;
                count += 1;
            }
        }
        sum / count as f32
    }

    #[test]
    fn a_cantilever_sags_as_timoshenko_says_at_every_resolution_and_time_step() {
        for n in [5, 9, 17, 33] {
            for rate in [30.0, 60.0, 120.0, 240.0] {
                let (p, rods) = cantilever(n);
                let substeps = rods.recommended_substeps(&p, 1.0 / rate);
                let got = sag(n, rate, substeps);
                let error = got / exact_sag() - 1.0;
                println!("{n:2} particles, {rate:3} Hz × {substeps:3}: {got:.4} m, {:+.1} %", 100.0 * error);
                assert!(error.abs() < 0.05, "{n} particles, {rate} Hz × {substeps}: {got} m");
            }
        }
    }

    /// With a quarter of the substeps it is stable and much too soft: what the rule is there to tell.
    #[test]
    fn too_few_substeps_are_stable() {
        let (p, rods) = cantilever(17);
        let enough = rods.recommended_substeps(&p, 1.0 / 60.0);
        let got = sag(17, 60.0, enough / 8);
        assert!(got.is_finite() && got > 1.2 * exact_sag() && got < 1.1, "{got} m");
    }

    /// A single edge at random: impulses and their moments cancel.
    #[test]
    fn an_edge_keeps_linear_and_angular_momentum() {
        let mut random = Random(5);
        for _ in 0..200 {
            let (mut p, mut rods) = cantilever(3);
            p.pin(0, false, false);
            p.set_mass(1, 1.0 + 100.0 * random.signed().abs());
            rods.pairs.truncate(1);
            for i in 0..2 {
                p.position[i] += random.vector() * 0.2;
                p.rotation[i] = quat_exp(random.vector());
                p.velocity[i] = Vec3A::ZERO;
            }
            solve_calibrated_edges(&rods, &mut p, 0.01);
            let (mut linear, mut angular, mut scale) = (Vec3A::ZERO, Vec3A::ZERO, 0.0f32);
            // The impulses, at the places where they acted.
            let back = |i: usize| p.position[i] - p.velocity[i] * 0.01;
            for i in 0..2 {
                linear += p.velocity[i] * p.mass[i];
                angular += back(i).cross(p.velocity[i] * p.mass[i]) + p.angular_velocity[i] * p.inertia[i];
                scale += p.velocity[i].length() * p.mass[i] + p.angular_velocity[i].length() * p.inertia[i];
            }
            assert!(linear.length() < 1e-6 * scale, "{linear} of {scale}");
            assert!(angular.length() < 2e-6 * scale, "{angular} of {scale}");
        }
    }

    #[test]
    fn an_undeformed_bar_is_left_alone_wherever_it_is() {
        let (mut p, rods) = cantilever(5);
        p.place(quat_exp(Vec3A::new(0.5, -1.2, 0.7)), Vec3A::new(0.3, -0.2, 0.9));
        let before = p.position.clone();
        solve_calibrated_edges(&rods, &mut p, 1e-3);
        assert!(before.iter().zip(&p.position).all(|(a, b)| a.distance(*b) < 1e-6));
    }

    /// A twisted bar untwists evenly and, free of gravity, loses neither its length nor its straightness.
    #[test]
    fn twist_is_linear_along_a_bar() {
        let n = 9;
        let (mut p, rods) = cantilever(n);
        p.pin(n - 1, true, true);
        p.rotation[n - 1] = quat_exp(Vec3A::X * 1.2);
        for _ in 0..16000 {
            integrate(&mut p, 2.5e-4, 3.0);
            predict(&mut p, Vec3A::ZERO, 2.5e-4);
            solve_calibrated_edges(&rods, &mut p, 2.5e-4);
        }
        for i in 0..n {
            let expected = 1.2 * i as f32 / (n - 1) as f32;
            let twist = crate::quat_log(p.rotation[i]).x;
            assert!((twist - expected).abs() < 5e-3, "{i}: {twist} against {expected}");
            assert!((p.position[i] - p.rest_position[i]).length() < 1e-3);
        }
    }

    /// A free bar that wobbles neither drifts nor gains energy.
    #[test]
    fn a_free_bar_does_not_drift() {
        let (mut p, rods) = cantilever(9);
        p.pin(0, false, false);
        let mut random = Random(2);
        for v in &mut p.velocity {
            *v = random.vector();
        }
        let before = momentum(&p);
        for _ in 0..5000 {
            predict(&mut p, Vec3A::ZERO, 1e-3);
            solve_calibrated_edges(&rods, &mut p, 1e-3);
        }
        let after = momentum(&p);
        let scale: f32 = before.mass * (2.0 * before.kinetic_energy / before.mass).sqrt();
        assert!(after.linear.distance(before.linear) < 1e-5 * scale, "{} → {}", before.linear, after.linear);
        assert!(after.kinetic_energy < before.kinetic_energy);
    }

    #[test]
    fn bad_materials_are_named() {
        let mut p = line(3, 1.0, 0.1);
        let edges = Edges::new(&p, &[[0, 1], [1, 2]]).unwrap();
        let good = Material { youngs_modulus: 1e6, poissons_ratio: 0.3, density: 1000.0 };
        let mut rods = |material: Material| CalibratedEdges::rods(&mut p, &edges, &material, &Section::circle(0.1), 0.0);
        assert!(rods(good).is_ok());
        let error = rods(Material { youngs_modulus: f32::NAN, ..good }).unwrap_err();
        assert_eq!(error.to_string(), "Young's modulus is NaN, not positive and normal");
        let error = rods(Material { poissons_ratio: 0.6, ..good }).unwrap_err();
        assert_eq!(error.to_string(), "Poisson's ratio is 0.6, not above -1 and at most 0.5");
        p.rest_position[1] = p.rest_position[0];
        let mut edges = edges;
        edges.rest_length[0] = 0.0;
        assert!(matches!(CalibratedEdges::rods(&mut p, &edges, &good, &Section::circle(0.1), 0.0), Err(CalibrationError::Length { .. })));
    }
}
