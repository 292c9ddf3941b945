//! Calibrated edges, one after the other.

use glam::{Mat3A, Quat, Vec3A};
use polpo_solver::{CalibratedEdges, Particles, quat_exp};

/// cos ½θ of the angle θ between the ends below which the long way round is looked at too.
const BENT: f32 = 0.9;

/// One edge: what of it does not change.
#[derive(Clone, Copy, Debug)]
struct Edge {
    /// Where it holds on to its ends, seen from either at rest \[m\].
    contact: [Vec3A; 2],
    /// The gap there at rest, in the edge's axes \[m\].
    rest_gap: Vec3A,
    /// The edge's axes at rest.
    frame: Quat,
    /// \[m/N\]
    stretch: Vec3A,
    /// \[rad/(N·m)\]
    bend: Vec3A,
    ends: [u32; 2],
}

/// Calibrated edges between free particles, as a scalar kernel wants them.
#[derive(Clone, Debug)]
pub struct ScalarEdges {
    edges: Vec<Edge>,
    /// Whether any edge holds on to anything but its ends' centres.
    contacts: bool,
}

/// How an edge is strained.
struct Strain {
    /// Its axes.
    axes: Mat3A,
    /// γ \[m\] and φ \[rad\], in them.
    gamma: Vec3A,
    phi: Vec3A,
    /// Φ = R·φ
    turn: Vec3A,
}

impl ScalarEdges {
    /// The same edges in the same order. Without a rest pose and retardation.
    pub fn new(edges: &CalibratedEdges) -> Self {
        let edge = |e: usize| Edge {
            contact: edges.contact.get(e).copied().unwrap_or_default(),
            rest_gap: edges.rest_gap[e],
            frame: edges.frame[e],
            stretch: edges.stretch_compliance[e],
            bend: edges.bend_compliance[e],
            ends: edges.pairs[e],
        };
        Self { edges: (0..edges.pairs.len()).map(edge).collect(), contacts: !edges.contact.is_empty() }
    }

    /// Solves every edge once in a substep of `dt` \[s\]; no particle may be pinned.
    ///
    /// With the edge's axes R = mat(normalise(q_i + q_j)·F), the contact points' gap g and p = q_j·q_i⁻¹
    ///
    /// ```text
    /// γ = Rᵀg − g_rest,   φ = Rᵀ·4·vec(p)/(1 + p_w),   λ = −C/max(α/δt² + ½D, D) for each of the six rows C
    /// D_k = w_i + w_j + Σ (1/I)·|a × R·e_k|²,   D_φ = s²·(1/I_i + 1/I_j),   s = 1 + |φ|²/16
    /// ```
    ///
    /// and the forces ±f, f = R·λ_γ, at the middle between the contact points, and the moments ±(a×f + s·R·λ_φ + ⅛Φ×(f×g)).
    pub fn solve(&self, particles: &mut Particles, dt: f32) {
        if self.contacts { self.sweep::<true>(particles, dt) } else { self.sweep::<false>(particles, dt) }
    }

    fn sweep<const CONTACTS: bool>(&self, particles: &mut Particles, dt: f32) {
        let rate = 1.0 / dt;
        let count = particles.len();
        let x = &mut particles.position[..count];
        let v = &mut particles.velocity[..count];
        let q = &mut particles.rotation[..count];
        let omega = &mut particles.angular_velocity[..count];
        let (w, u) = (&particles.inverse_mass[..count], &particles.inverse_inertia[..count]);
        for edge in &self.edges {
            let [i, j] = edge.ends.map(|end| end as usize);
            let mut gap = x[j] - x[i];
            let mut arm = [Vec3A::ZERO; 2];
            if CONTACTS {
                arm = [q[i] * edge.contact[0], q[j] * edge.contact[1]];
                gap += arm[1] - arm[0];
            }
            arm[0] += gap * 0.5;
            arm[1] -= gap * 0.5;

            let near = q[i].dot(q[j]);
            let far = if near < 0.0 { -q[j] } else { q[j] };
            let mut strain = edge.strain(q[i], far, gap);
            if near.abs() < BENT {
                let long = edge.strain(q[i], -far, gap);
                if edge.energy(&long) < edge.energy(&strain) {
                    strain = long;
                }
            }
            let Strain { axes, gamma, phi, turn } = strain;
            let steep = 1.0 + turn.length_squared() * (1.0 / 16.0);

            let back = axes.transpose();
            let across = |arm: Vec3A| {
                let a = back * arm;
                Vec3A::splat(a.length_squared()) - a * a
            };
            let weight = Vec3A::splat(w[i] + w[j]) + across(arm[0]) * u[i] + across(arm[1]) * u[j];
            let give = (edge.stretch * (rate * rate) + weight * 0.5).max(weight);
            let force = axes * (gamma / -give);
            let weight = Vec3A::splat(steep * steep * (u[i] + u[j]));
            let give = (edge.bend * (rate * rate) + weight * 0.5).max(weight);
            let moment = axes * (phi / give) * -steep + turn.cross(force.cross(gap)) * 0.125;

            for (k, sign, arm) in [(i, -1.0, arm[0]), (j, 1.0, arm[1])] {
                let way = force * (sign * w[k]);
                x[k] += way;
                v[k] += way * rate;
                let angle = (arm.cross(force) + moment) * (sign * u[k]);
                q[k] = quat_exp(angle) * q[k];
                omega[k] += angle * rate;
            }
        }
    }
}

impl Edge {
    #[inline(always)]
    fn strain(&self, qi: Quat, qj: Quat, gap: Vec3A) -> Strain {
        let axes = Mat3A::from_quat((qi + qj).normalize() * self.frame);
        let p = qj * qi.conjugate();
        let turn = Vec3A::new(p.x, p.y, p.z) * (4.0 / (1.0 + p.w));
        let back = axes.transpose();
        Strain { axes, gamma: back * gap - self.rest_gap, phi: back * turn, turn }
    }

    /// Twice the energy \[J\].
    fn energy(&self, strain: &Strain) -> f32 {
        (strain.gamma * strain.gamma).dot(self.stretch.recip()) + (strain.phi * strain.phi).dot(self.bend.recip())
    }
}

#[cfg(test)]
mod tests {
    use polpo_solver::{Sweep, solve_calibrated_edges};

    use super::*;
    use crate::kernels::{Body, stir};
    use crate::scalar::testing::assert_close;

    /// The library's result but for rounding, of rods and of facets, hardly or badly strained.
    #[test]
    fn strains_as_the_library_does() {
        let dt = 1.0 / 300.0;
        for body in [Body::octopus(), Body::block([5, 6, 7])] {
            for make in [Body::rods, Body::facets] {
                for size in [0.01, 0.05, 0.2] {
                    let (mut particles, edges) = make(&body);
                    stir(&mut particles, size);
                    let (mut wide, mut scalar) = (particles.clone(), particles.clone());
                    solve_calibrated_edges(&edges, &mut wide, Sweep::only(dt));
                    ScalarEdges::new(&edges).solve(&mut scalar, dt);
                    assert_close(&wide, &scalar, &particles, dt);
                }
            }
        }
    }
}
