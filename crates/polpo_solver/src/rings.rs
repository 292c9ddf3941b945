//! Rings: what is pressed together in one direction swells in the others.

use glam::Vec3A;

use crate::coloring::color_rows;
use crate::{Facet, Material, Particles};

/// A constraint on each particle's cell, for Poisson's ratio: its facets' stretches, weighted by what of the cell is theirs, are its change of volume
///
/// ```text
/// C_i = Σ A·(s/h)·(|d| − h),   α = V/κ,   κ = E/(1 + ν)·b/(1 − b·ΣA·s/V),   b = ν/(1 + ν)
/// ```
///
/// with A the facet's area along the edge, s the distance from the particle to it along the edge and h that to the neighbour. In a lattice of cubes ΣA·s/V = 3 and κ is Lamé's λ. The edges of
/// [`CalibratedEdges::from_facets`](crate::CalibratedEdges::from_facets) alone have ν = 0. ν = ½ gives α = 0: as incompressible as a sweep can make it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Rings {
    /// The particle of each ring, sorted by colour: rings of one colour share no particle.
    pub middle: Vec<u32>,
    /// Where each ring starts in `around`, and the end of the last.
    pub starts: Vec<u32>,
    /// The neighbours.
    pub around: Vec<u32>,
    /// A·s/h \[m²\], and h \[m\], of each neighbour.
    pub weight: Vec<[f32; 2]>,
    /// α \[m³/Pa\].
    pub compliance: Vec<f32>,
}

impl Rings {
    /// Of the facets, which have been checked, in an order that `rank` gives the particles.
    pub(crate) fn new(particles: &Particles, facets: &[Facet], volumes: &[f32], material: &Material, rank: &[u32]) -> Self {
        let (e, nu) = (material.youngs_modulus, material.poissons_ratio);
        let b = nu / (1.0 + nu);
        let mut this = Self { starts: vec![0], ..Self::default() };
        if nu == 0.0 {
            return this;
        }
        let mut rings: Vec<Vec<(u32, [f32; 2])>> = vec![Vec::new(); particles.len()];
        for facet in facets {
            let [i, j] = facet.pair;
            let d = particles.rest_position[j as usize] - particles.rest_position[i as usize];
            let h = d.length();
            let area = facet.area.dot(d) / h;
            for (a, b, sign) in [(i, j, 1.0), (j, i, -1.0)] {
                if volumes[a as usize] > 0.0 {
                    // Along e the facet's plane is S·(c − x)/(S·e) away.
                    let s = sign * facet.area.dot(facet.centroid - particles.rest_position[a as usize]) / area;
                    rings[a as usize].push((b, [area * s.clamp(0.0, h) / h, h]));
                }
            }
        }
        let mut middles: Vec<u32> = (0..particles.len() as u32).collect();
        middles.sort_by_key(|&i| rank[i as usize]);
        let rows: Vec<Vec<u32>> =
            middles.iter().map(|&i| core::iter::once(i).chain(rings[i as usize].iter().map(|r| r.0)).collect()).collect();
        let (order, _) = color_rows(particles.len(), rows.iter().map(Vec::as_slice));
        for at in order {
            let i = middles[at as usize];
            let ring = &rings[i as usize];
            if ring.is_empty() {
                continue;
            }
            let volume = volumes[i as usize];
            let held: f32 = ring.iter().map(|(_, [w, h])| w * h).sum::<f32>() / volume;
            let compliance = volume * (1.0 + nu) / e * (1.0 - b * held) / b;
            this.middle.push(i);
            this.around.extend(ring.iter().map(|r| r.0));
            this.weight.extend(ring.iter().map(|r| r.1));
            this.starts.push(this.around.len() as u32);
            this.compliance.push(compliance.max(0.0));
        }
        this
    }
}

/// Solves every ring once, in a substep of `dt` \[s\], after the edges: λ = −C/max(α/δt² + ½D, D) with D = Σ w·|∂C/∂x|², as for [`solve_calibrated_edges`](crate::solve_calibrated_edges). All forces lie along
/// the lines between the particles and come in pairs, so linear and angular momentum are kept. A neighbour in the same place has no direction and is left out.
pub fn solve_rings(rings: &Rings, particles: &mut Particles, dt: f32) {
    let rate = 1.0 / dt;
    for (r, &i) in rings.middle.iter().enumerate() {
        let i = i as usize;
        let range = rings.starts[r] as usize..rings.starts[r + 1] as usize;
        let (mut error, mut sum, mut weight) = (0.0, Vec3A::ZERO, 0.0);
        for k in range.clone() {
            let j = rings.around[k] as usize;
            let [share, rest] = rings.weight[k];
            let d = particles.position[j] - particles.position[i];
            let length = d.length();
            error += share * (length - rest);
            if length > 0.0 {
                sum += d * (share / length);
                weight += particles.inverse_mass[j] * share * share;
            }
        }
        weight += particles.inverse_mass[i] * sum.length_squared();
        if weight <= 0.0 {
            continue;
        }
        let lambda = -error / (rings.compliance[r] * rate * rate + 0.5 * weight).max(weight);
        let from = particles.position[i];
        for k in range {
            let j = rings.around[k] as usize;
            let d = particles.position[j] - from;
            let length = d.length();
            if length > 0.0 {
                pull(particles, j, d * (rings.weight[k][0] * lambda / length), rate);
            }
        }
        pull(particles, i, sum * -lambda, rate);
    }
}

fn pull(particles: &mut Particles, i: usize, force: Vec3A, rate: f32) {
    let w = particles.inverse_mass[i];
    if w > 0.0 {
        particles.displace(i, force * w, rate);
    } else if let Some(reaction) = particles.reaction.get_mut(i) {
        *reaction += force * rate;
    }
}
