//! Eight lanes side by side: vectors and quaternions of which each component is a vector register, and how they are gathered from particles.
//!
//! Only operations that IEEE 754 rounds exactly are used, and no fused multiply-add: the same input gives the same bits whatever the instruction set, from plain scalars to AVX-512.

use core::ops::{Add, AddAssign, Mul, Neg, Sub, SubAssign};

use fearless_simd::prelude::*;
use fearless_simd::{f32x4, f32x8};
use glam::{Quat, Vec3A, Vec4};

/// How many lanes there are.
pub(crate) const LANES: usize = 8;

/// One number a lane, in memory.
pub(crate) type Lane = [f32; LANES];

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

impl<S: Simd> Vec3x8<S> {
    #[inline(always)]
    pub(crate) fn zero(simd: S) -> Self {
        let zero = f32x8::splat(simd, 0.0);
        Self { x: zero, y: zero, z: zero }
    }

    #[inline(always)]
    pub(crate) fn load(simd: S, from: &[Lane; 3]) -> Self {
        let [x, y, z] = from;
        Self { x: f32x8::load_array_ref(simd, x), y: f32x8::load_array_ref(simd, y), z: f32x8::load_array_ref(simd, z) }
    }

    #[inline(always)]
    pub(crate) fn store(self, to: &mut [Lane; 3]) {
        let [x, y, z] = to;
        self.x.store_array(x);
        self.y.store_array(y);
        self.z.store_array(z);
    }

    #[inline(always)]
    pub(crate) fn dot(self, other: Self) -> f32x8<S> {
        self.x * other.x + self.y * other.y + self.z * other.z
    }

    #[inline(always)]
    pub(crate) fn length_squared(self) -> f32x8<S> {
        self.dot(self)
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
    pub(crate) fn conjugate(self) -> Self {
        Self { x: -self.x, y: -self.y, z: -self.z, w: self.w }
    }

    #[inline(always)]
    pub(crate) fn normalize(self) -> Self {
        let length2 = self.x * self.x + self.y * self.y + self.z * self.z + self.w * self.w;
        let d = f32x8::splat(length2.token(), 1.0) / length2.sqrt();
        Self { x: self.x * d, y: self.y * d, z: self.z * d, w: self.w * d }
    }

    /// The product `self`·`other`.
    #[inline(always)]
    pub(crate) fn times(self, other: Self) -> Self {
        let (a, b) = (self, other);
        Self {
            x: a.w * b.x + a.x * b.w + (a.y * b.z - a.z * b.y),
            y: a.w * b.y + a.y * b.w + (a.z * b.x - a.x * b.z),
            z: a.w * b.z + a.z * b.w + (a.x * b.y - a.y * b.x),
            w: a.w * b.w - (a.x * b.x + a.y * b.y + a.z * b.z),
        }
    }

    /// This, turned by the small vector 2·`half`, and normalised: see [`turned`](crate::shape_matching::turned).
    #[inline(always)]
    pub(crate) fn turned(self, half: Vec3x8<S>) -> Self {
        let (a, b) = (half, self);
        Self {
            x: b.x + a.x * b.w + (a.y * b.z - a.z * b.y),
            y: b.y + a.y * b.w + (a.z * b.x - a.x * b.z),
            z: b.z + a.z * b.w + (a.x * b.y - a.y * b.x),
            w: b.w - (a.x * b.x + a.y * b.y + a.z * b.z),
        }
        .normalize()
    }

    #[inline(always)]
    pub(crate) fn matrix(self, simd: S) -> Mat3x8<S> {
        let one = f32x8::splat(simd, 1.0);
        let (x2, y2, z2) = (self.x + self.x, self.y + self.y, self.z + self.z);
        let (xx, yy, zz) = (self.x * x2, self.y * y2, self.z * z2);
        let (xy, xz, yz) = (self.x * y2, self.x * z2, self.y * z2);
        let (wx, wy, wz) = (self.w * x2, self.w * y2, self.w * z2);
        Mat3x8 {
            x: Vec3x8 { x: one - (yy + zz), y: xy + wz, z: xz - wy },
            y: Vec3x8 { x: xy - wz, y: one - (xx + zz), z: yz + wx },
            z: Vec3x8 { x: xz + wy, y: yz - wx, z: one - (xx + yy) },
        }
    }

    #[inline(always)]
    pub(crate) fn columns(self) -> [f32x8<S>; 4] {
        [self.x, self.y, self.z, self.w]
    }
}

impl<S: Simd> Mat3x8<S> {
    #[inline(always)]
    pub(crate) fn zero(simd: S) -> Self {
        let zero = Vec3x8::zero(simd);
        Self { x: zero, y: zero, z: zero }
    }

