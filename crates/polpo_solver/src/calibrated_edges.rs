//! Calibrated edges: stretch, shear, bend and twist from a material, without tuning.

use glam::{Mat3A, Quat, Vec3A};

use crate::Particles;
use crate::edge_strain::BENT;

/// Edges that carry stretch, shear, bend and twist, sorted by colour: made from a section by [`rods`](Self::rods), or from the facets between the cells of a body by
/// [`from_facets`](Self::from_facets).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CalibratedEdges {
    /// Ends of each edge.
    pub pairs: Vec<[u32; 2]>,
    /// Which of the edges, or facets, that they were made from each edge is.
    pub input: Vec<u32>,
    /// Where the edge holds on to its ends, seen from either end at rest \[m\]; empty: at the ends' centres.
    pub contact: Vec<[Vec3A; 2]>,
    /// The gap between the two contact points at rest, in the edge's axes \[m\]: (h, 0, 0) where they are the centres, zero where they meet.
    pub rest_gap: Vec<Vec3A>,
    /// The edge's axes at rest, x along it.
    pub frame: Vec<Quat>,
    /// h/EA, h/κGA, h/κGA along the edge's axes \[m/N\].
    pub stretch_compliance: Vec<Vec3A>,
    /// h/GJ, h/EI, h/EI about the edge's axes \[rad/(N·m)\].
    pub bend_compliance: Vec<Vec3A>,
    /// Retardation time τ of the material \[s\]: its stress is E·(ε + τ·dε/dt), so a mode of frequency f is damped with the ratio π·f·τ, and slow motion not at all. Range 0 (none, the default) to
    /// infinity; negative and NaN count as 0. What takes longer than a substep to relax needs more substeps, see [`recommended_substeps`](Self::recommended_substeps).
    pub retardation: f32,
    /// The inverse of how the ends are turned in the rest pose; empty while they are not.
    pub(crate) rest_turn: Vec<[Quat; 2]>,
    /// Axes, gap and contact points as the edges were made; empty until they are posed.
    pub(crate) made: Vec<MadeEdge>,
}

/// An edge as it was made, without a rest pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct MadeEdge {
    pub(crate) frame: Quat,
    pub(crate) rest_gap: Vec3A,
    pub(crate) contact: [Vec3A; 2],
}

impl CalibratedEdges {
    /// How many substeps a step of `dt` \[s\] needs for the stiffness to be what the material says when the edges are swept: none longer than [`longest_substep`](Self::longest_substep).
    pub fn recommended_substeps(&self, particles: &Particles, dt: f32) -> u32 {
        // Saturates, also for an infinity.
        (dt / self.longest_substep(particles)).ceil().max(1.0) as u32
    }

    /// The longest substep in which the edges, swept, are as stiff as the material says, within about 5 % in sag and frequency \[s\]. Infinite without edges.
    ///
    /// With K = δt²·D/α, rods bend truly from K ≤ ⅔ on for the stiffest edge in bending, and a body of facets deforms truly if K ≤ 1 holds for the stretch, and for the bend and twist, of nine edges in ten. Retardation τ counts as
    /// a stiffness 1 + τ/δt times as great. In one twice as long the answer is stable and means nothing.
    pub fn longest_substep(&self, particles: &Particles) -> f32 {
        let bend = self.bend_compliance.iter();
        // What δt² is to be smaller than, as 1/s².
        let stiffest = if self.contact.is_empty() {
            let inverse: Vec<f32> = particles.inertia.iter().map(|i| 1.0 / i).collect();
            weights(&inverse, &self.pairs).zip(bend).map(|(w, c)| 1.5 * w / c.y.min(c.z)).max_by(f32::total_cmp)
        } else {
            let stretch = weights(&particles.inverse_mass, &self.pairs).zip(&self.stretch_compliance).map(|(w, c)| w / c.x);
            let bend = weights(&particles.inverse_inertia, &self.pairs).zip(bend).map(|(w, c)| w / c.min_element());
            ninth_tenth(stretch).zip(ninth_tenth(bend)).map(|(stretch, bend)| stretch.max(bend))
        };
        let Some(stiffest) = stiffest.filter(|s| *s > 0.0) else { return f32::INFINITY };
        // δt² + τ·δt = 1/stiffest, without cancellation.
        let target = 1.0 / stiffest;
        let tau = self.lag(1.0);
        2.0 * target / (tau + (tau * tau + 4.0 * target).sqrt())
    }

    /// τ·`rate`, or 0.
    pub(crate) fn lag(&self, rate: f32) -> f32 {
        if self.retardation > 0.0 { self.retardation.min(1e6) * rate } else { 0.0 }
    }
}

/// w_i + w_j of each edge.
pub(crate) fn weights(of: &[f32], pairs: &[[u32; 2]]) -> impl Iterator<Item = f32> {
    pairs.iter().map(|&[i, j]| of[i as usize] + of[j as usize])
}

/// The value that nine in ten do not exceed.
pub(crate) fn ninth_tenth(values: impl Iterator<Item = f32>) -> Option<f32> {
    let mut values: Vec<f32> = values.collect();
    values.sort_by(f32::total_cmp);
    (values.len() * 9).div_ceil(10).checked_sub(1).map(|at| values[at])
}

