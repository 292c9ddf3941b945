//! Shape matching by Jacobi's method, to be measured against the solver's Gauss–Seidel: all groups pull from the same state, and their pulls are summed.

use glam::{Mat3A, Vec3A};
use polpo_solver::{ImplicitGroups, Particles, Shares, Sweep, extract_rotation, quat_log};

/// What the sum of the pulls on a particle is divided by. It has to be the same for all particles: with each its own number of groups the pulls of a group would no longer add up to nothing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Divisor {
    /// By D, the most groups that a particle is in: the sum of D pulls is a mean of them, and cannot overshoot.
    Most,
    /// By (1 + D·κ)/(1 + κ) with κ = (ω₀Δt)²: D where groups are rigid, 1 where they are soft. It is the diagonal of implicit Euler's equation with D groups that pull the same way. Shares without
    /// hertz are divided by D.
    Implicit,
}

/// Shape matching from one state.
#[derive(Clone, Debug)]
pub(crate) struct Jacobi {
    divisor: Divisor,
    /// By how much each particle is to be moved \[m\] and turned \[rad\].
    sums: Vec<(Vec3A, Vec3A)>,
    /// By how much each group has moved and turned each member in this substep.
    pulled: Vec<(Vec3A, Vec3A)>,
    /// D, and of how many members it was counted.
    most: (f32, usize),
}

/// As in the solver: how much heavier a pinned member counts.
const PINNED: f32 = 1000.0;

impl Jacobi {
    pub(crate) fn new(divisor: Divisor) -> Self {
        Self { divisor, sums: Vec::new(), pulled: Vec::new(), most: (1.0, 0) }
    }

