//! Shape matching: every group is drawn towards its rest shape, moved and turned to where it is now.

use fearless_simd::{Level, Simd};
use glam::{Mat3A, Quat, Vec3A};

use crate::batches::Batches;
use crate::lanes::{LANES, Lanes, in_lanes};
use crate::match_batch::{BatchShare, match_batch};
use crate::momentum::{point_inertia, solve_inertia};
use crate::{ImplicitGroups, Particles, Share, Shares, Sweep, extract_rotation, quat_exp, quat_log};

/// Which members of a group take its rotation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Turning {
    /// All of them, by the group's share: conserves angular momentum, spin included, to first order.
    #[default]
    AllMembers,
    /// The particle the group belongs to, wholly, as in the 2011 paper: takes 5 to 18 % of a group's angular momentum in one projection.
    MainOnly,
}

/// How much heavier than it is a pinned member counts when its group's place and rotation are sought: as good as infinite, and the other members still decide what the pins leave open.
const PINNED: f32 = 1000.0;

/// Moves the members of every group by its share of the way to the group's best rigid fit.
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
/// that sum is taken off again, or a stiff body would push itself through space by the last bit of its coordinates.
///
/// In a [`RestPose`](crate::RestPose) that turns particles by R̄_i, x̄ is the place there, the spin term R_i·B_i·R̄_iᵀ = ∫ (R_i·ȳ)·(R̄_i·ȳ)ᵀ dm, and members turn towards R·R̄_i.
///
/// With a damping ratio, what differs from the group's rigid motion in the substep so far (its momentum, spin included, divided by its mass and inertia) counts as the change of the error. With
/// several sweeps, what a group has moved each member before in this substep counts against it: see [`Share`](crate::Share).
///
/// Pinned members weigh a thousandfold in c and, position and orientation apart, in A, and are not moved.
///
/// Groups are solved batch after batch, each from the result of those before (Gauss–Seidel), those of a batch side by side in vector lanes where the processor has them. Pinned members, damping, several
/// sweeps and turned rest poses take the scalar path. Shares are those of the particles that the groups belong to.
pub fn match_shapes(groups: &mut ImplicitGroups, particles: &mut Particles, shares: Shares, turning: Turning, sweep: Sweep) {
    if shares.are_off() {
        return;
    }
    sweep.ready(&mut groups.pulled, groups.members.len());
    particles.ready_rigid_push(shares);
    let plain = turning == Turning::AllMembers && groups.pulled.is_empty() && groups.rest_rotation.is_empty();
    if plain && groups.batches.len() > 0 {
        match_in_lanes(Level::new(), groups, particles, shares, sweep);
        return;
    }
    for g in 0..groups.len() {
        if let Some(share) = groups.share(g, shares) {
            match_group(groups, particles, g, share, turning, sweep);
        }
    }
}

/// Matches all groups batch after batch, with the instructions of `level`, which do not change the result if the sweep is deterministic.
fn match_in_lanes(level: Level, groups: &mut ImplicitGroups, particles: &mut Particles, shares: Shares, sweep: Sweep) {
    Batches::masses(&mut groups.batches, &groups.rows, &particles.mass);
    in_lanes!(level, sweep.deterministic, lanes => match_batches(lanes, groups, particles, shares, sweep));
}

#[inline(always)]
fn match_batches<S: Simd, const FUSED: bool>(
    lanes: Lanes<S, FUSED>,
    groups: &mut ImplicitGroups,
    particles: &mut Particles,
    shares: Shares,
    sweep: Sweep,
) {
    // Whether there are particles that the vector kernel does not know.
    let special = particles.inverse_mass.contains(&0.0) || particles.inverse_inertia.contains(&0.0) || groups.unoriented.contains(&true);
    // What all groups share out, if it is the same.
    let same = match shares {
        Shares::One(share) if !special && share.damping <= 0.0 && groups.held.is_empty() => Some(share.stiffness),
        _ => None,
    };
    for b in 0..groups.batches.len() {
        let (share, alone) = match same {
            Some(stiffness) => (BatchShare::same(stiffness), 0),
            None => groups.batch_share(b, shares, particles, special),
        };
        if share.active != 0 {
            let ImplicitGroups { batches, gathered, rotation, .. } = &mut *groups;
            match_batch(lanes, batches.batch(b), &mut rotation[batches.groups(b)], gathered, particles, &share, sweep.dt);
        }
        if alone != 0 {
            for (l, g) in groups.batches.groups(b).enumerate() {
                if let (1, Some(share)) = (alone >> l & 1, groups.share(g, shares)) {
                    match_group(groups, particles, g, share, Turning::AllMembers, sweep);
                }
            }
        }
    }
}

