//! Eight lanes side by side: vectors and quaternions of which each component is a vector register, and how they are gathered from particles.

use core::ops::{Add, AddAssign, Mul, Sub};

use fearless_simd::prelude::*;
use fearless_simd::{f32x4, f32x8, mask32x8};
use glam::{Quat, Vec3A, Vec4};

/// How many lanes there are.
pub(crate) const LANES: usize = 8;

/// One number a lane, in memory.
pub(crate) type Lane = [f32; LANES];

/// Below this square of the sine of half an angle, which is then below half a radian, [`Lanes::half_log`] and [`Lanes::half_exp`] hold.
pub(crate) const SMALL: f32 = 1.0 / 16.0;

/// The instructions to compute with, and the arithmetic that depends on how they round.
///
/// All other operations round as IEEE 754 says, on every processor alike. A multiply-add does too unless it is `FUSED` and the processor can do it in one; then it rounds once, and the result differs in the last bit from
/// that of a processor that cannot.
#[derive(Clone, Copy)]
pub(crate) struct Lanes<S: Simd, const FUSED: bool>(pub(crate) S);

/// A vector a lane.
#[derive(Clone, Copy)]
pub(crate) struct Vec3x8<S: Simd> {
    pub(crate) x: f32x8<S>,
    pub(crate) y: f32x8<S>,
    pub(crate) z: f32x8<S>,
}

/// A quaternion a lane.
#[derive(Clone, Copy)]
pub(crate) struct Quatx8<S: Simd> {
    pub(crate) x: f32x8<S>,
    pub(crate) y: f32x8<S>,
    pub(crate) z: f32x8<S>,
    pub(crate) w: f32x8<S>,
}

/// A matrix a lane, by columns.
#[derive(Clone, Copy)]
pub(crate) struct Mat3x8<S: Simd> {
    pub(crate) x: Vec3x8<S>,
    pub(crate) y: Vec3x8<S>,
    pub(crate) z: Vec3x8<S>,
}

impl<S: Simd, const FUSED: bool> Lanes<S, FUSED> {
    #[inline(always)]
    pub(crate) fn splat(self, value: f32) -> f32x8<S> {
        f32x8::splat(self.0, value)
    }

    #[inline(always)]
    pub(crate) fn load(self, from: &Lane) -> f32x8<S> {
        f32x8::load_array_ref(self.0, from)
    }

    #[inline(always)]
    pub(crate) fn load_vector(self, [x, y, z]: &[Lane; 3]) -> Vec3x8<S> {
        Vec3x8 { x: self.load(x), y: self.load(y), z: self.load(z) }
    }

    #[inline(always)]
    pub(crate) fn load_quat(self, [x, y, z, w]: &[Lane; 4]) -> Quatx8<S> {
        Quatx8 { x: self.load(x), y: self.load(y), z: self.load(z), w: self.load(w) }
    }

    #[inline(always)]
    pub(crate) fn zero(self) -> Vec3x8<S> {
        let zero = self.splat(0.0);
        Vec3x8 { x: zero, y: zero, z: zero }
    }

    /// a·b + c
    #[inline(always)]
    pub(crate) fn mul_add(self, a: f32x8<S>, b: f32x8<S>, c: f32x8<S>) -> f32x8<S> {
        if FUSED { a.mul_add(b, c) } else { a * b + c }
    }

    /// c − a·b
    #[inline(always)]
    pub(crate) fn sub_mul(self, c: f32x8<S>, a: f32x8<S>, b: f32x8<S>) -> f32x8<S> {
        if FUSED { (-a).mul_add(b, c) } else { c - a * b }
    }

    /// The smaller of the two; b if either is not a number.
    #[inline(always)]
    pub(crate) fn min(self, a: f32x8<S>, b: f32x8<S>) -> f32x8<S> {
        a.simd_lt(b).select(a, b)
    }