    /// The product with a vector.
    #[inline(always)]
    pub(crate) fn times(self, v: Vec3x8<S>) -> Vec3x8<S> {
        self.x * v.x + self.y * v.y + self.z * v.z
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

impl<S: Simd> SubAssign for Vec3x8<S> {
    #[inline(always)]
    fn sub_assign(&mut self, other: Self) {
        *self = *self - other;
    }
}

impl<S: Simd> Mul<f32x8<S>> for Vec3x8<S> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, factor: f32x8<S>) -> Self {
        Self { x: self.x * factor, y: self.y * factor, z: self.z * factor }
    }
}

impl<S: Simd> Neg for Vec3x8<S> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self { x: -self.x, y: -self.y, z: -self.z }
    }
}

/// `from[at[l]]` in lane l.
#[inline(always)]
pub(crate) fn gather<S: Simd>(simd: S, from: &[Vec3A], at: &[u32; LANES]) -> Vec3x8<S> {
    let row = |l: usize| padded(from[at[l] as usize]);
    let [x, y, z, _] = columns(simd, row);
    Vec3x8 { x, y, z }
}

/// `from[at[l]]` in lane l.
#[inline(always)]
pub(crate) fn gather_quats<S: Simd>(simd: S, from: &[Quat], at: &[u32; LANES]) -> Quatx8<S> {
    let row = |l: usize| Vec4::from(from[at[l] as usize]);
    let [x, y, z, w] = columns(simd, row);
    Quatx8 { x, y, z, w }
}

/// The vector with anything for a fourth component: as it stands in memory.
#[inline(always)]
fn padded(v: Vec3A) -> Vec4 {
    #[cfg(target_arch = "x86_64")]
    return Vec4::from(core::arch::x86_64::__m128::from(v));
    #[cfg(not(target_arch = "x86_64"))]
    v.extend(0.0)
}

/// Eight rows of four as four columns of eight.
#[inline(always)]
pub(crate) fn columns<S: Simd>(simd: S, row: impl Fn(usize) -> Vec4) -> [f32x8<S>; 4] {
    let load = |l: usize| f32x4::load_array(simd, row(l).to_array());
    let (xz, yw) = load(0).combine(load(1)).deinterleave(load(2).combine(load(3)));
    let (xz2, yw2) = load(4).combine(load(5)).deinterleave(load(6).combine(load(7)));
    let ((x, z), (y, w)) = (xz.deinterleave(xz2), yw.deinterleave(yw2));
    [x, y, z, w]
}

/// Eight rows of four in memory.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(align(32))]
pub(crate) struct Rows([Lane; 4]);

impl Rows {
    /// Four columns of eight as rows.
    #[inline(always)]
    pub(crate) fn store<S: Simd>(&mut self, columns: [f32x8<S>; 4]) {
        let [x, y, z, w] = columns;
        let ((xz, xz2), (yw, yw2)) = (x.interleave(z), y.interleave(w));
        let ((a, b), (c, d)) = (xz.interleave(yw), xz2.interleave(yw2));
        let [to_a, to_b, to_c, to_d] = &mut self.0;
        a.store_array(to_a);
        b.store_array(to_b);
        c.store_array(to_c);
        d.store_array(to_d);
    }

    #[inline(always)]
    pub(crate) fn row(&self, l: usize) -> Vec4 {
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