impl ImplicitGroups {
    /// The share of group `g`; none if it is off or held.
    #[inline]
    fn share(&self, g: usize, shares: Shares) -> Option<Share> {
        let main = self.members[self.rows[g] as usize];
        let share = shares.of(self.keys.get(g).copied().unwrap_or(main) as usize);
        (!share.is_off() && !self.held.get(main as usize).is_some_and(|&held| held)).then_some(share)
    }

    /// What the groups of batch `b` share out in the vector kernel, and which of them, as bits, must be matched one by one. `special`: whether there are particles that the kernel does not know.
    fn batch_share(&self, b: usize, shares: Shares, p: &Particles, special: bool) -> (BatchShare, u8) {
        let mut batch = BatchShare { stiffness: [0.0; LANES], active: 0, rigid: 0 };
        let mut alone = 0;
        let particles = self.batches.batch(b).0.iter().flat_map(|slot| slot.particle);
        let special = special && { particles }.any(|i| self.is_special(p, i as usize));
        for (l, g) in self.batches.groups(b).enumerate() {
            let Some(share) = self.share(g, shares) else { continue };
            if special || share.damping > 0.0 {
                alone |= 1 << l;
            } else {
                batch.stiffness[l] = share.stiffness;
                batch.active |= 1 << l;
                batch.rigid |= u8::from(share.is_rigid()) << l;
            }
        }
        (batch, alone)
    }

    /// Whether particle `i` is pinned or not oriented.
    #[inline]
    fn is_special(&self, p: &Particles, i: usize) -> bool {
        p.inverse_mass[i] == 0.0 || p.inverse_inertia[i] == 0.0 || self.unoriented.get(i).is_some_and(|&u| u)
    }
}

/// Matches group `g` alone.
fn match_group(groups: &mut ImplicitGroups, particles: &mut Particles, g: usize, share: Share, turning: Turning, sweep: Sweep) {
    let rate = 1.0 / sweep.dt;
    let row = groups.rows[g] as usize..groups.rows[g + 1] as usize;
    let members = &groups.members[row.clone()];
    let rest = &groups.rest[row.clone()];
    let x = &mut particles.position;
    let v = &mut particles.velocity;
    let q = &mut particles.rotation;
    let omega = &mut particles.angular_velocity;
    let (mass, w, inverse_inertia) = (&particles.mass, &particles.inverse_mass, &particles.inverse_inertia);

    let (mut center, mut rest_center, mut total, mut free) = (Vec3A::ZERO, Vec3A::ZERO, 0.0, true);
    for (&i, &r) in members.iter().zip(rest) {
        let i = i as usize;
        let mut m = mass[i];
        if w[i] == 0.0 {
            m *= PINNED;
            free = false;
        }
        center += x[i] * m;
        rest_center += r * m;
        total += m;
    }
    center /= total;
    rest_center /= total;

    let mut a = Mat3A::ZERO;
    for (&i, &r) in members.iter().zip(rest) {
        let i = i as usize;
        let weight = if w[i] == 0.0 { PINNED } else { 1.0 };
        let mut spin = Mat3A::from_quat(q[i]) * groups.moment[i];
        if let Some(&bar) = groups.rest_rotation.get(i) {
            spin *= Mat3A::from_quat(bar).transpose();
        }
        a += if inverse_inertia[i] == 0.0 { spin * PINNED } else { spin };
        let d = (x[i] - center) * (mass[i] * weight);
        let r = r - rest_center;
        a.x_axis += d * r.x;
        a.y_axis += d * r.y;
        a.z_axis += d * r.z;
    }

    let rotation = extract_rotation(a, groups.rotation[g]);
    groups.rotation[g] = rotation;
    let matrix = Mat3A::from_quat(rotation);

    let rigid = (share.damping > 0.0).then(|| rigid_velocity(members, center, x, v, omega, mass, &particles.inertia));
    let (memory, damping) = (share.memory, share.damping * sweep.dt);
    let stiff = share.is_rigid();
    let pulled = if groups.pulled.is_empty() { &mut [][..] } else { &mut groups.pulled[row] };
    let ways = &mut groups.ways[..members.len()];
    let mut excess = Vec3A::ZERO;
    for (k, (&i, &r)) in members.iter().zip(rest).enumerate() {
        let i = i as usize;
        let mut way = (matrix * (r - rest_center) - (x[i] - center)) * share.stiffness;
        if let Some((linear, angular)) = rigid {
            way -= (v[i] - linear - angular.cross(x[i] - center)) * damping;
        }
        if let Some(pulled) = pulled.get_mut(k) {
            way -= pulled.0 * memory;
            pulled.0 += way;
        }
        ways[k] = way;
        excess += way * mass[i];
    }
    excess = if free { excess / total } else { Vec3A::ZERO };
    let mut reaction = Vec3A::ZERO;
    for (k, (&i, &way)) in members.iter().zip(&*ways).enumerate() {
        let i = i as usize;
        if w[i] > 0.0 {
            let way = way - excess;
            x[i] += way;
            v[i] += way * rate;
            if stiff {
                particles.rigid_push[i][0] += way * rate;
            }
            reaction -= way * mass[i];
        }
        if inverse_inertia[i] == 0.0 || (turning == Turning::MainOnly && k > 0) || groups.unoriented.get(i).is_some_and(|&u| u) {
            continue;
        }
        let goal = match groups.rest_rotation.get(i) {
            Some(&bar) => rotation * bar,
            None => rotation,
        };
        let share_of_turn = if turning == Turning::MainOnly { 1.0 } else { share.stiffness };
        let mut angle = small_log(goal * q[i].inverse()) * share_of_turn;
        if let Some((_, angular)) = rigid {
            angle -= (omega[i] - angular) * damping;
        }
        if let Some(pulled) = pulled.get_mut(k) {
            angle -= pulled.1 * memory;
            pulled.1 += angle;
        }
        q[i] = turned(q[i], angle);
        omega[i] += angle * rate;
        if stiff {
            particles.rigid_push[i][1] += angle * rate;
        }
    }
    if !free && !particles.reaction.is_empty() {
        react(members, w, &mut particles.reaction, reaction * rate);
    }
}

