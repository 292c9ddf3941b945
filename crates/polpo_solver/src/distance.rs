//! Distance constraints: edges keep their length.

use crate::{Edges, Particles};

/// In a substep of `dt` \[s\], moves the ends of every edge by the share `fraction` (0 … 1, see [`stiffness_fraction`](crate::stiffness_fraction)) of the way to its rest length.
///
/// C = |d| − l with d = x_j − x_i has the gradient ∓d/|d|, so Δx_i = s·w_i/(w_i + w_j)·C·d/|d| and Δx_j the opposite, weighted by the masses: linear and, because both lie on one line,
/// angular momentum are kept. An edge of zero length has no direction and is left alone.
pub fn solve_distances(edges: &Edges, particles: &mut Particles, fraction: f32, dt: f32) {
    let rate = 1.0 / dt;
    let x = &mut particles.position;
    let v = &mut particles.velocity;
    let w = &particles.inverse_mass;
    for (&[i, j], &rest) in edges.pairs.iter().zip(&edges.rest_length) {
        let (i, j) = (i as usize, j as usize);
        let d = x[j] - x[i];
        let length = d.length();
        if length > 0.0 {
            let correction = d * (fraction * (length - rest) / (length * (w[i] + w[j])));
            let (way_i, way_j) = (correction * w[i], correction * -w[j]);
            x[i] += way_i;
            x[j] += way_j;
            v[i] += way_i * rate;
            v[j] += way_j * rate;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{line, scramble};
    use crate::{ParticleRest, momentum};
    use glam::{Quat, Vec3A};

    #[test]
    fn a_rigid_edge_regains_its_length_in_one_go() {
        let mut p = line(2, 1.0, 0.1);
        let edges = Edges::new(&p, &[[0, 1]]).unwrap();
        p.position[1] = Vec3A::new(3.0, 4.0, 0.0);
        solve_distances(&edges, &mut p, 1.0, 0.01);
        assert!((p.position[1].distance(p.position[0]) - 1.0).abs() < 1e-6);
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
        solve_distances(&edges, &mut p, 0.7, 0.01);
        // The displacement, read as a velocity about the positions before it, carries no momentum; a sequence of
        // corrections does so about the position at which each was made, so only the linear part is exact.
        for i in 0..p.len() {
            p.velocity[i] = p.position[i] - before.position[i];
            p.angular_velocity[i] = Vec3A::ZERO;
        }
        assert!(momentum(&p).linear.length() < 1e-4);
        let single = Edges::new(&before, &[[1, 4]]).unwrap();
        let mut q = before.clone();
        solve_distances(&single, &mut q, 0.7, 0.01);
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
        solve_distances(&edges, &mut p, 1.0, 0.01);
        assert!(p.is_finite());
    }
}