    /// The larger of the two; b if either is not a number.
    #[inline(always)]
    pub(crate) fn max(self, a: f32x8<S>, b: f32x8<S>) -> f32x8<S> {
        a.simd_gt(b).select(a, b)
    }

    /// v·k + c
    #[inline(always)]
    pub(crate) fn scale_add(self, v: Vec3x8<S>, k: f32x8<S>, c: Vec3x8<S>) -> Vec3x8<S> {
        Vec3x8 { x: self.mul_add(v.x, k, c.x), y: self.mul_add(v.y, k, c.y), z: self.mul_add(v.z, k, c.z) }
    }

    #[inline(always)]
    pub(crate) fn dot(self, a: Vec3x8<S>, b: Vec3x8<S>) -> f32x8<S> {
        self.mul_add(a.z, b.z, self.mul_add(a.y, b.y, a.x * b.x))
    }

    #[inline(always)]
    pub(crate) fn length_squared(self, a: Vec3x8<S>) -> f32x8<S> {
        self.dot(a, a)
    }

    /// The matrix times a vector, plus another.
    #[inline(always)]
    pub(crate) fn transform_add(self, m: Mat3x8<S>, v: Vec3x8<S>, c: Vec3x8<S>) -> Vec3x8<S> {
        self.scale_add(m.z, v.z, self.scale_add(m.y, v.y, self.scale_add(m.x, v.x, c)))
    }

    /// The matrix' transpose times a vector.
    #[inline(always)]
    pub(crate) fn transpose_times(self, m: Mat3x8<S>, v: Vec3x8<S>) -> Vec3x8<S> {
        Vec3x8 { x: self.dot(m.x, v), y: self.dot(m.y, v), z: self.dot(m.z, v) }
    }

    /// The product a·b.
    #[inline(always)]
    pub(crate) fn product(self, a: Quatx8<S>, b: Quatx8<S>) -> Quatx8<S> {
        Quatx8 {
            x: self.sub_mul(self.mul_add(a.y, b.z, self.mul_add(a.x, b.w, a.w * b.x)), a.z, b.y),
            y: self.sub_mul(self.mul_add(a.z, b.x, self.mul_add(a.y, b.w, a.w * b.y)), a.x, b.z),
            z: self.sub_mul(self.mul_add(a.x, b.y, self.mul_add(a.z, b.w, a.w * b.z)), a.y, b.x),
            w: self.sub_mul(self.sub_mul(self.sub_mul(a.w * b.w, a.x, b.x), a.y, b.y), a.z, b.z),
        }
    }

    /// The product a·b⁻¹ of unit quaternions.
    #[inline(always)]
    pub(crate) fn quotient(self, a: Quatx8<S>, b: Quatx8<S>) -> Quatx8<S> {
        Quatx8 {
            x: self.sub_mul(self.mul_add(a.z, b.y, self.sub_mul(a.x * b.w, a.w, b.x)), a.y, b.z),
            y: self.sub_mul(self.mul_add(a.x, b.z, self.sub_mul(a.y * b.w, a.w, b.y)), a.z, b.x),
            z: self.sub_mul(self.mul_add(a.y, b.x, self.sub_mul(a.z * b.w, a.w, b.z)), a.x, b.y),
            w: self.mul_add(a.z, b.z, self.mul_add(a.y, b.y, self.mul_add(a.x, b.x, a.w * b.w))),
        }
    }

    #[inline(always)]
    pub(crate) fn normalize(self, q: Quatx8<S>) -> Quatx8<S> {
        let length2 = self.mul_add(q.w, q.w, self.length_squared(q.vector()));
        let d = self.splat(1.0) / length2.sqrt();
        Quatx8 { x: q.x * d, y: q.y * d, z: q.z * d, w: q.w * d }
    }

