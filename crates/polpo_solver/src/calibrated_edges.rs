//! Calibrated edges: stretch, shear, bend and twist from a material, without tuning.

use fearless_simd::prelude::*;
use fearless_simd::{Level, f32x8};
use glam::{Mat3A, Quat, Vec3A};

use crate::edge_strain::BENT;
use crate::lanes::{LANES, Lanes, Quatx8, Rows, SMALL, Vec3x8, bits, ends, in_lanes};
use crate::particles::Moving;
use crate::{Particles, Sweep};

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
    /// Where each batch of up to eight edges that share no particle starts in `pairs`, and the end of the last; none: edges made by hand are solved one by one.
    pub(crate) batches: Vec<u32>,
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
            let stretch = weights(&particles.inverse_mass, &self.pairs).zip(&self.stretch_compliance).map(|(w, c)| w / c.min_element());
            let bend = weights(&particles.inverse_inertia, &self.pairs).zip(bend).map(|(w, c)| w / c.min_element());
            ninth_tenth(stretch).zip(ninth_tenth(bend)).map(|(stretch, bend)| stretch.max(bend))
        };
        let Some(stiffest) = stiffest.filter(|s| *s > 0.0) else { return f32::INFINITY };
        // δt² + τ·δt = 1/stiffest, without cancellation.
        let target = 1.0 / stiffest;
        let tau = self.lag(1.0);
        2.0 * target / (tau + (tau * tau + 4.0 * target).sqrt())
    }

    /// By how much more than their material says the edges give, swept in substeps of `dt` \[s\]: a sweep makes an edge no stiffer than K = 2, so the mean over all edges of max(1, ½K) − 1, of stretch or of bend and twist, whichever is more.
    /// About 0 at [`longest_substep`](Self::longest_substep); 0.3 means that the body stretches or sags by about a third too much. What it says of half the substeps and fewer is a lower bound.
    pub fn softness(&self, particles: &Particles, dt: f32) -> f32 {
        let lag = 1.0 + self.lag(1.0 / dt);
        let mean = |of: &mut dyn Iterator<Item = f32>| {
            let (mut sum, mut count) = (0.0, 0.0);
            for stiffness in of {
                sum += (0.5 * dt * dt * lag * stiffness).max(1.0) - 1.0;
                count += 1.0;
            }
            sum / f32::max(count, 1.0)
        };
        let stretch = weights(&particles.inverse_mass, &self.pairs).zip(&self.stretch_compliance).map(|(w, c)| w / c.min_element());
        let bend = weights(&particles.inverse_inertia, &self.pairs).zip(&self.bend_compliance).map(|(w, c)| w / c.min_element());
        mean(&mut stretch.into_iter()).max(mean(&mut bend.into_iter()))
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

/// Solves every edge once, in the substep of `sweep`.
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
///
/// Edges are solved batch after batch, those of a batch side by side in vector lanes. Retardation, rest poses, edges bent by more than 50° and a list of who pulls at pins take the scalar path.
pub fn solve_calibrated_edges(edges: &CalibratedEdges, particles: &mut Particles, sweep: Sweep) {
    let count = edges.pairs.len();
    let plain = edges.lag(1.0) <= 0.0 && edges.rest_turn.is_empty() && particles.reaction.is_empty();
    if plain && edges.batches.last().is_some_and(|&end| end as usize == count) {
        strain_in_lanes(Level::new(), edges, particles, sweep);
    } else {
        for e in 0..count {
            strain_edge(edges, particles, e, sweep.dt);
        }
    }
}

/// Solves edge `e` alone.
fn strain_edge(edges: &CalibratedEdges, particles: &mut Particles, e: usize, dt: f32) {
    let rate = 1.0 / dt;
    let rate2 = rate * rate;
    let lag = edges.lag(rate);
    let [i, j] = edges.pairs[e].map(|i| i as usize);
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

/// a/b, zero where b is not positive.
#[inline]
fn over(a: Vec3A, b: Vec3A) -> Vec3A {
    Vec3A::select(b.cmpgt(Vec3A::ZERO), a / b, Vec3A::ZERO)
}

/// Solves all edges batch after batch, with the instructions of `level`, which do not change the result if the sweep is deterministic.
fn strain_in_lanes(level: Level, edges: &CalibratedEdges, particles: &mut Particles, sweep: Sweep) {
    in_lanes!(level, sweep.deterministic, lanes => strain_batches(lanes, edges, particles, sweep.dt));
}

#[inline(always)]
fn strain_batches<S: Simd, const FUSED: bool>(lanes: Lanes<S, FUSED>, edges: &CalibratedEdges, p: &mut Particles, dt: f32) {
    let rate = 1.0 / dt;
    let rate2 = lanes.splat(rate * rate);
    let (zero, half, one) = (lanes.splat(0.0), lanes.splat(0.5), lanes.splat(1.0));
    let mut rows = [Rows::default(); 6];
    for starts in edges.batches.windows(2) {
        let batch = starts[0] as usize..starts[1] as usize;
        let pairs = &edges.pairs[batch.clone()];
        let [i, j] = ends(pairs);
        let (wi, wj) = (lanes.gather_numbers(&p.inverse_mass, &i), lanes.gather_numbers(&p.inverse_mass, &j));
        let (ui, uj) = (lanes.gather_numbers(&p.inverse_inertia, &i), lanes.gather_numbers(&p.inverse_inertia, &j));
        let (qi, qj) = (lanes.gather_quats(&p.rotation, &i), lanes.gather_quats(&p.rotation, &j));
        let mut gap = lanes.gather(&p.position, &j) - lanes.gather(&p.position, &i);
        let (mut arm_i, mut arm_j) = (lanes.zero(), lanes.zero());
        // A lane without an edge repeats the first.
        let row = |l: usize| batch.start + if l < pairs.len() { l } else { 0 };
        if !edges.contact.is_empty() {
            arm_i = lanes.transform_add(lanes.matrix(qi), lanes.vectors(|l| edges.contact[row(l)][0]), arm_i);
            arm_j = lanes.transform_add(lanes.matrix(qj), lanes.vectors(|l| edges.contact[row(l)][1]), arm_j);
            gap = gap + arm_j - arm_i;
        }
        arm_i = lanes.scale_add(gap, half, arm_i);
        arm_j = lanes.scale_add(gap, -half, arm_j);
        let near = lanes.mul_add(qi.w, qj.w, lanes.dot(qi.vector(), qj.vector()));
        let sign = near.simd_lt(zero).select(-one, one);
        let far_j = Quatx8 { x: qj.x * sign, y: qj.y * sign, z: qj.z * sign, w: qj.w * sign };
        let middle = Quatx8 { x: qi.x + far_j.x, y: qi.y + far_j.y, z: qi.z + far_j.z, w: qi.w + far_j.w };
        let r = lanes.matrix(lanes.product(lanes.normalize(middle), lanes.quats(|l| edges.frame[row(l)])));
        let turn = lanes.quotient(far_j, qi);
        let bend = turn.vector() * (lanes.splat(4.0) / (one + turn.w));

        let (gamma, phi) = (lanes.transpose_times(r, gap) - lanes.vectors(|l| edges.rest_gap[row(l)]), lanes.transpose_times(r, bend));
        let steep = lanes.mul_add(lanes.length_squared(bend), lanes.splat(1.0 / 16.0), one);

        let both = wi + wj;
        let weight = across(lanes, lanes.transpose_times(r, arm_i), ui, Vec3x8 { x: both, y: both, z: both });
        let weight = across(lanes, lanes.transpose_times(r, arm_j), uj, weight);
        let give = lanes.vectors(|l| edges.stretch_compliance[row(l)]);
        let pull = yielding(lanes, gamma, give * rate2, weight);
        let force = lanes.transform_add(r, pull * -one, lanes.zero());
        let give = lanes.vectors(|l| edges.bend_compliance[row(l)]);
        let weight = steep * steep * (ui + uj);
        let wring = yielding(lanes, phi, give * rate2, Vec3x8 { x: weight, y: weight, z: weight });
        let moment = lanes.cross(bend, lanes.cross(force, gap)) * lanes.splat(0.125);
        let moment = lanes.transform_add(r, wring * -steep, moment);

        let mut small = near.abs().simd_ge(BENT as f32);
        for (k, (arm, q, w, u, sign)) in [(arm_i, qi, wi, ui, -one), (arm_j, qj, wj, uj, one)].into_iter().enumerate() {
            let angle = (lanes.cross(arm, force) + moment) * (sign * u);
            let half_angle = angle * half;
            small &= lanes.length_squared(half_angle).simd_lt(SMALL);
            rows[3 * k].store((force * (sign * w)).columns());
            rows[3 * k + 1].store(angle.columns());
            rows[3 * k + 2].store(lanes.product(lanes.half_exp(half_angle), q).columns());
        }
        let live = ((1u32 << pairs.len()) - 1) as u8;
        let small = live & small.to_bitmask() as u8;
        let mut state = Moving::of(p);
        if small == u8::MAX {
            for l in 0..LANES {
                displace_ends(&mut state, [i[l], j[l]], &rows, l, rate);
            }
        } else {
            for l in bits(small) {
                displace_ends(&mut state, [i[l], j[l]], &rows, l, rate);
            }
        }
        let far = live & !small;
        if far != 0 {
            for l in bits(far) {
                strain_edge(edges, p, batch.start + l, dt);
            }
        }
    }
}

/// `sum` and u·|a × e_k|² for each of the three axes.
#[inline(always)]
fn across<S: Simd, const FUSED: bool>(lanes: Lanes<S, FUSED>, a: Vec3x8<S>, u: f32x8<S>, sum: Vec3x8<S>) -> Vec3x8<S> {
    let all = lanes.length_squared(a);
    Vec3x8 {
        x: lanes.mul_add(lanes.sub_mul(all, a.x, a.x), u, sum.x),
        y: lanes.mul_add(lanes.sub_mul(all, a.y, a.y), u, sum.y),
        z: lanes.mul_add(lanes.sub_mul(all, a.z, a.z), u, sum.z),
    }
}

/// C/max(α/δt² + ½D, D) for each of the three rows, zero where that is not positive.
#[inline(always)]
fn yielding<S: Simd, const FUSED: bool>(lanes: Lanes<S, FUSED>, error: Vec3x8<S>, give: Vec3x8<S>, weight: Vec3x8<S>) -> Vec3x8<S> {
    Vec3x8 {
        x: yielding_row(lanes, error.x, give.x, weight.x),
        y: yielding_row(lanes, error.y, give.y, weight.y),
        z: yielding_row(lanes, error.z, give.z, weight.z),
    }
}

#[inline(always)]
fn yielding_row<S: Simd, const FUSED: bool>(lanes: Lanes<S, FUSED>, error: f32x8<S>, give: f32x8<S>, weight: f32x8<S>) -> f32x8<S> {
    let soft = lanes.mul_add(weight, lanes.splat(0.5), give);
    let by = soft.simd_gt(weight).select(soft, weight);
    let zero = lanes.splat(0.0);
    by.simd_gt(zero).select(error / by, zero)
}

/// Moves and turns the ends of the edge in lane `l` by `rows`: way, angle and new rotation of either.
#[inline(always)]
fn displace_ends(state: &mut Moving, ends: [u32; 2], rows: &[Rows; 6], l: usize, rate: f32) {
    for (k, i) in ends.into_iter().enumerate() {
        state.displace(i as usize, rows[3 * k].vector(l), rows[3 * k + 1].vector(l), rows[3 * k + 2].quat(l), rate);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{assert_close, blob, same_at_every_level, stir};
    use crate::{Edges, Material, Section};

    /// Eight edges side by side come out as one by one, but for rounding; with every instruction set the same bits, where that was asked for. Rods, and edges with contact points; some folded, some pinned.
    #[test]
    fn lanes_do_what_one_edge_does() {
        let material = Material { youngs_modulus: 1e9, poissons_ratio: 0.3, density: 1000.0 };
        let (mut rods, pairs) = blob();
        let edges = Edges::new(&rods, &pairs).unwrap();
        let bars = CalibratedEdges::rods(&mut rods, &edges, &material, &Section::circle(0.02), Some(0.05), &[]).unwrap();
        let mut contacts = bars.clone();
        let half = |e: usize, k: usize| rods.rest_position[bars.pairs[e][1 - k] as usize] - rods.rest_position[bars.pairs[e][k] as usize];
        contacts.contact =
            (0..bars.pairs.len()).map(|e| [half(e, 0) * 0.5 + Vec3A::X * 0.01, half(e, 1) * 0.5 + Vec3A::Y * 0.01]).collect();
        for edges in [bars.clone(), contacts] {
            for size in [1e-3, 0.1, 0.4, 0.7] {
                let mut p = rods.clone();
                stir(&mut p, 11, size);
                p.pin(3, true, true);
                p.pin(8, true, false);
                let (mut lanes, mut alone) = (p.clone(), p.clone());
                solve_calibrated_edges(&edges, &mut lanes, Sweep::only(0.002));
                for e in 0..edges.pairs.len() {
                    strain_edge(&edges, &mut alone, e, 0.002);
                }
                assert_ne!(alone, p);
                assert_close(&lanes, &alone, if size > 0.5 { 2e-3 } else { 2e-5 });
                same_at_every_level(&p, |p, level| {
                    strain_in_lanes(level, &edges, p, Sweep { deterministic: true, ..Sweep::only(0.002) });
                });
            }
        }
    }
}