/// Solves every edge once, in a substep of `dt` \[s\].
///
/// The edge is a group of two whose rotation is the mean of its ends': R = mat(normalise(q_i + q_j)·F), with the sign of q_j for which they are turned against each other by less than half a turn or,
/// where they are bent far and it takes less energy, by more: else R would jump, and energy with it, where an edge is folded. With the contact points' gap
/// g = (x_j + q_j·s_j) − (x_i + q_i·s_i) and p = q_j·q_i⁻¹ its strains are
///
/// ```text
/// γ = Rᵀg − g_rest,   φ = Rᵀ·4·vec(p)/(1 + p_w)
/// ```
///
/// Each of the six rows C has its compliance α and λ = −C/max(α/δt² + ½D, D), with
///
/// ```text
/// D_k = w_i + w_j + (1/I_i)·|a_i × R·e_k|² + (1/I_j)·|a_j × R·e_k|²,   D_φ = s²·(1/I_i + 1/I_j),   s = 1 + |φ|²/16
/// ```
///
/// and a_i = q_i·s_i + ½g, a_j = q_j·s_j − ½g, the arms of the middle between the contact points, where the force f = R·λ_γ acts. Differentiated, half turns and all (R turns by
/// ½(θ_i + θ_j) + ⅛Φ×(θ_i − θ_j) with Φ = R·φ, and φ grows by s·Rᵀ(θ_j − θ_i)), the strains give ±f and the moments ±(a×f + s·R·λ_φ + ⅛Φ×(f×g)): they carry neither linear nor angular momentum, and
/// all come from one energy however far an edge is bent.
///
/// In a [`RestPose`](crate::RestPose) the ends' rotations since that pose take the place of q in R and p.
///
/// The ½D: a cold Gauss–Seidel sweep adds that much compliance on the average, and taking it off makes the answer independent of δt. With a retardation τ, C + τ·dC/dt takes the place of C and
/// (1 + τ/δt)·D that of D, for the same reason. Stable at every δt; see [`CalibratedEdges::recommended_substeps`] for what it is worth there.
pub fn solve_calibrated_edges(edges: &CalibratedEdges, particles: &mut Particles, dt: f32) {
    let rate = 1.0 / dt;
    let rate2 = rate * rate;
    let lag = edges.lag(rate);
    for (e, &[i, j]) in edges.pairs.iter().enumerate() {
        let (i, j) = (i as usize, j as usize);
        let (wi, wj) = (particles.inverse_mass[i], particles.inverse_mass[j]);
        let (ui, uj) = (particles.inverse_inertia[i], particles.inverse_inertia[j]);
        let (qi, qj) = (particles.rotation[i], particles.rotation[j]);
        let mut gap = particles.position[j] - particles.position[i];
        let (mut arm_i, mut arm_j) = (Vec3A::ZERO, Vec3A::ZERO);
        if let Some(&[si, sj]) = edges.contact.get(e) {
            (arm_i, arm_j) = (qi * si, qj * sj);
            gap += arm_j - arm_i;
        }
        arm_i += gap * 0.5;
        arm_j -= gap * 0.5;
        let (qi, qj) = match edges.rest_turn.get(e) {
            Some(&[back_i, back_j]) => (qi * back_i, qj * back_j),
            None => (qi, qj),
        };
        let strains = |qj: Quat| {
            let r = Mat3A::from_quat((qi + qj).normalize() * edges.frame[e]);
            let p = qj * qi.inverse();
            let bend = Vec3A::new(p.x, p.y, p.z) * (4.0 / (1.0 + p.w));
            (r, r.transpose() * gap - edges.rest_gap[e], bend, r.transpose() * bend)
        };
        let near = qi.dot(qj);
        let (mut r, mut gamma, mut bend, mut phi) = strains(if near < 0.0 { -qj } else { qj });
        if near.abs() < BENT as f32 {
            let long = strains(if near < 0.0 { qj } else { -qj });
            let energy = |gamma: Vec3A, phi: Vec3A| {
                (gamma * gamma).dot(edges.stretch_compliance[e].recip()) + (phi * phi).dot(edges.bend_compliance[e].recip())
            };
            if energy(long.1, long.3) < energy(gamma, phi) {
                (r, gamma, bend, phi) = long;
            }
        }
        let back = r.transpose();
        let steep = 1.0 + bend.length_squared() * (1.0 / 16.0);
        if lag > 0.0 {
            let (turn_i, turn_j) = (particles.angular_velocity[i], particles.angular_velocity[j]);
            let parting = particles.velocity[j] + turn_j.cross(arm_j) - particles.velocity[i] - turn_i.cross(arm_i);
            gamma += back * parting * (lag * dt);
            phi += back * (turn_j - turn_i) * (steep * lag * dt);
        }

        let across = |arm: Vec3A| {
            let a = back * arm;
            Vec3A::splat(a.length_squared()) - a * a
        };
        let weight = (Vec3A::splat(wi + wj) + across(arm_i) * ui + across(arm_j) * uj) * (1.0 + lag);
        let force = r * -over(gamma, (edges.stretch_compliance[e] * rate2 + weight * 0.5).max(weight));
        let weight = Vec3A::splat(steep * steep * (ui + uj) * (1.0 + lag));
        let moment =
            r * over(phi, (edges.bend_compliance[e] * rate2 + weight * 0.5).max(weight)) * -steep + bend.cross(force.cross(gap)) * 0.125;

        for (k, sign, arm, w, u) in [(i, -1.0, arm_i, wi, ui), (j, 1.0, arm_j, wj, uj)] {
            if w > 0.0 {
                particles.displace(k, force * (sign * w), rate);
            } else if let Some(reaction) = particles.reaction.get_mut(k) {
                *reaction += force * (sign * rate);
            }
            if u > 0.0 {
                particles.turn(k, (arm.cross(force) + moment) * (sign * u), rate);
            }
        }
    }
}

/// a/b, zero where b is not positive.
#[inline]
fn over(a: Vec3A, b: Vec3A) -> Vec3A {
    Vec3A::select(b.cmpgt(Vec3A::ZERO), a / b, Vec3A::ZERO)
}