    #[inline(always)]
    pub(crate) fn matrix(self, q: Quatx8<S>) -> Mat3x8<S> {
        let one = self.splat(1.0);
        let (x2, y2, z2) = (q.x + q.x, q.y + q.y, q.z + q.z);
        let (wx, wy, wz) = (q.w * x2, q.w * y2, q.w * z2);
        let (yy, xx) = (self.sub_mul(one, q.y, y2), q.x * x2);
        Mat3x8 {
            x: Vec3x8 { x: self.sub_mul(yy, q.z, z2), y: self.mul_add(q.x, y2, wz), z: self.mul_add(q.x, z2, -wy) },
            y: Vec3x8 { x: self.mul_add(q.x, y2, -wz), y: self.sub_mul(one - xx, q.z, z2), z: self.mul_add(q.y, z2, wx) },
            z: Vec3x8 { x: self.mul_add(q.x, z2, wy), y: self.mul_add(q.y, z2, -wx), z: yy - xx },
        }
    }

    /// asin(s)/s for the square of s, below [`SMALL`]: what takes the vector part of a unit quaternion to half its rotation vector.
    ///
    /// 1 + s²/6 + 3s⁴/40 + 5s⁶/112 + …, cut where the next term is 5e-7.
    #[inline(always)]
    pub(crate) fn half_log(self, s2: f32x8<S>) -> f32x8<S> {
        let series = self.mul_add(s2, self.splat(5.0 / 112.0), self.splat(0.075));
        self.mul_add(s2, self.mul_add(s2, series, self.splat(1.0 / 6.0)), self.splat(1.0))
    }

    /// The unit quaternion that turns by twice `half` \[rad\], of which the square is below [`SMALL`].
    ///
    /// (h·(1 − |h|²/6 + |h|⁴/120 − …), 1 − |h|²/2 + |h|⁴/24 − |h|⁶/720 + …), cut where the next term is 5e-8.
    #[inline(always)]
    pub(crate) fn half_exp(self, half: Vec3x8<S>) -> Quatx8<S> {
        let h2 = self.length_squared(half);
        let one = self.splat(1.0);
        let sine = self.mul_add(h2, self.mul_add(h2, self.splat(1.0 / 120.0), self.splat(-1.0 / 6.0)), one);
        let cosine = self.mul_add(h2, self.splat(-1.0 / 720.0), self.splat(1.0 / 24.0));
        let cosine = self.mul_add(h2, self.mul_add(h2, cosine, self.splat(-0.5)), one);
        Quatx8 { x: half.x * sine, y: half.y * sine, z: half.z * sine, w: cosine }
    }

    #[inline(always)]
    pub(crate) fn vectors(self, vector: impl Fn(usize) -> Vec3A) -> Vec3x8<S> {
        let [x, y, z, _] = self.columns(|l| padded(vector(l)));
        Vec3x8 { x, y, z }
    }

    #[inline(always)]
    pub(crate) fn cross(self, a: Vec3x8<S>, b: Vec3x8<S>) -> Vec3x8<S> {
        Vec3x8 { x: self.sub_mul(a.y * b.z, a.z, b.y), y: self.sub_mul(a.z * b.x, a.x, b.z), z: self.sub_mul(a.x * b.y, a.y, b.x) }
    }

    /// All lanes added up, by halves.
    #[inline(always)]
    pub(crate) fn sum(self, v: f32x8<S>) -> f32 {
        let [a, b, c, d, e, f, g, h] = Lane::from(v);
        ((a + e) + (c + g)) + ((b + f) + (d + h))
    }

    #[inline(always)]
    pub(crate) fn sum_vector(self, v: Vec3x8<S>) -> Vec3A {
        Vec3A::new(self.sum(v.x), self.sum(v.y), self.sum(v.z))
    }

    /// `from[at[l]]` in lane l.
    #[inline(always)]
    pub(crate) fn gather(self, from: &[Vec3A], at: &[u32; LANES]) -> Vec3x8<S> {
        self.vectors(|l| from[at[l] as usize])
    }

    /// `from[at[l]]` in lane l.
    #[inline(always)]
    pub(crate) fn gather_quats(self, from: &[Quat], at: &[u32; LANES]) -> Quatx8<S> {
        self.quats(|l| from[at[l] as usize])
    }

