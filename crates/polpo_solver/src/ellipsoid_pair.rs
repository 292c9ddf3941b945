//! Two ellipsoids: whether they overlap, how deep, along which normal, and where they touch.

use glam::{Mat3A, Vec3A};

use crate::Ellipsoid;

/// The smallest half axis that a contact sees, as a share of the largest. Flatter ellipsoids count as this flat: an edge sharper than that is a line to `f32`.
pub(crate) const FLATTEST: f32 = 0.05;

/// Two ellipsoids as their contact sees them: shape matrices Σ = Q diag(a², b², c²) Qᵀ and the way d from the first centre to the second.
///
/// The *gap* along a unit vector n is g(n) = n·d − h₁(n) − h₂(n) with the supports hᵢ = √(nᵀΣᵢn): what a plane with normal n would leave between them. The ellipsoids are apart if it is positive for any
/// n; their distance, or less their depth, is its maximum over all n, since the Minkowski sum of the two is the set of d where no n has a positive gap.
///
/// Lengths are divided by the larger enveloping radius, so that bodies of micrometres are not lost under the smallest number of `f32`.
#[derive(Clone, Copy, Debug)]
pub struct EllipsoidPair {
    sigma: [Mat3A; 2],
    axes: [Mat3A; 2],
    bounds: [f32; 2],
    d: Vec3A,
    scale: f32,
}

/// Where two ellipsoids come nearest to touching.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PairGap {
    /// What the normal's plane leaves between them \[m\]; negative is the depth of their overlap.
    pub gap: f32,
    /// Unit normal, from the first to the second.
    pub normal: Vec3A,
    /// From each centre to its own outermost point against the other \[m\].
    pub reach: [Vec3A; 2],
}

/// A direction, and the gap and its slopes there; lengths in units of the larger radius.
#[derive(Clone, Copy)]
struct Look {
    n: Vec3A,
    gap: f32,
    h: [f32; 2],
    reach: [Vec3A; 2],
}

impl EllipsoidPair {
    /// The pair with the second centre at `d` \[m\] from the first. Half axes under a twentieth of the largest count as that.
    pub fn new(first: &Ellipsoid, second: &Ellipsoid, d: Vec3A) -> Self {
        let scale = first.bound().max(second.bound());
        let inverse = 1.0 / scale;
        let axes = [Mat3A::from_quat(first.orientation), Mat3A::from_quat(second.orientation)];
        Self {
            sigma: [shape(&axes[0], first.radii * inverse), shape(&axes[1], second.radii * inverse)],
            axes,
            bounds: [first.bound() * inverse, second.bound() * inverse],
            d: d * inverse,
            scale,
        }
    }

    /// The same two with another way `d` between them \[m\].
    pub(crate) fn at(&self, d: Vec3A) -> Self {
        Self { d: d / self.scale, ..*self }
    }

    /// The same two with the second moved by `way` \[m\].
    pub(crate) fn moved(&self, way: Vec3A) -> Self {
        Self { d: self.d + way / self.scale, ..*self }
    }

