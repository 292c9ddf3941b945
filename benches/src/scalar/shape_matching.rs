//! Shape matching of oriented particles, group after group.

use glam::{Mat3A, Quat, Vec3A};
use polpo_solver::{ImplicitGroups, Particles, extract_rotation, quat_exp, quat_log};

/// One member of a group.
#[derive(Clone, Copy, Debug)]
struct Member {
    /// x̄ − c̄ \[m\]
    rest: Vec3A,
    particle: u32,
}

/// Implicit groups of free particles, as a scalar kernel wants them: what does not change is worked out before.
#[derive(Clone, Debug)]
pub struct ScalarGroups {
    /// Where each group's members start, and the end of the last.
    rows: Vec<u32>,
    members: Vec<Member>,
    /// One over each group's mass \[1/kg\].
    inverse_mass: Vec<f32>,
    /// Second moment of each particle at rest \[kg·m²\].
    moment: Vec<Mat3A>,
    /// The rotations found last, one a group.
    pub rotation: Vec<Quat>,
    /// Scratch: the ways of one group's members \[m\].
    ways: Vec<Vec3A>,
}

impl ScalarGroups {
    /// The same groups in the same order.
    pub fn new(groups: &ImplicitGroups, particles: &Particles) -> Self {
        let mut this = Self {
            rows: vec![0],
            members: Vec::new(),
            inverse_mass: Vec::new(),
            moment: (0..particles.len()).map(|i| groups.moment(i)).collect(),
            rotation: groups.rotation.clone(),
            ways: Vec::new(),
        };
        for g in 0..groups.len() {
            let (members, rest) = (groups.members(g), groups.rest(g));
            let mass: f32 = members.iter().map(|&i| particles.mass[i as usize]).sum();
            let center = members.iter().zip(rest).map(|(&i, &r)| r * particles.mass[i as usize]).sum::<Vec3A>() / mass;
            this.members.extend(members.iter().zip(rest).map(|(&particle, &r)| Member { rest: r - center, particle }));
            this.rows.push(this.members.len() as u32);
            this.inverse_mass.push(1.0 / mass);
            this.ways.resize(this.ways.len().max(members.len()), Vec3A::ZERO);
        }
        this
    }

    /// Moves the members of every group by the share `stiffness` (0 … 1) of the way to the group's best rigid fit, in a substep of `dt` \[s\]; no particle may be pinned.
    ///
    /// ```text
    /// A   = Σ_i [ R_i·B_i + m_i·(x_i − c)(x̄_i − c̄)ᵀ ],   R = rotation of polar(A)
    /// x_i ← x_i + s·(R·(x̄_i − c̄) + c − x_i),            q_i ← q_i turned by the share s towards R
    /// ```
    ///
    /// The search for R starts from the last one, turned on by the spin of the group's first particle. What rounding leaves of Σ m·way is taken off. Ways and turns go into the velocities as well.
    pub fn match_shapes(&mut self, particles: &mut Particles, stiffness: f32, dt: f32) {
        let rate = 1.0 / dt;
        let count = particles.len();
        // Of one length, which the compiler then knows.
        let x = &mut particles.position[..count];
        let v = &mut particles.velocity[..count];
        let q = &mut particles.rotation[..count];
        let omega = &mut particles.angular_velocity[..count];
        let mass = &particles.mass[..count];
        let moment = &self.moment[..count];
        for ((row, rotation), &per_mass) in self.rows.windows(2).zip(&mut self.rotation).zip(&self.inverse_mass) {
            let members = &self.members[row[0] as usize..row[1] as usize];
            let Some(main) = members.first().map(|m| m.particle as usize) else { continue };

            let origin = x[main];
            let (mut center, mut a) = (Vec3A::ZERO, Mat3A::ZERO);
            for &Member { rest, particle } in members {
                let i = particle as usize;
                // Relative to the first member: Σ m·x̄ = 0, so the centre need not be known yet.
                let d = (x[i] - origin) * mass[i];
                center += d;
                let spin = Mat3A::from_quat(q[i]) * moment[i];
                a.x_axis += spin.x_axis + d * rest.x;
                a.y_axis += spin.y_axis + d * rest.y;
                a.z_axis += spin.z_axis + d * rest.z;
            }
            let center = origin + center * per_mass;

            let turn = omega[main] * (0.5 * dt);
            let guess = (Quat::from_xyzw(turn.x, turn.y, turn.z, 1.0) * *rotation).normalize();
            *rotation = extract_rotation(a, guess);
            let matrix = Mat3A::from_quat(*rotation);

            let ways = &mut self.ways[..members.len()];
            let mut excess = Vec3A::ZERO;
            for (way, &Member { rest, particle }) in ways.iter_mut().zip(members) {
                let i = particle as usize;
                *way = (matrix * rest + (center - x[i])) * stiffness;
                excess += *way * mass[i];
            }
            let excess = excess * per_mass;
            for (&way, &Member { particle, .. }) in ways.iter().zip(members) {
                let i = particle as usize;
                let way = way - excess;
                x[i] += way;
                v[i] += way * rate;
                let angle = quat_log(*rotation * q[i].conjugate()) * stiffness;
                q[i] = quat_exp(angle) * q[i];
                omega[i] += angle * rate;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use polpo_solver::{Shares, Stiffness, Sweep, Turning, match_shapes};

    use super::*;
    use crate::kernels::{Body, stir};
    use crate::scalar::testing::assert_close;

    /// The library's result but for rounding: on the octopus and on a block, hardly or badly out of shape.
    #[test]
    fn matches_as_the_library_does() {
        let dt = 1.0 / 300.0;
        let share = Stiffness::hertz(25.0).share(dt);
        for body in [Body::octopus(), Body::block([5, 6, 7])] {
            for size in [0.01, 0.05, 0.2] {
                let mut particles = body.particles.clone();
                stir(&mut particles, size);
                let (mut wide, mut groups) = (particles.clone(), body.groups.clone());
                let (mut scalar, mut ours) = (particles.clone(), ScalarGroups::new(&groups, &particles));
                match_shapes(&mut groups, &mut wide, Shares::One(share), Turning::AllMembers, Sweep::only(dt));
                ours.match_shapes(&mut scalar, share.stiffness, dt);
                assert_close(&wide, &scalar, &particles, dt);
            }
        }
    }
}