    /// `from[at[l]]` in lane l.
    #[inline(always)]
    pub(crate) fn gather_numbers(self, from: &[f32], at: &[u32; LANES]) -> f32x8<S> {
        let n = |l: usize| from[at[l] as usize];
        self.load(&[n(0), n(1), n(2), n(3), n(4), n(5), n(6), n(7)])
    }

    #[inline(always)]
    pub(crate) fn quats(self, quat: impl Fn(usize) -> Quat) -> Quatx8<S> {
        let [x, y, z, w] = self.columns(|l| quat(l).into());
        Quatx8 { x, y, z, w }
    }

    /// Eight rows of four as four columns of eight.
    #[inline(always)]
    fn columns(self, row: impl Fn(usize) -> Vec4) -> [f32x8<S>; 4] {
        let load = |l: usize| f32x4::load_array(self.0, row(l).to_array());
        let (xz, yw) = load(0).combine(load(1)).deinterleave(load(2).combine(load(3)));
        let (xz2, yw2) = load(4).combine(load(5)).deinterleave(load(6).combine(load(7)));
        let ((x, z), (y, w)) = (xz.deinterleave(xz2), yw.deinterleave(yw2));
        [x, y, z, w]
    }
}

/// The vector with anything for a fourth component: as it stands in memory.
#[inline(always)]
fn padded(v: Vec3A) -> Vec4 {
    #[cfg(target_arch = "x86_64")]
    return Vec4::from(core::arch::x86_64::__m128::from(v));
    #[cfg(not(target_arch = "x86_64"))]
    v.extend(0.0)
}

impl<S: Simd> Vec3x8<S> {
    #[inline(always)]
    pub(crate) fn store(self, [x, y, z]: &mut [Lane; 3]) {
        self.x.store_array(x);
        self.y.store_array(y);
        self.z.store_array(z);
    }

    /// This where `mask` says so, `other` elsewhere.
    #[inline(always)]
    pub(crate) fn or(self, mask: mask32x8<S>, other: Self) -> Self {
        Self { x: mask.select(self.x, other.x), y: mask.select(self.y, other.y), z: mask.select(self.z, other.z) }
    }

    /// The largest of the three's absolute values.
    #[inline(always)]
    pub(crate) fn largest(self) -> f32x8<S> {
        let (x, y, z) = (self.x.abs(), self.y.abs(), self.z.abs());
        let xy = x.simd_gt(y).select(x, y);
        xy.simd_gt(z).select(xy, z)
    }

    /// Where `mask` says so, zero elsewhere.
    #[inline(always)]
    pub(crate) fn only(self, mask: mask32x8<S>) -> Self {
        let zero = f32x8::splat(self.x.token(), 0.0);
        Self { x: mask.select(self.x, zero), y: mask.select(self.y, zero), z: mask.select(self.z, zero) }
    }

    /// As columns, of which the fourth is anything.
    #[inline(always)]
    pub(crate) fn columns(self) -> [f32x8<S>; 4] {
        [self.x, self.y, self.z, self.z]
    }
}

impl<S: Simd> Quatx8<S> {
    #[inline(always)]
    pub(crate) fn vector(self) -> Vec3x8<S> {
        Vec3x8 { x: self.x, y: self.y, z: self.z }
    }

    #[inline(always)]
    pub(crate) fn columns(self) -> [f32x8<S>; 4] {
        [self.x, self.y, self.z, self.w]
    }

    #[inline(always)]
    pub(crate) fn store(self, to: &mut [Lane; 4]) {
        for (to, column) in to.iter_mut().zip(self.columns()) {
            column.store_array(to);
        }
    }
}

impl<S: Simd> Add for Vec3x8<S> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self { x: self.x + other.x, y: self.y + other.y, z: self.z + other.z }
    }
}