    /// Perram & Wertheim's contact function and the normal that belongs to it.
    ///
    /// F = max over λ in 0 … 1 of λ(1 − λ)·dᵀG⁻¹d with G = (1 − λ)Σ₁ + λΣ₂ (Perram & Wertheim 1985). Grown by √F both ellipsoids touch, with the normal n along z = G⁻¹d; so n·d = √F·(h₁ + h₂), the gap
    /// along n is (√F − 1)(h₁ + h₂), and they overlap if and only if F < 1.
    ///
    /// At the maximum (1 − λ)²·zᵀΣ₁z = λ²·zᵀΣ₂z. With λ/(1 − λ) = R₁s/(R₂(1 − s)), Rᵢ the enveloping radii, so that unequal sizes do not crowd λ at its end, and Aᵢ = Σᵢ/Rᵢ this is s = q₁/(q₁ + q₂),
    /// qᵢ² = zᵀAᵢz/Rᵢ, which is exact for spheres at once and else sought by the secant method. F is concave, so the sign of the difference tells on which side of the maximum s is, and a bracket keeps that
    /// safe.
    ///
    /// Concentric ellipsoids have F = 0 and no normal; then it is the zero vector.
    pub fn contact_function(&self) -> (f32, Vec3A) {
        let size = self.bounds;
        let a = [self.sigma[0] * (1.0 / size[0]), self.sigma[1] * (1.0 / size[1])];
        let (mut low, mut high) = (0.0f32, 1.0f32);
        let (mut s, mut last) = (0.5f32, None);
        let mut z = Vec3A::ZERO;
        for _ in 0..24 {
            z = inverse_times(a[0] * (1.0 - s) + a[1] * s, self.d);
            let q = [0, 1].map(|k| (z.dot(a[k] * z).max(0.0) / size[k]).sqrt());
            let excess = q[0] / (q[0] + q[1]) - s;
            if excess > 0.0 {
                low = s
            } else {
                high = s
            }
            let next = match last {
                Some((before, excess_before)) => s - excess * (s - before) / (excess - excess_before),
                None => s + excess,
            };
            let next = if next > low && next < high { next } else { (s + excess).clamp(0.5 * (low + s), 0.5 * (high + s)) };
            // F is flat at its maximum: its error is that of s, squared.
            let moves = excess.abs().max((next - s).abs()) > 1e-5 * s * (1.0 - s);
            if !moves {
                break;
            }
            last = Some((s, excess));
            s = next;
        }
        let f = s * (1.0 - s) / ((1.0 - s) * size[1] + s * size[0]) * self.d.dot(z);
        (f, z.normalize_or_zero())
    }

    /// Gap and outermost points along the unit vector `n`.
    pub(crate) fn along(&self, n: Vec3A) -> PairGap {
        self.scaled(self.look(n))
    }

    /// Distance or depth, from nothing known: begins at Perram & Wertheim's normal.
    ///
    /// The sign is exact whatever the depth. So is the depth of a shallow overlap; of a deep one, where several ways out may be equally short, it is that of a way out which is the shortest near it, and
    /// of ellipsoids that share their centre that along the thinnest way through both.
    pub fn contact(&self) -> PairGap {
        let (f, normal) = self.contact_function();
        // Deeper than half, another way may be shorter: along an axis of one of the two.
        if f > 0.25 {
            return self.contact_near(normal);
        }
        let mut best = self.look(if normal == Vec3A::ZERO { Vec3A::X } else { normal });
        for axes in &self.axes {
            for axis in [axes.x_axis, axes.y_axis, axes.z_axis] {
                let other = self.look(if axis.dot(self.d) < 0.0 { -axis } else { axis });
                if other.gap > best.gap {
                    best = other;
                }
            }
        }
        self.contact_near(best.n)
    }

    /// Distance or depth, from the unit vector `n` that was right a moment ago: climbs to the nearest maximum of the gap.
    ///
    /// Newton's method on the sphere. With pᵢ = Σᵢn/hᵢ the gap's gradient is d − p₁ − p₂, whose part across n is c, and its Hessian there −A with A = Σ (Σᵢ − pᵢpᵢᵀ)/hᵢ + g·1, so n ← n + A⁻¹c. Deep in the
    /// overlap, where g is very negative, A need not be positive: it is then lifted until it is. A step that does not climb is shortened.
    pub fn contact_near(&self, n: Vec3A) -> PairGap {
        let mut look = self.look(n);
        for _ in 0..12 {
            let n = look.n;
            let size = look.h[0] + look.h[1];
            let across = self.d - look.reach[0] - look.reach[1] - n * look.gap;
            let (u, v) = n.any_orthonormal_pair();
            let slope = [across.dot(u), across.dot(v)];
            let (mut uu, mut uv, mut vv) = (look.gap, 0.0, look.gap);
            for k in 0..2 {
                let (su, pu, pv) = (self.sigma[k] * u, look.reach[k].dot(u), look.reach[k].dot(v));
                let inverse = 1.0 / look.h[k];
                uu += (u.dot(su) - pu * pu) * inverse;
                uv += (v.dot(su) - pu * pv) * inverse;
                vv += (v.dot(self.sigma[k] * v) - pv * pv) * inverse;
            }
            let least = 0.5 * (uu + vv - ((uu - vv) * (uu - vv) + 4.0 * uv * uv).sqrt());
            let lift = (1e-3 * size - least).max(0.0);
            (uu, vv) = (uu + lift, vv + lift);
            let determinant = uu * vv - uv * uv;
            let step = [(vv * slope[0] - uv * slope[1]) / determinant, (uu * slope[1] - uv * slope[0]) / determinant];
            // What the step will gain, were the gap quadratic.
            let gain = 0.5 * (step[0] * slope[0] + step[1] * slope[1]);
            let climbs = gain > 1e-7 * size;
            if !climbs {
                break;
            }
            let mut step = (u * step[0] + v * step[1]).clamp_length_max(0.7);
            let mut next = self.look((n + step).normalize());
            for _ in 0..6 {
                if next.gap > look.gap {
                    break;
                }
                step *= 0.3;
                next = self.look((n + step).normalize());
            }
            let climbed = next.gap > look.gap;
            if !climbed {
                break;
            }
            look = next;
            if gain < 1e-5 * size && lift == 0.0 {
                break;
            }
        }
        self.scaled(look)
    }

