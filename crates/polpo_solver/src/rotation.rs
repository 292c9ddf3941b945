//! The rotation nearest to a matrix: Newton's method that avoids saddles, warm-started.

use glam::{Mat3A, Quat, Vec3A};

/// Below this length of the last step \[rad\] the answer is taken: the next one would be shorter than its square.
pub(crate) const TOLERANCE: f32 = 3e-4;
/// A Hessian of a matrix of unit norm, whose trace is at most 2·√3, with a determinant below this has an eigenvalue too close to zero for single precision.
pub(crate) const DEFINITE: f32 = 1e-5;
/// No step turns by more than about this \[rad\]: far from the optimum the quadratic model is not to be trusted.
const STEP_CAP: f32 = 1.0;
/// Eigenvalues of the Hessian are taken to be at least this, for a matrix of unit norm: a direction the matrix says nothing about is not turned in by noise.
const EIGENVALUE_FLOOR: f32 = 1e-4;
/// Where the Hessian is indefinite, a step shorter than this \[rad\] is one at a saddle or a minimum, and one of `STRIDE` is added to it.
const SADDLE: f32 = 0.1;
const STRIDE: f32 = 0.5;
const MAX_STEPS: usize = 24;

/// The rotation R that maximises tr(RᵀA), the rotational part of the polar decomposition of `a`, searched from `guess`.
///
/// With M = A·Rᵀ and R ← exp(w)·R, tr(RᵀA) = tr M + g·w − ½·wᵀH w + …, where g_k = M_ij − M_ji is the axial vector of M and H = tr(M)·I − ½(M + Mᵀ). Newton's step is w = H⁻¹g. At the
/// optimum M is the symmetric factor of the polar decomposition and H has the eigenvalues σ_i + σ_j ≥ 0; elsewhere H may be indefinite and the plain step would run to a saddle or a minimum, so
/// there the step uses the absolute eigenvalues of H, |H|⁻¹g, which always climbs.
///
/// `a` is normalised first, so neither its scale nor the unit of mass matters. Degenerate cases: for a reflected matrix (det < 0) the nearest *rotation* is found, never the reflection. Where the
/// matrix leaves the rotation about an axis open (rank one), the guess decides. Half a turn away from the optimum every gradient vanishes; the search then leaves along the most negative
/// eigenvector. A zero or non-finite matrix returns the guess.
pub fn extract_rotation(a: Mat3A, guess: Quat) -> Quat {
    let norm2 = a.x_axis.length_squared() + a.y_axis.length_squared() + a.z_axis.length_squared();
    let scale = 1.0 / norm2.sqrt();
    if !(scale.is_finite() && scale > 0.0) {
        // Under- or overflow of the square: once more, from entries near one.
        let largest = a.x_axis.abs().max(a.y_axis.abs()).max(a.z_axis.abs()).max_element();
        return if largest.is_finite() && largest > 0.0 {
            let b = Mat3A::from_cols(a.x_axis / largest, a.y_axis / largest, a.z_axis / largest);
            if b.is_finite() { extract_rotation(b, guess) } else { guess }
        } else {
            guess
        };
    }
    let a = a * scale;
    let mut q = guess;
    for _ in 0..MAX_STEPS {
        let m = a * Mat3A::from_quat(q).transpose();
        let g = Vec3A::new(m.y_axis.z - m.z_axis.y, m.z_axis.x - m.x_axis.z, m.x_axis.y - m.y_axis.x);
        let h = Symmetric {
            xx: m.y_axis.y + m.z_axis.z,
            yy: m.x_axis.x + m.z_axis.z,
            zz: m.x_axis.x + m.y_axis.y,
            xy: -0.5 * (m.y_axis.x + m.x_axis.y),
            xz: -0.5 * (m.z_axis.x + m.x_axis.z),
            yz: -0.5 * (m.z_axis.y + m.y_axis.z),
        };
        let step = h.solve_positive(g).unwrap_or_else(|| h.solve_absolute(g));
        let length2 = step.length_squared();
        let step = if length2 > STEP_CAP * STEP_CAP { step * (STEP_CAP / length2.sqrt()) } else { step };
        // (w/2, 1), normalised, turns by 2·atan(|w|/2): w up to third order, and shorter where w is long.
        let half = 0.5 * step;
        q = (Quat::from_xyzw(half.x, half.y, half.z, 1.0) * q).normalize();
        if length2 < TOLERANCE * TOLERANCE {
            break;
        }
    }
    q
}

/// A symmetric 3×3 matrix.
#[derive(Clone, Copy)]
struct Symmetric {
    xx: f32,
    yy: f32,
    zz: f32,
    xy: f32,
    xz: f32,
    yz: f32,
}

impl Symmetric {
    /// H⁻¹g by the adjugate, if H is safely positive definite (its leading minors are).
    #[inline]
    fn solve_positive(&self, g: Vec3A) -> Option<Vec3A> {
        let c00 = self.yy * self.zz - self.yz * self.yz;
        let c01 = self.xz * self.yz - self.xy * self.zz;
        let c02 = self.xy * self.yz - self.xz * self.yy;
        let det = self.xx * c00 + self.xy * c01 + self.xz * c02;
        let c11 = self.xx * self.zz - self.xz * self.xz;
        let c12 = self.xy * self.xz - self.xx * self.yz;
        let c22 = self.xx * self.yy - self.xy * self.xy;
        if self.xx > 0.0 && c22 > 0.0 && det > DEFINITE {
            let d = 1.0 / det;
            Some(Vec3A::new(c00 * g.x + c01 * g.y + c02 * g.z, c01 * g.x + c11 * g.y + c12 * g.z, c02 * g.x + c12 * g.y + c22 * g.z) * d)
        } else {
            None
        }
    }

