//! Torsion: edges resist the twist between their ends' orientations.

use fearless_simd::Level;
use fearless_simd::prelude::*;
use glam::{Quat, Vec3A};

use crate::lanes::{LANES, Lanes, Rows, SMALL, bits, in_lanes};
use crate::{Edges, Particles, Share, Shares, Sweep, quat_log};

/// Turns the two ends of every edge towards each other, by the share of the twist about the edge between them.
///
/// With θ = log(q_j·q_i⁻¹) the relative rotation (of rotations since the rest pose, if there is a [`RestPose`](crate::RestPose)) and e the edge's direction, the twist is θ·e. Ends turn by Δθ_i = +w_i/(w_i + w_j)·δ·e and Δθ_j the opposite, w the inverse spin inertias, both from
/// the same relative rotation, with δ from the twist, its change (ω_j − ω_i)·e·Δt and the multiplier as [`Share`](crate::Share) says: I_i·Δθ_i + I_j·Δθ_j = 0, so spin is conserved. (Two slerps one after
/// the other, where the second sees the first's result, are not: they create 15° of net spin out of a 60° difference.) Bending is the groups' business and is left alone. An edge of zero length has no
/// axis and is skipped, and so is one with both ends' orientations pinned.
///
/// Edges are solved batch after batch, those of a batch side by side in vector lanes. Damping, several sweeps, a rest pose, edges that rest and edges twisted far take the scalar path.
pub fn solve_torsion(edges: &mut Edges, particles: &mut Particles, shares: Shares, sweep: Sweep) {
    if shares.are_off() {
        return;
    }
    sweep.ready(&mut edges.twist, edges.pairs.len());
    particles.ready_rigid_push(shares);
    match shares {
        Shares::One(share) if share.damping <= 0.0 && edges.twist.is_empty() && edges.rest_turn.is_empty() && edges.held.is_empty() => {
            twist_in_lanes(Level::new(), edges, particles, share, sweep);
        }
        _ => {
            for e in 0..edges.pairs.len() {
                twist_edge(edges, particles, e, shares, sweep);
            }
        }
    }
}

/// Solves edge `e` alone.
fn twist_edge(edges: &mut Edges, particles: &mut Particles, e: usize, shares: Shares, sweep: Sweep) {
    let rate = 1.0 / sweep.dt;
    let [i, j] = edges.pairs[e].map(|i| i as usize);
    let d = particles.position[j] - particles.position[i];
    let length2 = d.length_squared();
    let (wi, wj) = (particles.inverse_inertia[i], particles.inverse_inertia[j]);
    if !(length2 > 0.0 && wi + wj > 0.0) || edges.held.get(e).is_some_and(|&held| held) {
        return;
    }
    let share = shares.of(edges.input[e] as usize);
    let q = &particles.rotation;
    let length = length2.sqrt();
    let relative = edges.rest_turn.get(e).map_or(q[j], |&rest| q[j] * rest) * q[i].inverse();
    let mut turn = share.stiffness * quat_log(relative).dot(d) / length;
    if share.damping > 0.0 {
        turn += share.damping * sweep.dt * d.dot(particles.angular_velocity[j] - particles.angular_velocity[i]) / length;
    }
    if let Some(multiplier) = edges.twist.get_mut(e) {
        turn -= share.memory * *multiplier;
        *multiplier += turn;
    }
    let twist = d * (turn / (length * (wi + wj)));
    particles.turn(i, twist * wi, rate);
    particles.turn(j, twist * -wj, rate);
    if share.is_rigid() {
        particles.rigid_push[i][1] += twist * (wi * rate);
        particles.rigid_push[j][1] -= twist * (wj * rate);
    }
}

/// Solves all edges batch after batch, with the instructions of `level`, which do not change the result if the sweep is deterministic.
fn twist_in_lanes(level: Level, edges: &mut Edges, particles: &mut Particles, share: Share, sweep: Sweep) {
    in_lanes!(level, sweep.deterministic, lanes => twist_batches(lanes, edges, particles, share, sweep));
}