    fn look(&self, n: Vec3A) -> Look {
        let s = self.sigma.map(|sigma| sigma * n);
        let h = s.map(|s| n.dot(s).max(0.0).sqrt());
        Look { n, gap: n.dot(self.d) - h[0] - h[1], h, reach: [s[0] / h[0], s[1] / h[1]] }
    }

    /// Back to metres. The second's outermost point is on its side of −n.
    fn scaled(&self, look: Look) -> PairGap {
        PairGap { gap: look.gap * self.scale, normal: look.n, reach: [look.reach[0] * self.scale, look.reach[1] * -self.scale] }
    }
}

/// Σ of an ellipsoid as its contact sees it.
fn shape(q: &Mat3A, radii: Vec3A) -> Mat3A {
    let radii = clamped(radii);
    let (a, b, c) = (q.x_axis * radii.x, q.y_axis * radii.y, q.z_axis * radii.z);
    Mat3A::from_cols(a * a.x + b * b.x + c * c.x, a * a.y + b * b.y + c * c.y, a * a.z + b * b.z + c * c.z)
}

/// How far an ellipsoid, as its contact sees it, reaches along the unit vector `n` \[m\].
#[inline]
pub(crate) fn thickness(e: &Ellipsoid, n: Vec3A) -> f32 {
    (clamped(e.radii) * (e.orientation.inverse() * n)).length()
}

/// Half axes as a contact sees them.
#[inline]
pub(crate) fn clamped(radii: Vec3A) -> Vec3A {
    radii.max(Vec3A::splat(FLATTEST * radii.max_element()))
}

