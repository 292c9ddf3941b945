//! What a body carries: momentum, energy, and how far it is from its rest shape.

use fearless_simd::prelude::*;
use fearless_simd::{Level, dispatch};
use glam::{Mat3A, Quat, Vec3A};

use crate::lanes::{Eights, LANES, Lanes, Vec3x8};
use crate::workless::{allowed_energy, shed_energy};
use crate::{Particles, extract_rotation};

/// Momentum and energy of a body.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Momentum {
    /// Total mass \[kg\].
    pub mass: f32,
    /// Centre of mass \[m\], relative to the body's origin.
    pub center: Vec3A,
    /// P = Σ m·v \[kg·m/s\].
    pub linear: Vec3A,
    /// L = Σ (m·r×v + I·ω) about the centre of mass, spin included \[kg·m²/s\].
    pub angular: Vec3A,
    /// Inertia about the centre of mass, spin included \[kg·m²\].
    pub inertia: Mat3A,
    /// ½ Σ (m·v² + I·ω²) \[J\].
    pub kinetic_energy: f32,
}

/// Sums up what the particles carry. An empty body carries nothing.
///
/// In eight sums, one a lane, which are added up in the end: the same bits with all instructions.
pub fn momentum(p: &Particles) -> Momentum {
    dispatch!(Level::new(), simd => sum_up(Lanes::<_, false>(simd), p))
}

#[inline(always)]
fn sum_up<S: Simd>(lanes: Lanes<S, false>, p: &Particles) -> Momentum {
    let n = p.len();
    let [x, v, w] = [&p.position, &p.velocity, &p.angular_velocity].map(|from| Eights::of(&from[..n]));
    let [mass, inertia] = [&p.mass, &p.inertia].map(|from| Eights::of(&from[..n]));
    let eights = n.div_ceil(LANES);
    let (mut center, mut total) = (lanes.zero(), lanes.splat(0.0));
    for k in 0..eights {
        let (x, m) = (x.get(k), lanes.load(mass.get(k)));
        center += lanes.vectors(|l| x[l]) * m;
        total += m;
    }
    let mut sum = Momentum { mass: lanes.sum(total), center: lanes.sum_vector(center), inertia: Mat3A::ZERO, ..Momentum::default() };
    if sum.mass > 0.0 {
        sum.center /= sum.mass;
    }
    let center = lanes.vectors(|_| sum.center);
    let (mut linear, mut angular, mut squares, mut products) = (lanes.zero(), lanes.zero(), lanes.zero(), lanes.zero());
    let (mut spins, mut energy) = (lanes.splat(0.0), lanes.splat(0.0));
    for k in 0..eights {
        let (x, v, w) = (x.get(k), v.get(k), w.get(k));
        let (m, j) = (lanes.load(mass.get(k)), lanes.load(inertia.get(k)));
        let (x, v, w) = (lanes.vectors(|l| x[l]), lanes.vectors(|l| v[l]), lanes.vectors(|l| w[l]));
        // What makes up the last eight has no mass.
        let r = x - center;
        let (mr, mv, spin) = (r * m, v * m, w * j);
        linear += mv;
        angular += lanes.cross(r, mv) + spin;
        energy += lanes.dot(mv, v) + lanes.dot(spin, w);
        squares += Vec3x8 { x: mr.x * r.x, y: mr.y * r.y, z: mr.z * r.z };
        products += Vec3x8 { x: mr.y * r.z, y: mr.z * r.x, z: mr.x * r.y };
        spins += j;
    }
    sum.linear = lanes.sum_vector(linear);
    sum.angular = lanes.sum_vector(angular);
    sum.kinetic_energy = 0.5 * lanes.sum(energy);
    let (s, c) = (lanes.sum_vector(squares), lanes.sum_vector(products));
    let spins = lanes.sum(spins);
    sum.inertia = Mat3A::from_cols(
        Vec3A::new(s.y + s.z + spins, -c.z, -c.y),
        Vec3A::new(-c.z, s.x + s.z + spins, -c.x),
        Vec3A::new(-c.y, -c.x, s.x + s.y + spins),
    );
    sum
}

/// What the `members` carry; only the spin of those that are `oriented` counts.
pub(crate) fn momentum_of(p: &Particles, members: impl Iterator<Item = usize> + Clone, oriented: impl Fn(usize) -> bool) -> Momentum {
    let mut sum = Momentum { inertia: Mat3A::ZERO, ..Momentum::default() };
    for i in members.clone() {
        sum.center += p.position[i] * p.mass[i];
        sum.mass += p.mass[i];
    }
    if sum.mass > 0.0 {
        sum.center /= sum.mass;
    }
    for i in members {
        let (m, v, omega) = (p.mass[i], p.velocity[i], p.angular_velocity[i]);
        let r = p.position[i] - sum.center;
        let spin = if oriented(i) { p.inertia[i] } else { 0.0 };
        sum.linear += v * m;
        sum.angular += r.cross(v) * m + omega * spin;
        sum.kinetic_energy += 0.5 * (m * v.length_squared() + spin * omega.length_squared());
        sum.inertia += point_inertia(r, m, spin);
    }
    sum
}