/// With v the vector part of q_j·q_i⁻¹, the short way round, the twist is 2·asin(|v|)/|v|·(v·e), and the share of it that goes to i as a rotation vector needs no root: d·(2·asin(|v|)/|v|·(v·d)·s/(|d|²·(w_i + w_j)))·w_i.
#[inline(always)]
fn twist_batches<S: Simd, const FUSED: bool>(lanes: Lanes<S, FUSED>, edges: &mut Edges, p: &mut Particles, share: Share, sweep: Sweep) {
    let rate = 1.0 / sweep.dt;
    let zero = lanes.splat(0.0);
    for b in 0..edges.batches.len().saturating_sub(1) {
        let (batch, at) = edges.batch(b);
        let [i, j] = &at;
        let d = lanes.gather(&p.position, j) - lanes.gather(&p.position, i);
        let (rotation, spin) = (&mut p.rotation[..], &mut p.angular_velocity[..]);
        let spin = &mut spin[..rotation.len()];
        let q = [lanes.gather_quats(rotation, i), lanes.gather_quats(rotation, j)];
        let w = [lanes.gather_numbers(&p.inverse_inertia, i), lanes.gather_numbers(&p.inverse_inertia, j)];
        let off = lanes.quotient(q[1], q[0]);
        let v = off.vector();
        let s2 = lanes.length_squared(v);
        let weight = lanes.length_squared(d) * (w[0] + w[1]);
        let sound = weight.simd_gt(0.0);
        let near = s2.simd_lt(SMALL);
        let twist = lanes.half_log(s2) * lanes.dot(v, d) * lanes.splat(share.stiffness);
        let twist = off.w.simd_lt(zero).select(-twist, twist) / weight;
        let half = d * (sound & near).select(twist, zero);
        let mut angle = [Rows::default(); 2];
        let mut new = [Rows::default(); 2];
        for k in 0..2 {
            let half = half * if k == 0 { w[0] } else { -w[1] };
            angle[k].store((half + half).columns());
            new[k].store(lanes.product(lanes.half_exp(half), q[k]).columns());
        }
        let live = ((1u32 << batch.len()) - 1) as u8;
        let near = live & near.to_bitmask() as u8;
        if near == u8::MAX {
            for l in 0..LANES {
                turn([i[l], j[l]], &new, &angle, l, rate, rotation, spin);
            }
        } else {
            for l in bits(near) {
                turn([i[l], j[l]], &new, &angle, l, rate, rotation, spin);
            }
        }
        if share.is_rigid() {
            for l in bits(near) {
                p.rigid_push[i[l] as usize][1] += angle[0].vector(l) * rate;
                p.rigid_push[j[l] as usize][1] += angle[1].vector(l) * rate;
            }
        }
        let far = live & !near;
        if far != 0 {
            for l in bits(far) {
                twist_edge(edges, p, batch.start + l, share.into(), sweep);
            }
        }
    }
}

/// Turns the ends of the edge in lane `l`.
#[inline(always)]
fn turn(ends: [u32; 2], new: &[Rows; 2], angle: &[Rows; 2], l: usize, rate: f32, rotation: &mut [Quat], spin: &mut [Vec3A]) {
    for (k, i) in ends.into_iter().enumerate() {
        rotation[i as usize] = new[k].quat(l);
        spin[i as usize] += angle[k].vector(l) * rate;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{assert_close, blob, line, same_at_every_level, stir};
    use crate::{ParticleRest, Stiffness, quat_exp};

    fn solve(edges: &Edges, particles: &mut Particles, fraction: f32) {
        solve_torsion(&mut edges.clone(), particles, Stiffness::Fraction(fraction).share(0.01).into(), Sweep::only(0.01));
    }

    #[test]
    fn a_rigid_edge_loses_its_twist_and_keeps_its_bend() {
        let mut p = line(2, 1.0, 0.1);
        let edges = Edges::new(&p, &[[0, 1]]).unwrap();
        p.rotation[1] = quat_exp(Vec3A::X * 1.0);
        solve(&edges, &mut p, 1.0);
        assert!(quat_log(p.rotation[1] * p.rotation[0].inverse()).length() < 1e-6);
        p.rotation = vec![Quat::IDENTITY, quat_exp(Vec3A::Z * 1.0)];
        solve(&edges, &mut p, 1.0);
        assert!((quat_log(p.rotation[1]) - Vec3A::Z).length() < 1e-6);
    }

    /// Eight edges side by side come out as one by one, but for rounding; with every instruction set the same bits, where that was asked for.
    #[test]
    fn lanes_do_what_one_edge_does() {
        for (k, share) in [0.3, 1.0].into_iter().enumerate() {
            for size in [0.01, 0.5, 3.0] {
                let (mut p, pairs) = blob();
                let mut edges = Edges::new(&p, &pairs).unwrap();
                stir(&mut p, 7 + k as u64, size);
                p.pin(3, true, true);
                let share = Stiffness::Fraction(share).share(0.01);
                let (mut lanes, mut alone) = (p.clone(), p.clone());
                solve_torsion(&mut edges, &mut lanes, share.into(), Sweep::only(0.01));
                alone.ready_rigid_push(share.into());
                for e in 0..edges.pairs.len() {
                    twist_edge(&mut edges, &mut alone, e, share.into(), Sweep::only(0.01));
                }
                assert_close(&lanes, &alone, 2e-5);
                same_at_every_level(&p, |p, level| {
                    p.ready_rigid_push(share.into());
                    twist_in_lanes(level, &mut edges.clone(), p, share, Sweep { deterministic: true, ..Sweep::only(0.01) });
                });
            }
        }
    }

    #[test]
    fn spin_is_conserved_at_unequal_inertias() {
        let rest = [
            ParticleRest { position: Vec3A::ZERO, frame: Quat::IDENTITY, radii: Vec3A::splat(0.3), mass: 5.0 },
            ParticleRest { position: Vec3A::new(1.0, 2.0, 2.0), frame: Quat::IDENTITY, radii: Vec3A::splat(0.1), mass: 1.0 },
        ];
        let mut p = Particles::new(&rest).unwrap();
        let edges = Edges::new(&p, &[[0, 1]]).unwrap();
        p.rotation = vec![quat_exp(Vec3A::new(0.2, 0.1, -0.3)), quat_exp(Vec3A::new(-0.5, 0.4, 0.6))];
        let before = p.rotation.clone();
        solve(&edges, &mut p, 0.8);
        let spin = |i: usize| quat_log(p.rotation[i] * before[i].inverse()) / p.inverse_inertia[i];
        assert!(spin(1).length() > 1e-4);
        assert!((spin(0) + spin(1)).length() < 1e-6 * spin(1).length() + 1e-7);
    }
}
