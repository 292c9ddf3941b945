//! Internal damping: a body's wobble dies, its flight and its spin do not.

use glam::Vec3A;

use crate::momentum::{Momentum, momentum, momentum_of, solve_inertia};
use crate::{ExplicitGroups, Particles};

/// Draws every particle's velocity towards that of the rigid body with the same momentum: by the share 1 − e^(−k·Δt) for the rate `rate` k \[1/s\] (0: none, infinity: at once).
///
/// The rigid motion has the velocity P/M at the centre of mass and ω = J⁻¹L with J the inertia including spin, so pulling v_i towards P/M + ω×r_i and ω_i towards ω leaves P and L as
/// they were. If J is singular (a single particle without extent) only the linear part is used. What is pinned keeps its velocity.
pub fn damp_internally(particles: &mut Particles, dt: f32, rate: f32) {
    if let Some(share) = share(rate, dt) {
        let total = momentum(particles);
        damp(particles, share, total, 0..particles.len(), |_| true);
    }
}

/// [`damp_internally`] for a body with explicit groups, whose turning against each other is not wobble: a wheel must not be braked by the damping of the car's skin.
///
/// So rigid groups are left alone, having nothing inside that could wobble; each soft one is drawn towards its own rigid motion; and what no closed group holds is drawn towards the rigid motion of
/// all that. P and L of each part stay. The spin of a particle that soft groups share belongs to none of them and is left alone.
pub fn damp_beside(groups: &ExplicitGroups, particles: &mut Particles, dt: f32, rate: f32) {
    let Some(share) = share(rate, dt) else { return };
    let free = (0..particles.len()).filter(|&i| !groups.holds(i));
    let total = momentum_of(particles, free.clone(), |_| true);
    damp(particles, share, total, free, |_| true);
    for g in (0..groups.len()).filter(|&g| !groups.is_open(g) && !groups.bodies[g].acting) {
        let (members, oriented) = (groups.members(g).iter().map(|&i| i as usize), |i: usize| !groups.shape.unoriented[i]);
        let total = momentum_of(particles, members.clone(), oriented);
        damp(particles, share, total, members, oriented);
    }
}

fn share(rate: f32, dt: f32) -> Option<f32> {
    (rate > 0.0).then(|| 1.0 - libm::expf(-rate * dt))
}

/// Draws the `members`, which carry `total`, towards their common rigid motion by `share`; only those that are `oriented` have spin.
fn damp(particles: &mut Particles, share: f32, total: Momentum, members: impl Iterator<Item = usize>, oriented: impl Fn(usize) -> bool) {
    if total.mass <= 0.0 {
        return;
    }
    let linear = total.linear / total.mass;
    let turning = solve_inertia(total.inertia, total.angular);
    let omega = turning.unwrap_or(Vec3A::ZERO);
    for i in members {
        if particles.inverse_mass[i] > 0.0 {
            let rigid = linear + omega.cross(particles.position[i] - total.center);
            let v = particles.velocity[i];
            particles.velocity[i] += (rigid - v) * share;
        }
        if turning.is_some() && particles.inverse_inertia[i] > 0.0 && oriented(i) {
            let w = particles.angular_velocity[i];
            particles.angular_velocity[i] += (omega - w) * share;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{Random, blob};
    use crate::{ExplicitGroup, Stiffness};

    #[test]
    fn momentum_is_kept_and_wobble_dies() {
        let (mut p, _) = blob();
        let mut random = Random(11);
        for i in 0..p.len() {
            p.velocity[i] = random.vector() + Vec3A::X;
            p.angular_velocity[i] = random.vector() * 3.0;
        }
        let before = momentum(&p);
        for _ in 0..100 {
            damp_internally(&mut p, 0.01, 5.0);
        }
        let after = momentum(&p);
        assert!(after.linear.distance(before.linear) < 1e-5 * before.linear.length());
        assert!(after.angular.distance(before.angular) < 1e-4 * before.angular.length());
        let mut rigid = p.clone();
        rigid.set_rigid_velocity(after.linear / after.mass, after.inertia.inverse() * after.angular);
        let least = momentum(&rigid).kinetic_energy;
        assert!(after.kinetic_energy < before.kinetic_energy);
        assert!(after.kinetic_energy - least < 1e-3 * (before.kinetic_energy - least));
    }

    #[test]
    fn a_rigid_motion_is_not_damped() {
        let (mut p, _) = blob();
        p.set_rigid_velocity(Vec3A::new(1.0, 2.0, 3.0), Vec3A::new(0.5, -4.0, 1.0));
        let before = p.clone();
        damp_internally(&mut p, 0.1, 10.0);
        for i in 0..p.len() {
            assert!(p.velocity[i].distance(before.velocity[i]) < 1e-4);
        }
    }

    /// A spinning wheel, a soft piece and loose flesh: each keeps its momentum, the wheel its every bit, and what wobbles inside the others dies.
    #[test]
    fn parts_are_damped_each_for_itself() {
        let (mut p, _) = blob();
        let soft = ExplicitGroup { stiffness: Stiffness::hertz(5.0), ..ExplicitGroup::rigid([6, 7, 8, 9, 10]) };
        let mut groups = ExplicitGroups::new(&p, &[ExplicitGroup::rigid([0, 1, 2, 3, 4, 5]), soft]).unwrap();
        let mut random = Random(4);
        for i in 0..p.len() {
            p.velocity[i] = random.vector();
            p.angular_velocity[i] = random.vector();
        }
        crate::predict(&mut p, Vec3A::ZERO, 1e-3);
        crate::predict_explicit(&mut groups, &mut p, 1e-3);
        let parts = [0..6, 6..11, 11..p.len()];
        let sums = |p: &Particles| parts.clone().map(|part| momentum_of(p, part, |_| true));
        let (wheel, before) = (p.velocity[..6].to_vec(), sums(&p));
        damp_beside(&groups, &mut p, 1.0, 20.0);
        for (a, b) in before.iter().zip(sums(&p)) {
            assert!(b.linear.distance(a.linear) < 1e-5 && b.angular.distance(a.angular) < 1e-5);
        }
        assert_eq!(p.velocity[..6], wheel);
        for part in &parts[1..] {
            let sum = momentum_of(&p, part.clone(), |_| true);
            let omega = solve_inertia(sum.inertia, sum.angular).unwrap();
            for i in part.clone() {
                let rigid = sum.linear / sum.mass + omega.cross(p.position[i] - sum.center);
                assert!(p.velocity[i].distance(rigid) < 1e-4, "{i}");
            }
        }
        assert!(momentum(&p).linear.length() > 0.1);
    }
}
