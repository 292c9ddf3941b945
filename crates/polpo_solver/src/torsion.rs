//! Torsion: edges resist the twist between their ends' orientations.

use crate::{Edges, Particles, quat_exp, quat_log};

/// Turns the two ends of every edge towards each other, by the share `fraction` (0 … 1, see [`stiffness_fraction`](crate::stiffness_fraction)) of the twist about the edge between them.
///
/// With θ = log(q_j·q_i⁻¹) the relative rotation and e the edge's direction, the twist is (θ·e)·e. Ends turn by Δθ_i = +s·w_i/(w_i + w_j)·twist and Δθ_j the opposite, w the inverse spin
/// inertias, both from the same relative rotation: I_i·Δθ_i + I_j·Δθ_j = 0, so spin is conserved. (Two slerps one after the other, where the second sees the first's result, are not: they
/// create 15° of net spin out of a 60° difference.) Bending is the groups' business and is left alone. An edge of zero length has no axis and is skipped.
pub fn solve_torsion(edges: &Edges, particles: &mut Particles, fraction: f32) {
    let x = &particles.position;
    let q = &mut particles.rotation;
    let w = &particles.inverse_inertia;
    for &[i, j] in &edges.pairs {
        let (i, j) = (i as usize, j as usize);
        let d = x[j] - x[i];
        let length2 = d.length_squared();
        if length2 > 0.0 {
            let theta = quat_log(q[j] * q[i].inverse());
            let twist = d * (theta.dot(d) * fraction / (length2 * (w[i] + w[j])));
            q[i] = (quat_exp(twist * w[i]) * q[i]).normalize();
            q[j] = (quat_exp(-twist * w[j]) * q[j]).normalize();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ParticleRest;
    use crate::testing::line;
    use glam::{Quat, Vec3A};

    #[test]
    fn a_rigid_edge_loses_its_twist_and_keeps_its_bend() {
        let mut p = line(2, 1.0, 0.1);
        let edges = Edges::new(&p, &[[0, 1]]).unwrap();
        p.rotation[1] = quat_exp(Vec3A::X * 1.0);
        solve_torsion(&edges, &mut p, 1.0);
        assert!(quat_log(p.rotation[1] * p.rotation[0].inverse()).length() < 1e-6);
        p.rotation = vec![Quat::IDENTITY, quat_exp(Vec3A::Z * 1.0)];
        solve_torsion(&edges, &mut p, 1.0);
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
        solve_torsion(&edges, &mut p, 0.8);
        let spin = |i: usize| quat_log(p.rotation[i] * before[i].inverse()) / p.inverse_inertia[i];
        assert!(spin(1).length() > 1e-4);
        assert!((spin(0) + spin(1)).length() < 1e-6 * spin(1).length() + 1e-7);
    }
}