/// Books the impulse that pinned members gave to their group, in equal parts: the group does not tell which of them gave it.
#[cold]
fn react(members: &[u32], w: &[f32], reaction: &mut [Vec3A], impulse: Vec3A) {
    let pinned = members.iter().filter(|&&i| w[i as usize] == 0.0).count();
    for &i in members {
        if w[i as usize] == 0.0 {
            reaction[i as usize] += impulse / pinned as f32;
        }
    }
}

/// Velocity of the rigid body that has the members' mass, inertia and momentum, spin included, about `center`. Without the angular part if the inertia is singular.
fn rigid_velocity(members: &[u32], center: Vec3A, x: &[Vec3A], v: &[Vec3A], omega: &[Vec3A], mass: &[f32], spin: &[f32]) -> (Vec3A, Vec3A) {
    let (mut total, mut linear) = (0.0, Vec3A::ZERO);
    for &i in members {
        total += mass[i as usize];
        linear += v[i as usize] * mass[i as usize];
    }
    linear /= total;
    let (mut angular, mut inertia) = (Vec3A::ZERO, Mat3A::ZERO);
    for &i in members {
        let i = i as usize;
        let (r, m) = (x[i] - center, mass[i]);
        angular += r.cross(v[i] - linear) * m + omega[i] * spin[i];
        inertia += point_inertia(r, m, spin[i]);
    }
    (linear, solve_inertia(inertia, angular).unwrap_or(Vec3A::ZERO))
}

/// The rotation vector of `q`, the short way round; from the sine of half the angle where that is small.
#[inline]
pub(crate) fn small_log(q: Quat) -> Vec3A {
    let q = if q.w < 0.0 { -q } else { q };
    let v = Vec3A::new(q.x, q.y, q.z);
    let s2 = v.length_squared();
    // 2·asin(s)/s = 2 + s²/3 + 3s⁴/20 + 5s⁶/56 + …
    if s2 < 0.01 { v * (2.0 + s2 * (1.0 / 3.0 + s2 * (0.15 + s2 * (5.0 / 56.0)))) } else { quat_log(q) }
}

