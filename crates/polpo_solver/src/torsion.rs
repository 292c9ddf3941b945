//! Torsion: edges resist the twist between their ends' orientations.

use crate::{Edges, Particles, Shares, Sweep, quat_log};

/// Turns the two ends of every edge towards each other, by the share of the twist about the edge between them.
///
/// With θ = log(q_j·q_i⁻¹) the relative rotation (of rotations since the rest pose, if there is a [`RestPose`](crate::RestPose)) and e the edge's direction, the twist is θ·e. Ends turn by Δθ_i = +w_i/(w_i + w_j)·δ·e and Δθ_j the opposite, w the inverse spin inertias, both from
/// the same relative rotation, with δ from the twist, its change (ω_j − ω_i)·e·Δt and the multiplier as [`Share`](crate::Share) says: I_i·Δθ_i + I_j·Δθ_j = 0, so spin is conserved. (Two slerps one after
/// the other, where the second sees the first's result, are not: they create 15° of net spin out of a 60° difference.) Bending is the groups' business and is left alone. An edge of zero length has no
/// axis and is skipped, and so is one with both ends' orientations pinned.
pub fn solve_torsion(edges: &mut Edges, particles: &mut Particles, shares: Shares, sweep: Sweep) {
    if shares.are_off() {
        return;
    }
    let rate = 1.0 / sweep.dt;
    sweep.ready(&mut edges.twist, edges.pairs.len());
    particles.ready_rigid_push(shares);
    for (e, &[i, j]) in edges.pairs.iter().enumerate() {
        let (i, j) = (i as usize, j as usize);
        let d = particles.position[j] - particles.position[i];
        let length2 = d.length_squared();
        let (wi, wj) = (particles.inverse_inertia[i], particles.inverse_inertia[j]);
        if !(length2 > 0.0 && wi + wj > 0.0) || edges.held.get(e).is_some_and(|&held| held) {
            continue;
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
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::line;
    use crate::{ParticleRest, Stiffness, quat_exp};
    use glam::{Quat, Vec3A};

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
