//! Distance constraints: edges keep their length.

use fearless_simd::Level;
use fearless_simd::prelude::*;

use crate::lanes::{LANES, Lanes, Rows, bits, filled, in_lanes};
use crate::{Edges, Particles, Share, Shares, Sweep};

/// Moves the ends of every edge towards its rest length, by the share of `tension` if it is too long and of `compression` if it is too short.
///
/// C = |d| − l with d = x_j − x_i has the gradient ∓d/|d|, so Δx_i = w_i/(w_i + w_j)·δ·d/|d| and Δx_j the opposite, weighted by the masses, with δ from C, its change n·(v_j − v_i)·Δt and the
/// multiplier as [`Share`](crate::Share) says: linear and, because both lie on one line, angular momentum are kept. An edge of zero length has no direction and is left alone, and so is one with both ends
/// pinned.
///
/// Edges are solved batch after batch, those of a batch side by side in vector lanes. Damping, several sweeps, edges that rest and a list of who pulls at pins take the scalar path.
pub fn solve_distances(edges: &mut Edges, particles: &mut Particles, tension: Shares, compression: Shares, sweep: Sweep) {
    if tension.are_off() && compression.are_off() {
        return;
    }
    sweep.ready(&mut edges.stretch, edges.pairs.len());
    particles.ready_rigid_push(tension);
    particles.ready_rigid_push(compression);
    match (tension, compression) {
        (Shares::One(t), Shares::One(c))
            if t.damping.max(c.damping) <= 0.0 && edges.stretch.is_empty() && edges.held.is_empty() && particles.reaction.is_empty() =>
        {
            stretch_in_lanes(Level::new(), edges, particles, [t, c], sweep);
        }
        _ => {
            for e in 0..edges.pairs.len() {
                stretch_edge(edges, particles, e, tension, compression, sweep);
            }
        }
    }
}

/// Solves edge `e` alone.
fn stretch_edge(edges: &mut Edges, particles: &mut Particles, e: usize, tension: Shares, compression: Shares, sweep: Sweep) {
    let rate = 1.0 / sweep.dt;
    let x = &mut particles.position;
    let v = &mut particles.velocity;
    let w = &particles.inverse_mass;
    let [i, j] = edges.pairs[e].map(|i| i as usize);
    let d = x[j] - x[i];
    let length = d.length();
    let weight = w[i] + w[j];
    if !(length > 0.0 && weight > 0.0) || edges.held.get(e).is_some_and(|&held| held) {
        return;
    }
    let error = length - edges.rest_length[e];
    let share = if error > 0.0 { tension.of(edges.input[e] as usize) } else { compression.of(edges.input[e] as usize) };
    let mut way = share.stiffness * error;
    if share.damping > 0.0 {
        way += share.damping * sweep.dt * d.dot(v[j] - v[i]) / length;
    }
    if let Some(multiplier) = edges.stretch.get_mut(e) {
        way -= share.memory * *multiplier;
        *multiplier += way;
    }
    let correction = d * (way / (length * weight));
    let (way_i, way_j) = (correction * w[i], correction * -w[j]);
    x[i] += way_i;
    x[j] += way_j;
    v[i] += way_i * rate;
    v[j] += way_j * rate;
    if share.is_rigid() {
        particles.rigid_push[i][0] += way_i * rate;
        particles.rigid_push[j][0] += way_j * rate;
    }
    if !particles.reaction.is_empty() {
        let impulse = correction * rate;
        if w[i] == 0.0 {
            particles.reaction[i] += impulse;
        }
        if w[j] == 0.0 {
            particles.reaction[j] -= impulse;
        }
    }
}

/// Solves all edges batch after batch, with the instructions of `level`, which do not change the result if the sweep is deterministic.
fn stretch_in_lanes(level: Level, edges: &Edges, particles: &mut Particles, shares: [Share; 2], sweep: Sweep) {
    in_lanes!(level, sweep.deterministic, lanes => stretch_batches(lanes, edges, particles, shares, sweep));
}

