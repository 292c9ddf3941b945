//! Exponential and logarithm of rotations, without platform maths.

use glam::{Quat, Vec3A};

/// The rotation by |θ| \[rad\] about θ.
///
/// exp(θ) = (θ·sin(|θ|/2)/|θ|, cos(|θ|/2)). Below half a radian the two series are cut where their next term is under 1e-8, so that small rotations neither divide by zero nor
/// call `sin`. θ = 0 gives the identity; a non-finite θ gives a non-finite quaternion.
#[inline]
pub fn quat_exp(theta: Vec3A) -> Quat {
    let angle2 = theta.length_squared();
    let (s, c) = if angle2 < 0.25 {
        // sin(a/2)/a and cos(a/2) in powers of a².
        let s = 0.5 - angle2 * (1.0 / 48.0 - angle2 * (1.0 / 3840.0 - angle2 * (1.0 / 645_120.0)));
        let c = 1.0 - angle2 * (1.0 / 8.0 - angle2 * (1.0 / 384.0 - angle2 * (1.0 / 46_080.0)));
        (s, c)
    } else {
        let angle = angle2.sqrt();
        (libm::sinf(0.5 * angle) / angle, libm::cosf(0.5 * angle))
    };
    let v = theta * s;
    Quat::from_xyzw(v.x, v.y, v.z, c)
}

/// The rotation vector of `q` along the shortest path, |θ| ≤ π \[rad\].
///
/// q and −q are the same rotation; the one with w ≥ 0 is taken. The angle is 2·atan2(|v|, w): in `f32` the usual 2·acos(w) returns zero below 3e-4 rad. `q` should have unit
/// length; rounding away from it does not matter because only the ratio |v|/w enters.
#[inline]
pub fn quat_log(q: Quat) -> Vec3A {
    let q = if q.w < 0.0 { -q } else { q };
    let v = Vec3A::new(q.x, q.y, q.z);
    let v2 = v.length_squared();
    let w2 = q.w * q.w;
    if v2 < 0.01 * w2 {
        // 2·atan(t)/t in powers of t² = |v|²/w².
        let t2 = v2 / w2;
        let ratio = 2.0 / q.w * (1.0 - t2 * (1.0 / 3.0 - t2 * (0.2 - t2 * (1.0 / 7.0))));
        v * ratio
    } else {
        let length = v2.sqrt();
        v * (2.0 * libm::atan2f(length, q.w) / length)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn log_inverts_exp_at_every_size_of_angle() {
        let axis = Vec3A::new(2.0, -3.0, 6.0) / 7.0;
        for angle in [0.0, 1e-7, 1e-4, 0.01, 0.19, 0.21, 0.49, 0.51, 1.0, 2.0, 3.0, 3.13] {
            let theta = axis * angle;
            let back = quat_log(quat_exp(theta));
            assert!(
                (back - theta).length() <= 1e-6 * angle.max(1e-3) + 1e-6 * (angle > 2.9) as u8 as f32,
                "{angle}: {back} against {theta}"
            );
        }
    }

    #[test]
    fn exp_has_unit_length() {
        for i in 0..100 {
            let q = quat_exp(Vec3A::new(0.03 * i as f32, 0.0, 0.01));
            assert!((q.length() - 1.0).abs() < 2e-7);
        }
    }

    #[test]
    fn log_takes_the_short_way_round() {
        let q = quat_exp(Vec3A::new(0.0, 0.3, 0.0));
        assert!((quat_log(-q) - Vec3A::new(0.0, 0.3, 0.0)).length() < 1e-6);
    }
}
