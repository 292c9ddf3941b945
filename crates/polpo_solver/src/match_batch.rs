//! Shape matching of eight groups at a time.
//!
//! The mathematics is that of [`match_shapes`](crate::match_shapes()) without pins, damping and multipliers, one group a lane. Differences to the scalar form are of rounding only: places are taken relative to the
//! group's first member, which is as good as relative to the centre of mass, so that one pass over the members gives both the centre and A:
//!
//! ```text
//! A = Σ_i [ R_i·B_i + m_i·d_i·x̄_iᵀ ] − (Σ m_i·d_i)(Σ m_i·x̄_i)ᵀ/M,   d_i = x_i − x_0
//! ```
//!
//! and logarithm and exponential of a turn are short series.
//!
//! Members that are turned by more than half a radian from their group, for which those do not hold, are turned one by one; so are lanes searched for by [`extract_rotation`] whose rotation is not found within a few of Newton's steps (where A is
//! singular, reflected or far turned). The search starts from the last rotation, turned on by the spin of the group's particle, which leaves one step to do where the body tumbles.

use fearless_simd::f32x8;
use fearless_simd::prelude::*;
use glam::{Mat3A, Quat};

use crate::batches::Slot;
use crate::lanes::{LANES, Lane, Lanes, Mat3x8, Quatx8, Rows, SMALL, Vec3x8, bits};
use crate::particles::Moving;
use crate::rotation::{DEFINITE, TOLERANCE};
use crate::shape_matching::{small_log, turned};
use crate::{Particles, extract_rotation};

/// After so many of Newton's steps a lane is left to the scalar search.
const STEPS: usize = 5;

/// Scratch for one slot.
#[derive(Clone, Debug, Default, PartialEq)]
#[repr(align(32))]
pub(crate) struct Gathered {
    /// Where its members are, relative to their groups' first \[m\], then their ways but for the excess.
    place: [Lane; 3],
    /// How they are turned.
    rotation: [Lane; 4],
    /// By how much they move \[m\] and turn \[rad\], and how they are turned then.
    way: Rows,
    angle: Rows,
    new: Rows,
}

/// What the groups of a batch share out.
pub(crate) struct BatchShare {
    /// Of the error, one a lane.
    pub(crate) stiffness: Lane,
    /// Bit l: lane l's group takes part.
    pub(crate) active: u8,
    /// Bit l: lane l's group is rigid.
    pub(crate) rigid: u8,
}

impl BatchShare {
    /// The same for all lanes.
    #[inline(always)]
    pub(crate) fn same(stiffness: f32) -> Self {
        Self { stiffness: [stiffness; LANES], active: u8::MAX, rigid: if stiffness >= 1.0 { u8::MAX } else { 0 } }
    }
}

