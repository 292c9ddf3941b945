//! Shape matching: every group is drawn towards its rest shape, moved and turned to where it is now.

use glam::{Mat3A, Quat, Vec3A};

use crate::{ImplicitGroups, Particles, extract_rotation};

/// In a substep of `dt` \[s\], moves the members of every group by the share `fraction` (0 … 1, see [`stiffness_fraction`](crate::stiffness_fraction)) of the way to the group's best rigid fit.
///
/// With c and c̄ the group's centres of mass now and at rest,
///
/// ```text
/// A   = Σ_i [ R_i·B_i + m_i·(x_i − c)(x̄_i − c̄)ᵀ ],   R = rotation of polar(A)
/// x_i ← x_i + s·(R·(x̄_i − c̄) + c − x_i),            q_i ← q_i turned by the share s towards R
/// ```
///
/// (Müller & Chentanez 2011, §3; the centred sum, because the uncentred one loses a factor of twenty in `f32` at an offset of 1e4). The spin terms R_i·B_i keep A well conditioned for chains
/// and sheets, whose positions alone leave rotations open. Linear momentum is kept because Σ m_i·(x̄_i − c̄) = 0; what rounding leaves of
/// that sum is taken off again, or a stiff body would push itself through space by the last bit of its coordinates. All members turn, not the main one only: that is what keeps angular momentum,
/// spin included, to first order.
///
/// Groups are solved in colour order, each from the result of those before (Gauss–Seidel).
pub fn match_shapes(groups: &mut ImplicitGroups, particles: &mut Particles, fraction: f32, dt: f32) {
    if fraction <= 0.0 {
        return;
    }
    let rate = 1.0 / dt;
    let x = &mut particles.position;
    let v = &mut particles.velocity;
    let q = &mut particles.rotation;
    let mass = &particles.mass;
    for (g, row) in groups.rows.windows(2).enumerate() {
        let row = row[0] as usize..row[1] as usize;
        let members = &groups.members[row.clone()];
        let rest = &groups.rest[row];

        let mut center = Vec3A::ZERO;
        for &i in members {
            center += x[i as usize] * mass[i as usize];
        }
        center *= groups.inverse_mass[g];

        let mut a = Mat3A::ZERO;
        for (&i, &r) in members.iter().zip(rest) {
            let i = i as usize;
            let d = (x[i] - center) * mass[i];
            a += Mat3A::from_quat(q[i]) * groups.moment[i];
            a.x_axis += d * r.x;
            a.y_axis += d * r.y;
            a.z_axis += d * r.z;
        }

        let rotation = extract_rotation(a, groups.rotation[g]);
        groups.rotation[g] = rotation;
        let matrix = Mat3A::from_quat(rotation);
        let ways = &mut groups.ways[..members.len()];
        let mut excess = Vec3A::ZERO;
        for ((&i, &r), way) in members.iter().zip(rest).zip(&mut *ways) {
            let i = i as usize;
            *way = (matrix * r - (x[i] - center)) * fraction;
            excess += *way * mass[i];
        }
        excess *= groups.inverse_mass[g];
        for (&i, &way) in members.iter().zip(&*ways) {
            let i = i as usize;
            let way = way - excess;
            x[i] += way;
            v[i] += way * rate;
            q[i] = turn_towards(q[i], rotation, fraction);
        }
    }
}