/// Turns the whole body as a rigid piece, in velocity only, so that its angular momentum about its centre of mass, spin included, is `angular` \[kg·m²/s\] again: δω = J⁻¹(L_before − L),
/// v += δω×r, ω += δω. Linear momentum is not touched.
///
/// Constraints pull at where particles *will* be, so each sweep loses about (ωΔt)² of the angular momentum; measured before the internal constraints of a substep of `dt` \[s\] and restored after
/// them, none is lost. The turn is at most a tenth of a radian a substep, for a body that is all but a point; a singular inertia is not turned.
///
/// What nothing bends does no work: those whom rigid constraints have moved in the substep get no more kinetic energy, in all, than they would have had without, whatever made the error that was put right.
///
/// A body with anything pinned is left alone: what holds it gives L and energy too.
pub fn restore_angular_momentum(p: &mut Particles, angular: Vec3A, dt: f32) {
    if p.inverse_mass.contains(&0.0) || p.inverse_inertia.contains(&0.0) {
        return;
    }
    let allowed = allowed_energy(p);
    let now = momentum(p);
    if let Some(turn) = solve_inertia(now.inertia, angular - now.angular) {
        let turn = turn.clamp_length_max(0.1 / dt);
        for i in 0..p.len() {
            p.velocity[i] += turn.cross(p.position[i] - now.center);
            p.angular_velocity[i] += turn;
        }
    }
    if let Some(allowed) = allowed {
        shed_energy(p, allowed);
    }
}

/// Inertia about the origin of the mass `m` at `r` with the spin inertia `spin` \[kg·m²\]: (m·r² + spin)·I − m·r·rᵀ.
#[inline]
pub(crate) fn point_inertia(r: Vec3A, m: f32, spin: f32) -> Mat3A {
    let round = m * r.length_squared() + spin;
    Mat3A::from_cols(Vec3A::X * round - r * (m * r.x), Vec3A::Y * round - r * (m * r.y), Vec3A::Z * round - r * (m * r.z))
}

/// J⁻¹·L. `None` if J is singular, as for a needle of points without spin, or nothing is finite.
#[inline]
pub(crate) fn solve_inertia(inertia: Mat3A, angular: Vec3A) -> Option<Vec3A> {
    // Normalised, so that a body of millimetres is not taken for a singular one.
    let scale = inertia.x_axis.x + inertia.y_axis.y + inertia.z_axis.z;
    let scaled = inertia * (1.0 / scale);
    if !(scaled.is_finite() && scaled.determinant() > 1e-9) {
        return None;
    }
    let omega = scaled.inverse() * angular / scale;
    omega.is_finite().then_some(omega)
}

/// The rigid motion from rest that comes nearest to a body, and what is left.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RigidFit {
    /// Rotation since rest.
    pub rotation: Quat,
    /// Largest distance of a particle from where the rigid motion puts it \[m\].
    pub largest: f32,
}

/// Fits one rotation to the whole body, starting from `guess`, and tells how far its particles are from the shape at rest.
pub fn fit_rigid(p: &Particles, guess: Quat) -> RigidFit {
    let center = p.center_of_mass();
    let mut rest_center = Vec3A::ZERO;
    let mut mass = 0.0;
    for i in 0..p.len() {
        rest_center += p.rest_position[i] * p.mass[i];
        mass += p.mass[i];
    }
    rest_center /= mass;
    let mut a = Mat3A::ZERO;
    for i in 0..p.len() {
        let d = (p.position[i] - center) * p.mass[i];
        let r = p.rest_position[i] - rest_center;
        a += Mat3A::from_cols(d * r.x, d * r.y, d * r.z);
    }
    let rotation = extract_rotation(a, guess);
    let largest =
        (0..p.len()).map(|i| (rotation * (p.rest_position[i] - rest_center) + center).distance(p.position[i])).fold(0.0, f32::max);
    RigidFit { rotation, largest }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{Random, blob};

    #[test]
    fn what_was_lost_comes_back_and_nothing_else_changes() {
        let (mut p, _) = blob();
        let mut random = Random(3);
        for i in 0..p.len() {
            p.velocity[i] = random.vector();
            p.angular_velocity[i] = random.vector();
        }
        let before = momentum(&p);
        for w in &mut p.angular_velocity {
            *w *= 0.7;
        }
        for (v, x) in p.velocity.iter_mut().zip(&p.position) {
            *v += Vec3A::Z.cross(*x - before.center) * 0.2;
        }
        assert!(momentum(&p).angular.distance(before.angular) > 1e-2 * before.angular.length());
        restore_angular_momentum(&mut p, before.angular, 0.01);
        let after = momentum(&p);
        assert!(after.angular.distance(before.angular) < 1e-5 * before.angular.length());
        assert!(after.linear.distance(before.linear) < 1e-5 * before.linear.length());
    }

    #[test]
    fn a_pinned_body_is_left_alone() {
        let (mut p, _) = blob();
        p.pin(3, true, false);
        let before = p.clone();
        restore_angular_momentum(&mut p, Vec3A::ONE, 0.01);
        assert_eq!(p, before);
    }
}