impl<S: Simd> AddAssign for Vec3x8<S> {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl<S: Simd> Sub for Vec3x8<S> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self { x: self.x - other.x, y: self.y - other.y, z: self.z - other.z }
    }
}

impl<S: Simd> Mul<f32x8<S>> for Vec3x8<S> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, factor: f32x8<S>) -> Self {
        Self { x: self.x * factor, y: self.y * factor, z: self.z * factor }
    }
}

/// Up to eight of `from`, made up with zeros.
#[inline(always)]
pub(crate) fn filled(from: &[f32]) -> Lane {
    match from.first_chunk() {
        Some(all) => *all,
        None => core::array::from_fn(|l| from.get(l).copied().unwrap_or(0.0)),
    }
}

/// A slice by eights; the last is made up with zeros.
pub(crate) struct Eights<'a, T> {
    full: &'a [[T; LANES]],
    last: [T; LANES],
}

impl<'a, T: Copy + Default> Eights<'a, T> {
    #[inline(always)]
    pub(crate) fn of(from: &'a [T]) -> Self {
        let (full, rest) = from.as_chunks();
        let mut last = [T::default(); LANES];
        last[..rest.len()].copy_from_slice(rest);
        Self { full, last }
    }

    #[inline(always)]
    pub(crate) fn get(&self, k: usize) -> &[T; LANES] {
        self.full.get(k).unwrap_or(&self.last)
    }
}

/// The two ends of up to eight `pairs`, in lanes; a lane without a pair repeats the first.
#[inline(always)]
pub(crate) fn ends(pairs: &[[u32; 2]]) -> [[u32; LANES]; 2] {
    let end = |k: usize| core::array::from_fn(|l| pairs.get(l).unwrap_or(&pairs[0])[k]);
    [end(0), end(1)]
}

/// Runs `$run` with `$lanes` of the instructions of `$level`, whose multiply-adds are fused unless the result has to be deterministic.
macro_rules! in_lanes {
    ($level:expr, $deterministic:expr, $lanes:ident => $run:expr) => {
        if $deterministic {
            fearless_simd::dispatch!($level, simd => {
                let $lanes = crate::lanes::Lanes::<_, false>(simd);
                $run
            })
        } else {
            fearless_simd::dispatch!($level, simd => {
                let $lanes = crate::lanes::Lanes::<_, true>(simd);
                $run
            })
        }
    };
}
pub(crate) use in_lanes;

/// Which bits are set.
#[inline(always)]
pub(crate) fn bits(mask: u8) -> impl Iterator<Item = usize> {
    (0..LANES).filter(move |l| mask >> l & 1 != 0)
}

/// Eight rows of four, in memory.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(align(32))]
pub(crate) struct Rows([Lane; 4]);

impl Rows {
    /// Four columns of eight as rows.
    #[inline(always)]
    pub(crate) fn store<S: Simd>(&mut self, [x, y, z, w]: [f32x8<S>; 4]) {
        let ((xz, xz2), (yw, yw2)) = (x.interleave(z), y.interleave(w));
        let ((a, b), (c, d)) = (xz.interleave(yw), xz2.interleave(yw2));
        let [to_a, to_b, to_c, to_d] = &mut self.0;
        a.store_array(to_a);
        b.store_array(to_b);
        c.store_array(to_c);
        d.store_array(to_d);
    }

    #[inline(always)]
    fn row(&self, l: usize) -> Vec4 {
        Vec4::from_slice(&self.0[l / 2][l % 2 * 4..])
    }

    #[inline(always)]
    pub(crate) fn vector(&self, l: usize) -> Vec3A {
        Vec3A::from_vec4(self.row(l))
    }

    #[inline(always)]
    pub(crate) fn quat(&self, l: usize) -> Quat {
        Quat::from_vec4(self.row(l))
    }

    #[inline(always)]
    pub(crate) fn set(&mut self, l: usize, row: Vec4) {
        self.0[l / 2][l % 2 * 4..][..4].copy_from_slice(&row.to_array());
    }
}