/// `q` turned by the rotation vector `angle`, cheaply where it is small: the quaternion (½·angle, 1), normalised, turns by 2·atan(|angle|/2), which is the angle less its cube over twelve.
#[inline]
pub(crate) fn turned(q: Quat, angle: Vec3A) -> Quat {
    if angle.length_squared() < 0.01 {
        let half = angle * 0.5;
        (Quat::from_xyzw(half.x, half.y, half.z, 1.0) * q).normalize()
    } else {
        (quat_exp(angle) * q).normalize()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{Random, assert_close, blob, line, same_at_every_level, scramble};
    use crate::{Edges, Stiffness, momentum, quat_exp, quat_log};

    fn solve(groups: &mut ImplicitGroups, particles: &mut Particles, fraction: f32) {
        match_shapes(groups, particles, Stiffness::Fraction(fraction).share(0.01).into(), Turning::AllMembers, Sweep::only(0.01));
    }

    fn groups_of(p: &Particles, pairs: &[[u32; 2]]) -> ImplicitGroups {
        ImplicitGroups::new(p, &Edges::new(p, pairs).unwrap())
    }

    #[test]
    fn an_undeformed_body_is_left_alone_wherever_it_is() {
        let (mut p, pairs) = blob();
        let mut groups = groups_of(&p, &pairs);
        p.place(quat_exp(Vec3A::new(0.5, -1.2, 0.7)), Vec3A::new(0.3, -0.2, 0.9));
        let before = p.clone();
        solve(&mut groups, &mut p, 1.0);
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
        solve(&mut a, &mut p, 0.6);
        solve(&mut b, &mut turned, 0.6);
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
        solve(&mut groups, &mut p, 0.8);
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
            solve(&mut groups, &mut p, 1.0);
        }
        assert!(before > 0.3 && bend(&p) < 1e-3 * before, "{before} → {}", bend(&p));
    }

    /// A body in many states: from as good as undeformed to far turned, flat, inside out, and with pinned particles, each with the shares of its particles.
    fn states() -> Vec<(Particles, Vec<Share>)> {
        let mut random = Random(17);
        let (rest, _) = blob();
        (0..40)
            .map(|k| {
                let mut p = rest.clone();
                let size = [1e-4, 1e-2, 0.1, 1.0][k % 4];
                let squash = [Vec3A::ONE, Vec3A::new(1.0, 1.0, 1e-3), Vec3A::new(1.0, 1.0, -1.0), Vec3A::ONE][k / 4 % 4];
                for i in 0..p.len() {
                    p.position[i] = p.position[i] * squash + random.vector() * (0.3 * size);
                    p.rotation[i] = quat_exp(random.vector() * (3.0 * size)) * p.rotation[i];
                    p.mass[i] *= 1.0 + random.vector().x.abs();
                    if k % 5 == 4 && i % 7 == 0 {
                        p.pin(i, i % 2 == 0, i % 3 == 0);
                    }
                }
                p.place(quat_exp(random.vector()), random.vector() * 10.0);
                let share = |i: usize| {
                    [Stiffness::hertz(2.0), Stiffness::OFF, Stiffness::RIGID, Stiffness::damped(9.0, 0.3)]
                        [(i + k) % if k % 3 == 0 { 4 } else { 1 }]
                };
                let shares = (0..p.len()).map(|i| share(i).share(0.01)).collect();
                (p, shares)
            })
            .collect()
    }

    /// Eight groups side by side come out as one by one, but for rounding.
    #[test]
    fn lanes_do_what_one_group_does() {
        let (rest, pairs) = blob();
        for (k, (p, shares)) in states().into_iter().enumerate() {
            let (mut a, mut b) = (p.clone(), p);
            let (mut lanes, mut alone) = (groups_of(&rest, &pairs), groups_of(&rest, &pairs));
            let shares = Shares::Each(&shares);
            match_shapes(&mut lanes, &mut a, shares, Turning::AllMembers, Sweep::only(0.01));
            b.ready_rigid_push(shares);
            for g in 0..alone.len() {
                if let Some(share) = alone.share(g, shares) {
                    match_group(&mut alone, &mut b, g, share, Turning::AllMembers, Sweep::only(0.01));
                }
            }
            // A matrix of rank two and one inside out have rotations that rounding moves.
            assert_close(&a, &b, if k / 4 % 4 == 1 || k / 4 % 4 == 2 { 2e-3 } else { 2e-5 });
        }
    }

    /// The same bits with every instruction set that this processor has, where that was asked for.
    #[test]
    fn the_instruction_set_changes_nothing() {
        let (rest, pairs) = blob();
        for (p, shares) in states() {
            same_at_every_level(&p, |p, level| {
                let mut groups = groups_of(&rest, &pairs);
                p.ready_rigid_push(Shares::Each(&shares));
                for _ in 0..3 {
                    match_in_lanes(level, &mut groups, p, Shares::Each(&shares), Sweep { deterministic: true, ..Sweep::only(0.01) });
                }
            });
        }
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
                solve(&mut groups, &mut p, 1.0);
            }
            assert!(p.is_finite());
            let fit = crate::fit_rigid(&p, Quat::IDENTITY);
            assert!(fit.largest < 0.02, "{collapse}: {} m from its shape", fit.largest);
        }
    }
}
