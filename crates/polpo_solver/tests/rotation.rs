//! The rotation that shape matching extracts, against the singular value decomposition of another crate, in f64.

mod common;

use common::{Random, cases};
use glam::{Mat3A, Quat, Vec3A};
use nalgebra::{Matrix3, UnitQuaternion};
use polpo_solver::{extract_rotation, quat_exp};
use proptest::prelude::*;

/// What the decomposition A = U·Σ·Vᵀ says of the rotations nearest to A.
struct Reference {
    /// U·diag(1, 1, det UVᵀ)·Vᵀ.
    rotation: Matrix3<f64>,
    /// The greatest tr(RᵀA) of any rotation, σ1 + σ2 ± σ3.
    best: f64,
    /// σ2 ± σ3: how sharp the optimum is; 0 where it is not unique.
    gap: f64,
    norm: f64,
}

fn reference(a: &Matrix3<f64>) -> Reference {
    let svd = a.svd(true, true);
    let (u, vt) = (svd.u.expect("asked for"), svd.v_t.expect("asked for"));
    let sign = (u * vt).determinant().signum();
    // Singular values in descending order; the reflection, if there is one, goes to the smallest.
    let mut flip = Matrix3::identity();
    flip[(2, 2)] = sign;
    let s = svd.singular_values;
    Reference { rotation: u * flip * vt, best: s[0] + s[1] + sign * s[2], gap: s[1] + sign * s[2], norm: s.norm() }
}

fn wide(a: Mat3A) -> Matrix3<f64> {
    Matrix3::from_iterator(a.to_cols_array().map(f64::from))
}

fn wide_rotation(q: Quat) -> Matrix3<f64> {
    let q = nalgebra::Quaternion::new(f64::from(q.w), f64::from(q.x), f64::from(q.y), f64::from(q.z));
    UnitQuaternion::from_quaternion(q).to_rotation_matrix().into_inner()
}

/// What shape matching meets: full, flat, straight, empty, turned inside out, symmetric, and all but.
fn spectrum(random: &mut Random) -> [f32; 3] {
    let sign = if random.below(2) == 0 { 1.0 } else { -1.0 };
    let small = random.between(1e-8, 1e-2);
    match random.below(10) {
        0 => [1.0, random.unit(), random.unit() * sign],
        1 => [1.0, random.unit(), 0.0],
        2 => [1.0, 0.0, 0.0],
        3 => [1.0, 1.0, sign],
        4 => [1.0, small, small * sign],
        5 => [1.0, random.unit(), small * sign],
        6 => [1.0, 0.5, 0.5 * sign],
        7 => [1.0, 1.0, random.unit() * sign],
        8 => [1.0, 0.5, (0.5 - small) * sign],
        _ => [0.0, 0.0, 0.0],
    }
}

proptest! {
    #![proptest_config(cases(100_000))]

    #[test]
    fn is_that_of_the_decomposition(seed: u64) {
        let mut random = Random(seed);
        let [x, y, z] = spectrum(&mut random);
        let scale = random.between(1e-18, 1e18);
        let (left, right) = (Mat3A::from_quat(random.rotation()), Mat3A::from_quat(random.rotation()));
        let a = left * Mat3A::from_diagonal((Vec3A::new(x, y, z) * scale).into()) * right;
        let guess = random.rotation();
        let found = extract_rotation(a, guess);
        prop_assert!((found.length() - 1.0).abs() < 1e-6);
        let expected = reference(&wide(a));
        if expected.norm == 0.0 {
            prop_assert_eq!(found, guess);
            return Ok(());
        }
        let r = wide_rotation(found);
        // Near the optimum the objective is flat: an angle ε costs ½·gap·ε². What is left is the rounding of a product of matrices in f32.
        let missing = (expected.best - (r.transpose() * wide(a)).trace()) / expected.norm;
        // A gap below 1e-4 is one that the search takes for noise: it may leave the turn that it is about, worth twice the gap, to the guess.
        let gap = expected.gap / expected.norm;
        let noise = if gap < 1e-4 { 2.0 * gap } else { 0.0 };
        prop_assert!(missing < 1e-6 + noise, "tr(RᵀA) is {missing:.1e}·‖A‖ below the optimum; spectrum {x} {y} {z}");
        // The gradient is known to f32's rounding, 1e-7, and the curvature is the gap: that is how well any rotation in f32 can be known.
        if gap > 1e-4 {
            // ‖R − R'‖ = √8·sin(θ/2), which is exact for small angles as an arc cosine is not.
            let angle = 2.0 * ((r - expected.rotation).norm() / 8f64.sqrt()).min(1.0).asin();
            prop_assert!(angle < 1e-6 + 5e-7 / gap, "off by {angle:.1e} rad at a gap of {gap:.1e}; spectrum {x} {y} {z}");
        }
    }
}

proptest! {
    #![proptest_config(cases(20_000))]

    /// Of anything at all, entry by entry, also of noise and of entries that over- and underflow when squared: a rotation, or the guess.
    #[test]
    fn of_anything_is_a_rotation(entries in prop::array::uniform9(prop::num::f32::ANY), guess in prop::array::uniform3(-3.0f32..3.0)) {
        let guess = quat_exp(guess.into());
        let found = extract_rotation(Mat3A::from_cols_array(&entries), guess);
        prop_assert!((found.length() - 1.0).abs() < 1e-6, "{found}");
    }
}