#[inline(always)]
fn stretch_batches<S: Simd, const FUSED: bool>(lanes: Lanes<S, FUSED>, edges: &Edges, p: &mut Particles, [t, c]: [Share; 2], sweep: Sweep) {
    let rate = 1.0 / sweep.dt;
    let rigid = t.is_rigid() || c.is_rigid();
    let zero = lanes.splat(0.0);
    let mut ways = [Rows::default(); 2];
    for b in 0..edges.batches.len().saturating_sub(1) {
        let (batch, [i, j]) = edges.batch(b);
        let x = &mut p.position[..];
        let v = &mut p.velocity[..x.len()];
        let rest = lanes.load(&filled(&edges.rest_length[batch.clone()]));
        let d = lanes.gather(x, &j) - lanes.gather(x, &i);
        let (wi, wj) = (lanes.gather_numbers(&p.inverse_mass, &i), lanes.gather_numbers(&p.inverse_mass, &j));
        let length = lanes.length_squared(d).sqrt();
        let weight = length * (wi + wj);
        let error = length - rest;
        let stretched = error.simd_gt(0.0);
        let share = stretched.select(lanes.splat(t.stiffness), lanes.splat(c.stiffness));
        let correction = d * weight.simd_gt(0.0).select(share * error / weight, zero);
        ways[0].store((correction * wi).columns());
        ways[1].store((correction * -wj).columns());
        let live = ((1u32 << batch.len()) - 1) as u8;
        let mut pull = |l: usize| {
            for (k, i) in [i[l] as usize, j[l] as usize].into_iter().enumerate() {
                let way = ways[k].vector(l);
                x[i] += way;
                v[i] += way * rate;
            }
        };
        if live == u8::MAX {
            for l in 0..LANES {
                pull(l);
            }
        } else {
            bits(live).for_each(pull);
        }
        if rigid {
            let stretched = stretched.to_bitmask() as u8;
            let of = |share: Share, lanes: u8| if share.is_rigid() { lanes } else { 0 };
            for l in bits(live & (of(t, stretched) | of(c, !stretched))) {
                for (k, i) in [i[l] as usize, j[l] as usize].into_iter().enumerate() {
                    p.rigid_push[i][0] += ways[k].vector(l) * rate;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{assert_close, blob, line, same_at_every_level, scramble, stir};
    use crate::{ParticleRest, Stiffness, momentum};
    use glam::{Quat, Vec3A};

    fn solve(edges: &Edges, particles: &mut Particles, fraction: f32) {
        let share = Stiffness::Fraction(fraction).share(0.01);
        solve_distances(&mut edges.clone(), particles, share.into(), share.into(), Sweep::only(0.01));
    }

    #[test]
    fn a_rigid_edge_regains_its_length_in_one_go() {
        let mut p = line(2, 1.0, 0.1);
        let edges = Edges::new(&p, &[[0, 1]]).unwrap();
        p.position[1] = Vec3A::new(3.0, 4.0, 0.0);
        solve(&edges, &mut p, 1.0);
        assert!((p.position[1].distance(p.position[0]) - 1.0).abs() < 1e-6);
    }

    /// Eight edges side by side come out as one by one, but for rounding; with every instruction set the same bits, where that was asked for.
    #[test]
    fn lanes_do_what_one_edge_does() {
        for (tension, compression) in [(0.3, 0.7), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
            let (mut p, pairs) = blob();
            let mut edges = Edges::new(&p, &pairs).unwrap();
            stir(&mut p, 5, 0.3);
            p.pin(3, true, true);
            p.position[5] = p.position[6];
            let [t, c] = [tension, compression].map(|s| Stiffness::Fraction(s).share(0.01));
            let (mut lanes, mut alone) = (p.clone(), p.clone());
            solve_distances(&mut edges, &mut lanes, t.into(), c.into(), Sweep::only(0.01));
            alone.ready_rigid_push(t.into());
            alone.ready_rigid_push(c.into());
            for e in 0..edges.pairs.len() {
                stretch_edge(&mut edges, &mut alone, e, t.into(), c.into(), Sweep::only(0.01));
            }
            assert_close(&lanes, &alone, 2e-5);
            same_at_every_level(&p, |p, level| {
                p.ready_rigid_push(t.into());
                p.ready_rigid_push(c.into());
                stretch_in_lanes(level, &edges, p, [t, c], Sweep { deterministic: true, ..Sweep::only(0.01) });
            });
        }
    }

    #[test]
    fn linear_and_angular_momentum_are_kept_at_unequal_masses() {
        let rest: Vec<ParticleRest> = (0..6)
            .map(|i| ParticleRest {
                position: Vec3A::new(i as f32, (i * i % 3) as f32, 0.3 * i as f32),
                frame: Quat::IDENTITY,
                radii: Vec3A::splat(0.2),
                mass: 1.0 + i as f32 * 10.0,
            })
            .collect();
        let mut p = Particles::new(&rest).unwrap();
        let edges = Edges::new(&p, &[[0, 1], [1, 2], [2, 3], [3, 4], [4, 5], [0, 5]]).unwrap();
        scramble(&mut p, 7);
        let before = p.clone();
        solve(&edges, &mut p, 0.7);
        // The displacement, read as a velocity about the positions before it, carries no momentum; a sequence of
        // corrections does so about the position at which each was made, so only the linear part is exact.
        for i in 0..p.len() {
            p.velocity[i] = p.position[i] - before.position[i];
            p.angular_velocity[i] = Vec3A::ZERO;
        }
        assert!(momentum(&p).linear.length() < 1e-4);
        let single = Edges::new(&before, &[[1, 4]]).unwrap();
        let mut q = before.clone();
        solve(&single, &mut q, 0.7);
        for i in 0..q.len() {
            q.velocity[i] = q.position[i] - before.position[i];
            q.angular_velocity[i] = Vec3A::ZERO;
            q.position[i] = before.position[i];
        }
        assert!(momentum(&q).angular.length() < 1e-4);
    }

    #[test]
    fn coincident_ends_stay_finite() {
        let mut p = line(2, 1.0, 0.1);
        let edges = Edges::new(&p, &[[0, 1]]).unwrap();
        p.position[1] = p.position[0];
        solve(&edges, &mut p, 1.0);
        assert!(p.is_finite());
    }
}