    /// |H|⁻¹g, eigenvalues floored; near a stationary point that is no maximum, where that is short, a stride along the most negative eigenvector, uphill. (Left to itself the step only doubles from one
    /// to the next there, and the first ones are short enough to be taken for the end of the search.)
    #[cold]
    fn solve_absolute(&self, g: Vec3A) -> Vec3A {
        let (values, vectors) = self.eigen();
        let mut step = Vec3A::ZERO;
        for (value, vector) in values.into_iter().zip(vectors) {
            step += vector * (vector.dot(g) / value.abs().max(EIGENVALUE_FLOOR));
        }
        let lowest = (0..3).min_by(|&i, &j| values[i].total_cmp(&values[j])).unwrap_or(0);
        if values[lowest] < -EIGENVALUE_FLOOR && step.length_squared() < SADDLE * SADDLE {
            let uphill = if vectors[lowest].dot(g) < 0.0 { -STRIDE } else { STRIDE };
            step += vectors[lowest] * uphill;
        }
        step
    }

    /// Eigenvalues and eigenvectors by cyclic Jacobi rotations.
    fn eigen(&self) -> ([f32; 3], [Vec3A; 3]) {
        let mut a = [[self.xx, self.xy, self.xz], [self.xy, self.yy, self.yz], [self.xz, self.yz, self.zz]];
        let mut v = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0f32]];
        for _ in 0..6 {
            for (p, q) in [(0, 1), (0, 2), (1, 2)] {
                if a[p][q] == 0.0 {
                    continue;
                }
                let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
                let t = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
                let c = 1.0 / (t * t + 1.0).sqrt();
                let s = t * c;
                for row in &mut a {
                    let (x, y) = (row[p], row[q]);
                    row[p] = c * x - s * y;
                    row[q] = s * x + c * y;
                }
                let (x, y) = (a[p], a[q]);
                a[p] = [0, 1, 2].map(|k| c * x[k] - s * y[k]);
                a[q] = [0, 1, 2].map(|k| s * x[k] + c * y[k]);
                for row in &mut v {
                    let (x, y) = (row[p], row[q]);
                    row[p] = c * x - s * y;
                    row[q] = s * x + c * y;
                }
            }
        }
        ([a[0][0], a[1][1], a[2][2]], [0, 1, 2].map(|k| Vec3A::new(v[0][k], v[1][k], v[2][k])))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Random;
    use crate::{quat_exp, quat_log};

    fn angle(a: Quat, b: Quat) -> f32 {
        quat_log(a * b.inverse()).length()
    }

    fn diagonal(x: f32, y: f32, z: f32) -> Mat3A {
        Mat3A::from_cols(Vec3A::X * x, Vec3A::Y * y, Vec3A::Z * z)
    }

    /// A = R·U·diag(σ)·Uᵀ has the rotational part R by construction, for every spectrum with σ2 + σ3 > 0.
    #[test]
    fn finds_the_polar_rotation_from_any_start() {
        let mut random = Random(1);
        for spectrum in [[1.0, 1.0, 1.0], [1.0, 0.5, 0.2], [1.0, 0.1, 0.1], [1.0, 0.02, 0.01], [1.0, 1.0, 0.0], [1.0, 0.6, -0.3]] {
            for scale in [1e-20f32, 1e-6, 1.0, 1e6, 1e15] {
                for _ in 0..50 {
                    let r = quat_exp(random.vector() * 3.0);
                    let u = Mat3A::from_quat(quat_exp(random.vector() * 3.0));
                    let [x, y, z] = spectrum.map(|s: f32| s * scale);
                    let a = Mat3A::from_quat(r) * u * diagonal(x, y, z) * u.transpose();
                    let found = extract_rotation(a, quat_exp(random.vector() * 3.0));
                    let tolerance = 2e-6 / (spectrum[1] + spectrum[2]).min(1.0) + 2e-6;
                    assert!(angle(found, r) < tolerance, "{spectrum:?}·{scale}: off by {} rad", angle(found, r));
                }
            }
        }
    }

    #[test]
    fn leaves_the_stationary_points_half_a_turn_away() {
        for axis in [Vec3A::X, Vec3A::Y, Vec3A::Z, Vec3A::new(0.6, 0.0, 0.8)] {
            // Also when it is all but there, where the gradient is small and not zero.
            for off in [0.0, 1e-6, 1e-5, 3e-5, 1e-4, 3e-4, 1e-3] {
                let half_turn = quat_exp(Vec3A::new(0.5, -1.0, 0.8) * off) * Quat::from_xyzw(axis.x, axis.y, axis.z, 0.0);
                let found = extract_rotation(diagonal(1.0, 0.7, 0.4), half_turn);
                assert!(angle(found, Quat::IDENTITY) < 1e-5, "{axis}, {off} rad off: {found}");
            }
        }
    }

    #[test]
    fn an_open_axis_keeps_the_guess() {
        // Rank one: only the image of x is known; the turn about it is the guess's.
        let guess = quat_exp(Vec3A::X * 0.7);
        let found = extract_rotation(diagonal(1.0, 0.0, 0.0), guess);
        assert!(angle(found, guess) < 1e-5);
    }

    #[test]
    fn nonsense_returns_the_guess() {
        let guess = quat_exp(Vec3A::new(0.1, 0.2, 0.3));
        for a in [Mat3A::ZERO, diagonal(f32::NAN, 1.0, 1.0), diagonal(f32::INFINITY, 1.0, 1.0)] {
            assert_eq!(extract_rotation(a, guess), guess);
        }
    }
}