/// `q` moved by the share `t` along the chord to `goal`, the short way.
///
/// Differs from the arc only in how the way is divided (by 1 % of the angle at 45°), not in direction, and needs no transcendental function. At exactly opposite quaternions of different sign
/// both are the same rotation; the sum vanishes only for t = ½ at half a turn, where `q` is kept.
#[inline]
fn turn_towards(q: Quat, goal: Quat, t: f32) -> Quat {
    let goal = if q.dot(goal) < 0.0 { -goal } else { goal };
    let sum = q * (1.0 - t) + goal * t;
    let length2 = sum.length_squared();
    if length2 > 1e-12 { sum * (1.0 / length2.sqrt()) } else { q }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{blob, line, scramble};
    use crate::{Edges, momentum, quat_exp, quat_log};

    fn groups_of(p: &Particles, pairs: &[[u32; 2]]) -> ImplicitGroups {
        ImplicitGroups::new(p, &Edges::new(p, pairs).unwrap())
    }

    #[test]
    fn an_undeformed_body_is_left_alone_wherever_it_is() {
        let (mut p, pairs) = blob();
        let mut groups = groups_of(&p, &pairs);
        p.place(quat_exp(Vec3A::new(0.5, -1.2, 0.7)), Vec3A::new(0.3, -0.2, 0.9));
        let before = p.clone();
        match_shapes(&mut groups, &mut p, 1.0, 0.01);
        for i in 0..p.len() {
            assert!(p.position[i].distance(before.position[i]) < 2e-6);
            assert!(quat_log(p.rotation[i] * before.rotation[i].inverse()).length() < 1e-5);
        }
    }

    /// Turning the whole scene turns the answer: the check that the often printed form of A_i fails by degrees.
    #[test]
    fn the_answer_turns_with_the_scene() {
        let (mut p, pairs) = blob();
        scramble(&mut p, 3);
        let turn = quat_exp(Vec3A::new(1.0, 0.4, -0.8));
        let mut turned = p.clone();
        turned.place(turn, Vec3A::ZERO);
        let (mut a, mut b) = (groups_of(&p, &pairs), groups_of(&turned, &pairs));
        match_shapes(&mut a, &mut p, 0.6, 0.01);
        match_shapes(&mut b, &mut turned, 0.6, 0.01);
        for i in 0..p.len() {
            assert!((turn * p.position[i]).distance(turned.position[i]) < 1e-5);
            assert!(quat_log(turn * p.rotation[i] * turned.rotation[i].inverse()).length() < 1e-4);
        }
    }

    #[test]
    fn linear_momentum_is_kept() {
        let (mut p, pairs) = blob();
        let mut groups = groups_of(&p, &pairs);
        scramble(&mut p, 5);
        let before = p.clone();
        match_shapes(&mut groups, &mut p, 0.8, 0.01);
        let mut moved = 0.0f32;
        for i in 0..p.len() {
            p.velocity[i] = p.position[i] - before.position[i];
            moved += p.mass[i] * p.velocity[i].length();
        }
        assert!(moved > 1e-2);
        assert!(momentum(&p).linear.length() < 1e-5 * moved);
    }

    /// A chain on a line has no shape in its positions; its orientations hold it.
    #[test]
    fn a_bent_chain_straightens() {
        let mut p = line(3, 1.0, 0.3);
        let mut groups = groups_of(&p, &[[0, 1], [1, 2]]);
        p.position[2] = Vec3A::new(1.8, 0.5, 0.0) + p.position[0];
        let bend = |p: &Particles| (p.position[2] - p.position[1]).normalize().cross((p.position[1] - p.position[0]).normalize()).length();
        let before = bend(&p);
        for _ in 0..50 {
            match_shapes(&mut groups, &mut p, 1.0, 0.01);
        }
        assert!(before > 0.3 && bend(&p) < 1e-3 * before, "{before} → {}", bend(&p));
    }

    #[test]
    fn collapsed_and_inverted_groups_recover() {
        let (rest, pairs) = blob();
        for collapse in [Vec3A::ZERO, Vec3A::new(1.0, 1.0, 0.0), Vec3A::new(1.0, 1.0, -1.0), -Vec3A::ONE] {
            let mut p = rest.clone();
            let mut groups = groups_of(&p, &pairs);
            for x in &mut p.position {
                *x *= collapse;
            }
            for _ in 0..400 {
                match_shapes(&mut groups, &mut p, 1.0, 0.01);
            }
            assert!(p.is_finite());
            let fit = crate::fit_rigid(&p, Quat::IDENTITY);
            assert!(fit.largest < 0.02, "{collapse}: {} m from its shape", fit.largest);
        }
    }
}