    /// As [`polpo_solver::match_shapes`] does with `Turning::AllMembers`, for bodies without explicit groups, another rest pose or damped shares.
    pub(crate) fn match_shapes(&mut self, groups: &mut ImplicitGroups, p: &mut Particles, shares: Shares<'_>, sweep: Sweep) {
        let rate = 1.0 / sweep.dt;
        let remembers = sweep.count > 1;
        if remembers && (sweep.index == 0 || self.pulled.len() != groups.member_count()) {
            self.pulled.clear();
            self.pulled.resize(groups.member_count(), Default::default());
        }
        if self.most.1 != groups.member_count() {
            let mut counts = vec![0u32; p.len()];
            (0..groups.len()).flat_map(|g| groups.members(g)).for_each(|&i| counts[i as usize] += 1);
            self.most = (counts.into_iter().max().unwrap_or(1) as f32, groups.member_count());
        }
        self.sums.clear();
        self.sums.resize(p.len(), Default::default());
        for g in 0..groups.len() {
            let (members, rest) = (groups.members(g), groups.rest(g));
            let share = shares.of(members[0] as usize);
            if share.is_off() {
                continue;
            }
            // The memory is 1/(1 + κ), the stiffness κ/(1 + κ).
            let factor = match self.divisor {
                Divisor::Implicit if share.memory > 0.0 => 1.0 / (share.memory + self.most.0 * share.stiffness),
                _ => 1.0 / self.most.0,
            };
            let weight = |i: usize| if p.inverse_mass[i] == 0.0 { p.mass[i] * PINNED } else { p.mass[i] };
            let (mut center, mut rest_center, mut total) = (Vec3A::ZERO, Vec3A::ZERO, 0.0);
            for (&i, &r) in members.iter().zip(rest) {
                let m = weight(i as usize);
                center += p.position[i as usize] * m;
                rest_center += r * m;
                total += m;
            }
            center /= total;
            rest_center /= total;
            let mut a = Mat3A::ZERO;
            for (&i, &r) in members.iter().zip(rest) {
                let i = i as usize;
                let (d, r) = ((p.position[i] - center) * weight(i), r - rest_center);
                let spin = Mat3A::from_quat(p.rotation[i]) * groups.moment(i);
                a += if p.inverse_inertia[i] == 0.0 { spin * PINNED } else { spin };
                a += Mat3A::from_cols(d * r.x, d * r.y, d * r.z);
            }
            let rotation = extract_rotation(a, groups.rotation[g]);
            let matrix = Mat3A::from_quat(rotation);
            for (k, (&i, &r)) in groups.row(g).zip(members.iter().zip(rest)) {
                let i = i as usize;
                let mut way = (matrix * (r - rest_center) - (p.position[i] - center)) * share.stiffness;
                let mut angle = quat_log(rotation * p.rotation[i].inverse()) * share.stiffness;
                if remembers {
                    way -= self.pulled[k].0 * share.memory;
                    angle -= self.pulled[k].1 * share.memory;
                }
                (way, angle) = (way * factor, angle * factor);
                if remembers {
                    self.pulled[k].0 += way;
                    self.pulled[k].1 += angle;
                }
                self.sums[i].0 += way;
                self.sums[i].1 += angle;
            }
            groups.rotation[g] = rotation;
        }
        for (i, &(way, angle)) in self.sums.iter().enumerate() {
            if p.inverse_mass[i] > 0.0 {
                p.displace(i, way, rate);
            }
            if p.inverse_inertia[i] > 0.0 {
                p.turn(i, angle, rate);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::{Body, Matching};
    use crate::soft::{Random, lattice};
    use glam::DVec3;
    use polpo_solver::{Stiffness, Turning, quat_exp};

    fn shaken(divisor: Divisor) -> Body {
        let mut body = lattice([3, 3, 3], 0.01);
        body.matching = Matching::Jacobi(Jacobi::new(divisor));
        let mut random = Random(2);
        for i in 0..body.particles.len() {
            body.particles.position[i] += random.vector() * 0.01;
            body.particles.rotation[i] = quat_exp(random.vector() * 0.1);
        }
        body
    }

    #[test]
    fn the_pulls_of_a_group_add_up_to_nothing() {
        for divisor in [Divisor::Most, Divisor::Implicit] {
            let mut body = shaken(divisor);
            body.shape = Stiffness::hertz(40.0);
            body.sweep(Sweep { count: 2, ..Sweep::only(0.01) });
            body.sweep(Sweep { index: 1, count: 2, ..Sweep::only(0.01) });
            let carried = body.carried();
            let moved: DVec3 = body.particles.velocity.iter().map(|v| v.as_dvec3().abs()).sum();
            assert!(moved.length() > 0.1 && carried.linear.length() < 1e-5 * moved.length(), "{carried:?} {moved}");
        }
    }

    /// Where groups hardly pull, it does not matter who goes first, and only the divisor that knows it lets them pull as hard as Gauss–Seidel does.
    #[test]
    fn soft_groups_pull_as_they_do_one_after_the_other() {
        let ways = |matching: Option<Matching>, divisor| {
            let mut body = shaken(divisor);
            body.shape = Stiffness::hertz(0.2);
            body.matching = matching.unwrap_or(body.matching);
            body.sweep(Sweep::only(0.01));
            body.particles.velocity
        };
        let one = ways(Some(Matching::GaussSeidel(Turning::AllMembers)), Divisor::Most);
        // The ball in the middle is in the groups of all that its edges lead to, and in its own.
        let most = shaken(Divisor::Most).edges.pairs.iter().filter(|pair| pair.contains(&13)).count() as f32 + 1.0;
        for (divisor, expected) in [(Divisor::Implicit, 1.0), (Divisor::Most, 1.0 / most)] {
            let all = ways(None, divisor);
            let ratio = all.iter().zip(&one).map(|(a, b)| a.dot(*b)).sum::<f32>() / one.iter().map(|v| v.length_squared()).sum::<f32>();
            assert!((ratio / expected - 1.0).abs() < 0.01, "{divisor:?}: {ratio}");
        }
    }
}