/// Matches one batch, in a substep of `dt` \[s\]. `rotation` has the last rotation of each lane's group, `live` which lanes have a member in each slot; `scratch` is as long as `slots`.
#[inline(always)]
pub(crate) fn match_batch<S: Simd, const FUSED: bool>(
    lanes: Lanes<S, FUSED>,
    (slots, live): (&[Slot], &[u8]),
    rotation: &mut [Quat],
    scratch: &mut [Gathered],
    p: &mut Particles,
    share: &BatchShare,
    dt: f32,
) {
    let Some(first) = slots.first() else { return };
    let mut state = Moving::of(p);
    let origin = lanes.gather(state.position, &first.particle);
    let (mut mass, mut center, mut rest_center) = (lanes.splat(0.0), lanes.zero(), lanes.zero());
    let mut a = Mat3x8 { x: lanes.zero(), y: lanes.zero(), z: lanes.zero() };
    for (slot, to) in slots.iter().zip(&mut *scratch) {
        let m = lanes.load(&slot.mass);
        let r = lanes.load_vector(&slot.rest);
        let d = lanes.gather(state.position, &slot.particle) - origin;
        let q = lanes.gather_quats(state.rotation, &slot.particle);
        d.store(&mut to.place);
        q.store(&mut to.rotation);
        let [xx, yy, zz, xy, xz, yz] = &slot.moment;
        let (xx, yy, zz) = (lanes.load(xx), lanes.load(yy), lanes.load(zz));
        let (xy, xz, yz) = (lanes.load(xy), lanes.load(xz), lanes.load(yz));
        let turn = lanes.matrix(q);
        let md = d * m;
        let with = |sum, b| lanes.scale_add(md, b, sum);
        a.x = with(lanes.transform_add(turn, Vec3x8 { x: xx, y: xy, z: xz }, a.x), r.x);
        a.y = with(lanes.transform_add(turn, Vec3x8 { x: xy, y: yy, z: yz }, a.y), r.y);
        a.z = with(lanes.transform_add(turn, Vec3x8 { x: xz, y: yz, z: zz }, a.z), r.z);
        mass += m;
        center += md;
        rest_center = lanes.scale_add(r, m, rest_center);
    }
    let per_mass = lanes.splat(1.0) / mass;
    let rest_center = rest_center * per_mass;
    a.x = lanes.scale_add(center, -rest_center.x, a.x);
    a.y = lanes.scale_add(center, -rest_center.y, a.y);
    a.z = lanes.scale_add(center, -rest_center.z, a.z);
    let center = center * per_mass;

    let spin = lanes.gather(state.spin, &first.particle) * lanes.splat(0.5 * dt);
    let q = search(lanes, a, spin, rotation);
    let matrix = lanes.matrix(q);

    let stiffness = lanes.load(&share.stiffness);
    let mut excess = lanes.zero();
    for (slot, to) in slots.iter().zip(&mut *scratch) {
        let r = lanes.load_vector(&slot.rest) - rest_center;
        let d = lanes.load_vector(&to.place);
        let way = lanes.transform_add(matrix, r, center - d) * stiffness;
        way.store(&mut to.place);
        excess = lanes.scale_add(way, lanes.load(&slot.mass), excess);
    }
    let excess = excess * per_mass;

    let zero = lanes.splat(0.0);
    for (&live, to) in live.iter().zip(&mut *scratch) {
        to.way.store((lanes.load_vector(&to.place) - excess).columns());
        let old = lanes.load_quat(&to.rotation);
        let off = lanes.quotient(q, old);
        let v = off.vector();
        let s2 = lanes.length_squared(v);
        let near = s2.simd_lt(SMALL);
        // The short way round.
        let half = v * (lanes.half_log(s2) * off.w.simd_lt(zero).select(-stiffness, stiffness));
        to.angle.store((half + half).columns());
        to.new.store(lanes.product(lanes.half_exp(half), old).columns());
        let far = live & share.active & !(near.to_bitmask() as u8);
        if far != 0 {
            turn_far(to, far, rotation, &share.stiffness);
        }
    }

    let rate = 1.0 / dt;
    for ((slot, from), &live) in slots.iter().zip(&*scratch).zip(live) {
        let live = live & share.active;
        if live == u8::MAX {
            for l in 0..LANES {
                state.displace(slot.particle[l] as usize, from.way.vector(l), from.angle.vector(l), from.new.quat(l), rate);
            }
        } else {
            for l in bits(live) {
                state.displace(slot.particle[l] as usize, from.way.vector(l), from.angle.vector(l), from.new.quat(l), rate);
            }
        }
        if share.rigid != 0 {
            for l in bits(live & share.rigid) {
                let push = &mut state.rigid_push[slot.particle[l] as usize];
                push[0] += from.way.vector(l) * rate;
                push[1] += from.angle.vector(l) * rate;
            }
        }
    }
}

/// Turns the members in the lanes `far` one by one.
#[cold]
fn turn_far(to: &mut Gathered, far: u8, rotation: &[Quat], stiffness: &Lane) {
    for l in bits(far) {
        let old = Quat::from_array(to.rotation.map(|lane| lane[l]));
        let angle = small_log(rotation[l] * old.inverse()) * stiffness[l];
        to.angle.set(l, angle.extend(0.0));
        to.new.set(l, turned(old, angle).into());
    }
}