/// G⁻¹·d for a symmetric G, by Cramer's rule.
#[inline]
fn inverse_times(g: Mat3A, d: Vec3A) -> Vec3A {
    let (r0, r1, r2) = (g.y_axis.cross(g.z_axis), g.z_axis.cross(g.x_axis), g.x_axis.cross(g.y_axis));
    Vec3A::new(r0.dot(d), r1.dot(d), r2.dot(d)) / g.x_axis.dot(r0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::quat_exp;
    use crate::testing::Random;
    use glam::{DMat3, DVec3};

    fn random_ellipsoid(random: &mut Random, size: f32) -> Ellipsoid {
        let radii = (Vec3A::splat(0.55) + random.vector() * 0.45) * size;
        Ellipsoid { radii, orientation: quat_exp(random.vector() * 3.0) }
    }

    /// The gap in `f64`, by nothing but its definition.
    fn gap(e: &[Ellipsoid; 2], d: DVec3, n: DVec3) -> f64 {
        let reach = |e: &Ellipsoid| {
            let q = DMat3::from_quat(e.orientation.as_dquat().normalize());
            (q.transpose() * n * clamped(e.radii).as_dvec3()).length()
        };
        n.dot(d) - reach(&e[0]) - reach(&e[1])
    }

    /// The greatest gap over all directions: looks everywhere, then around the best places in ever smaller steps.
    fn reference(e: &[Ellipsoid; 2], d: DVec3) -> f64 {
        let mut found: Vec<(f64, DVec3)> = (0..4000)
            .map(|i| {
                let z = 1.0 - 2.0 * (f64::from(i) + 0.5) / 4000.0;
                let (r, a) = ((1.0 - z * z).sqrt(), f64::from(i) * 2.399_963_229_728_653);
                let n = DVec3::new(r * libm::cos(a), r * libm::sin(a), z);
                (gap(e, d, n), n)
            })
            .collect();
        found.sort_by(|a, b| b.0.total_cmp(&a.0));
        found.truncate(12);
        found
            .into_iter()
            .map(|(mut best, mut n)| {
                let mut step = 0.04;
                while step > 1e-9 {
                    let (u, v) = n.any_orthonormal_pair();
                    let mut moved = false;
                    for k in 0..8 {
                        let a = f64::from(k) * core::f64::consts::FRAC_PI_4;
                        let m = (n + (u * libm::cos(a) + v * libm::sin(a)) * step).normalize();
                        let g = gap(e, d, m);
                        if g > best {
                            (best, n, moved) = (g, m, true);
                        }
                    }
                    if !moved {
                        step *= 0.5;
                    }
                }
                best
            })
            .fold(f64::NEG_INFINITY, f64::max)
    }

    #[test]
    fn spheres_are_as_the_formula_says() {
        let mut random = Random(5);
        for _ in 0..1000 {
            let [a, b] = [0.01 + random.signed().abs(), 0.01 + random.signed().abs()];
            let [e, f] = [a, b].map(|r| Ellipsoid { radii: Vec3A::splat(r), orientation: quat_exp(random.vector() * 3.0) });
            let d = random.vector() * 2.0;
            let pair = EllipsoidPair::new(&e, &f, d);
            let found = pair.contact();
            let (contact_function, normal) = pair.contact_function();
            // 1 − λ carries the rounding of 1: at 1:100 that is 6e-6 of it, and of F.
            assert!((contact_function.sqrt() * (a + b) - d.length()).abs() < 6e-6 * (a + b + d.length()));
            assert!((found.gap - (d.length() - a - b)).abs() < 1e-6 * (a + b + d.length()), "{} {}", found.gap, d.length() - a - b);
            assert!(normal.distance(d.normalize()) < 1e-5);
        }
    }

    /// Sizes from 1:1 to 1:100, distances from deep to apart.
    #[test]
    fn verdict_and_depth_are_those_of_the_reference() {
        let mut random = Random(11);
        let (mut apart, mut worst, mut worst_deep, mut others) = (0, 0.0f64, 0.0f64, 0);
        let count = 600;
        for k in 0..count {
            let ratio = [1.0, 0.3, 0.1, 0.01][k % 4];
            let e = [random_ellipsoid(&mut random, 1.0), random_ellipsoid(&mut random, ratio)];
            let d = random.vector().normalize() * (1.0 + ratio) * (0.1 + 1.2 * random.signed().abs());
            let exact = reference(&e, d.as_dvec3());
            let pair = EllipsoidPair::new(&e[0], &e[1], d);
            let found = pair.contact();
            let scale = f64::from(e[0].bound() + e[1].bound());
            if exact.abs() > 2e-6 * scale {
                assert_eq!(found.gap > 0.0, exact > 0.0, "{found:?} against {exact}");
                assert_eq!(pair.contact_function().0 > 1.0, exact > 0.0, "{exact}");
            }
            apart += usize::from(exact > 0.0);
            let error = (f64::from(found.gap) - exact).abs() / scale;
            if exact > -0.25 * f64::from(e[1].radii.min_element()) {
                worst = worst.max(error);
            } else {
                worst_deep = worst_deep.max(error);
                others += usize::from(error > 1e-3);
            }
        }
        // Of many deep overlaps a few leave by another way than the shortest.
        assert!(others < count / 50, "{others}");
        println!("{apart} of {count} apart; worst error {worst:.1e} shallow, {worst_deep:.1e} deep, {others} deep ones by another way out");
        assert!(apart > count / 5 && apart < count * 4 / 5);
        assert!(worst < 2e-6, "{worst}");
    }

    #[test]
    fn needles_flats_and_shared_centres_have_a_way_out() {
        let mut random = Random(23);
        for k in 0..2000 {
            let radii = [Vec3A::new(1.0, 1e-4, 1e-4), Vec3A::new(1.0, 1.0, 1e-5), Vec3A::new(0.3, 1.0, 0.01), Vec3A::splat(0.5)];
            let mut e = [0, 1].map(|j| Ellipsoid { radii: radii[(k >> (2 * j)) % 4], orientation: quat_exp(random.vector() * 3.0) });
            e[1].radii *= [1.0, 1e-2, 1e-3][k % 3];
            let thin = clamped(e[0].radii).min_element() + clamped(e[1].radii).min_element();
            let bound = e[0].bound() + e[1].bound();
            for d in [Vec3A::ZERO, random.vector() * 1e-6, random.vector() * 0.1, random.vector() * 2.0] {
                let found = EllipsoidPair::new(&e[0], &e[1], d).contact();
                assert!((found.normal.length() - 1.0).abs() < 1e-5);
                assert!(found.gap.is_finite() && found.gap > -bound * 1.001 && found.reach.iter().all(|r| r.is_finite()));
                if d == Vec3A::ZERO {
                    // Out through the thinnest side of the larger, at least.
                    assert!(
                        found.gap <= -thin * 0.999 && found.gap > -(clamped(e[0].radii).min_element() + e[1].bound()) * 1.001,
                        "{found:?}"
                    );
                }
                let way = d + found.normal * (-found.gap * (1.0 + 1e-4)).max(0.0) + found.normal * (1e-5 * bound);
                assert!(EllipsoidPair::new(&e[0], &e[1], way).contact_function().0 > 1.0, "as far as it is deep, and it is out: {found:?}");
            }
        }
    }

    /// From the normal of a moment ago it comes to the same as from nothing, in few looks.
    #[test]
    fn a_moving_pair_is_followed() {
        let mut random = Random(7);
        for _ in 0..300 {
            let e = [random_ellipsoid(&mut random, 1.0), random_ellipsoid(&mut random, 0.5)];
            let out = random.vector().normalize();
            let mut d = out * 2.0;
            let pair = |d: Vec3A| EllipsoidPair::new(&e[0], &e[1], d);
            d -= out * (pair(d).contact().gap * 1.05);
            let mut normal = pair(d).contact().normal;
            for _ in 0..10 {
                d += random.vector() * 0.02;
                let followed = pair(d).contact_near(normal);
                let fresh = pair(d).contact();
                if fresh.gap > -0.05 {
                    assert!((followed.gap - fresh.gap).abs() < 1e-5, "{} {}", followed.gap, fresh.gap);
                }
                normal = followed.normal;
            }
        }
    }

    #[test]
    fn turning_the_scene_turns_the_answer_and_swapping_the_two_turns_it_round() {
        let mut random = Random(3);
        for _ in 0..200 {
            let e = [random_ellipsoid(&mut random, 1.0), random_ellipsoid(&mut random, 0.4)];
            let d = random.vector() * 1.2;
            let q = quat_exp(random.vector() * 2.0);
            let turned = e.map(|e| Ellipsoid { orientation: q * e.orientation, ..e });
            let found = EllipsoidPair::new(&e[0], &e[1], d).contact();
            if found.gap < -0.3 {
                continue;
            }
            let there = EllipsoidPair::new(&turned[0], &turned[1], q * d).contact();
            let swapped = EllipsoidPair::new(&e[1], &e[0], -d).contact();
            assert!((found.gap - there.gap).abs() < 1e-5 && (q * found.normal).distance(there.normal) < 5e-3, "{found:?} {there:?}");
            assert!((found.gap - swapped.gap).abs() < 1e-5 && (found.normal + swapped.normal).length() < 5e-3);
        }
    }
}