/// The rotational part of `a`, lane by lane, from the rotations found last and half the turn `spin` \[rad\] since: see [`extract_rotation`].
#[inline(always)]
fn search<S: Simd, const FUSED: bool>(lanes: Lanes<S, FUSED>, a: Mat3x8<S>, spin: Vec3x8<S>, rotation: &mut [Quat]) -> Quatx8<S> {
    let last = lanes.quats(|l| rotation.get(l).copied().unwrap_or(Quat::IDENTITY));
    let one = lanes.splat(1.0);
    let turn = |q, half: Vec3x8<S>| lanes.normalize(lanes.product(Quatx8 { x: half.x, y: half.y, z: half.z, w: one }, q));
    let mut q = turn(last, spin);
    let norm2 = lanes.length_squared(a.x) + lanes.length_squared(a.y) + lanes.length_squared(a.z);
    let scale = one / norm2.sqrt();
    let wanted = ((1u32 << rotation.len()) - 1) as u8;
    let mut safe = scale.simd_gt(0.0) & scale.simd_lt(f32::INFINITY);
    let n = Mat3x8 { x: a.x * scale, y: a.y * scale, z: a.z * scale };
    let mut found = 0u8;
    for _ in 0..STEPS {
        // M = A·Rᵀ: the columns of A times the rows of Rᵀ.
        let r = lanes.matrix(q);
        let times = |x, y, z| lanes.scale_add(n.z, z, lanes.scale_add(n.y, y, n.x * x));
        let (mx, my, mz) = (times(r.x.x, r.y.x, r.z.x), times(r.x.y, r.y.y, r.z.y), times(r.x.z, r.y.z, r.z.z));
        let g = Vec3x8 { x: my.z - mz.y, y: mz.x - mx.z, z: mx.y - my.x };
        let half = lanes.splat(-0.5);
        let (xx, yy, zz) = (my.y + mz.z, mx.x + mz.z, mx.x + my.y);
        let (xy, xz, yz) = ((my.x + mx.y) * half, (mz.x + mx.z) * half, (mz.y + my.z) * half);
        let minor = |a: f32x8<S>, b, c, d| lanes.sub_mul(a * b, c, d);
        let (c00, c01, c02) = (minor(yy, zz, yz, yz), minor(xz, yz, xy, zz), minor(xy, yz, xz, yy));
        let (c11, c12, c22) = (minor(xx, zz, xz, xz), minor(xy, xz, xx, yz), minor(xx, yy, xy, xy));
        let det = lanes.mul_add(xz, c02, lanes.mul_add(xy, c01, xx * c00));
        safe &= xx.simd_gt(0.0) & c22.simd_gt(0.0) & det.simd_gt(DEFINITE);
        let inverse =
            Mat3x8 { x: Vec3x8 { x: c00, y: c01, z: c02 }, y: Vec3x8 { x: c01, y: c11, z: c12 }, z: Vec3x8 { x: c02, y: c12, z: c22 } };
        let step = lanes.transform_add(inverse, g, lanes.zero()) * (lanes.splat(0.5) / det);
        let length2 = lanes.length_squared(step);
        safe &= length2.simd_lt(0.25);
        // Lanes that are not safe stay where they are, so that they cannot disturb what is asked of all.
        q = turn(q, step.only(safe));
        found = (safe & length2.simd_lt(0.25 * TOLERANCE * TOLERANCE)).to_bitmask() as u8;
        if (found | !(safe.to_bitmask() as u8)) & wanted == wanted {
            break;
        }
    }
    let mut new = Rows::default();
    new.store(q.columns());
    let astray = wanted & !found;
    if astray != 0 {
        let mut columns = [Rows::default(); 3];
        for (to, column) in columns.iter_mut().zip([a.x, a.y, a.z]) {
            to.store(column.columns());
        }
        search_astray(&columns, astray, rotation, &mut new);
        q = lanes.quats(|l| new.quat(l));
    }
    for (l, to) in rotation.iter_mut().enumerate() {
        *to = new.quat(l);
    }
    q
}

/// Searches for the rotations in the lanes `astray` one by one.
#[cold]
fn search_astray([x, y, z]: &[Rows; 3], astray: u8, rotation: &[Quat], new: &mut Rows) {
    for l in bits(astray) {
        let a = Mat3A::from_cols(x.vector(l), y.vector(l), z.vector(l));
        new.set(l, extract_rotation(a, rotation[l]).into());
    }
}
