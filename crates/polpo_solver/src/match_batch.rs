//! Shape matching of eight groups at a time.
//!
//! The mathematics is that of [`match_shapes`](crate::match_shapes()) without pins, damping and multipliers, one group a lane. Differences to the scalar form are of rounding only: places are taken relative to the
//! group's first member, which is as good as relative to the centre of mass, so that one pass over the members gives both the centre and A:
//!
//! ```text
//! A = Σ_i [ R_i·B_i + m_i·d_i·x̄_iᵀ ] − (Σ m_i·d_i)(Σ m_i·x̄_i)ᵀ/M,   d_i = x_i − x_0
//! ```
//!
//! Lanes whose rotation is not found within a few of Newton's steps from the last one (where A is singular, reflected or far turned) are searched for one by one, by [`extract_rotation`].

use fearless_simd::f32x8;
use fearless_simd::prelude::*;
use glam::{Mat3A, Quat, Vec3A};

use crate::batches::Slot;
use crate::lanes::{LANES, Lane, Mat3x8, Quatx8, Rows, Vec3x8, columns as columns_of, gather, gather_quats};
use crate::rotation::{DEFINITE, TOLERANCE};
use crate::shape_matching::{small_log, turned};
use crate::{Particles, extract_rotation};

/// After so many of Newton's steps a lane is left to the scalar search.
const STEPS: usize = 5;
/// Below this square of an angle \[rad²\], or of the sine of half of one, the short forms of [`small_log`] and [`turned`] hold.
const SMALL: f32 = 0.01;

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

/// Matches one batch. `rotation` has the last rotation of each lane's group, `live` which lanes have a member in each slot; `scratch` is as long as `slots`.
#[inline(always)]
pub(crate) fn match_batch<S: Simd>(
    simd: S,
    (slots, live): (&[Slot], &[u8]),
    rotation: &mut [Quat],
    scratch: &mut [Gathered],
    p: &mut Particles,
    share: &BatchShare,
    rate: f32,
) {
    let Some(first) = slots.first() else { return };
    let mut state = State::of(p);
    let origin = gather(simd, state.position, &first.particle);
    let (mut mass, mut center, mut rest_center) = (f32x8::splat(simd, 0.0), Vec3x8::zero(simd), Vec3x8::zero(simd));
    let mut a = Mat3x8::zero(simd);
    for (slot, to) in slots.iter().zip(&mut *scratch) {
        let m = f32x8::load_array_ref(simd, &slot.mass);
        let r = Vec3x8::load(simd, &slot.rest);
        let d = gather(simd, state.position, &slot.particle) - origin;
        let q = gather_quats(simd, state.rotation, &slot.particle);
        d.store(&mut to.place);
        store_quat(q, &mut to.rotation);
        let [xx, yy, zz, xy, xz, yz] = &slot.moment;
        let load = |lane: &Lane| f32x8::load_array_ref(simd, lane);
        let (xx, yy, zz, xy, xz, yz) = (load(xx), load(yy), load(zz), load(xy), load(xz), load(yz));
        let turn = q.matrix(simd);
        let md = d * m;
        a.x += turn.x * xx + turn.y * xy + turn.z * xz + md * r.x;
        a.y += turn.x * xy + turn.y * yy + turn.z * yz + md * r.y;
        a.z += turn.x * xz + turn.y * yz + turn.z * zz + md * r.z;
        mass += m;
        center += md;
        rest_center += r * m;
    }
    let per_mass = f32x8::splat(simd, 1.0) / mass;
    let rest_center = rest_center * per_mass;
    a.x -= center * rest_center.x;
    a.y -= center * rest_center.y;
    a.z -= center * rest_center.z;
    let center = center * per_mass;

    let q = search(simd, a, rotation);
    let matrix = q.matrix(simd);

    let stiffness = f32x8::load_array_ref(simd, &share.stiffness);
    let mut excess = Vec3x8::zero(simd);
    for (slot, to) in slots.iter().zip(&mut *scratch) {
        let r = Vec3x8::load(simd, &slot.rest);
        let d = Vec3x8::load(simd, &to.place);
        let way = (matrix.times(r - rest_center) - (d - center)) * stiffness;
        way.store(&mut to.place);
        excess += way * f32x8::load_array_ref(simd, &slot.mass);
    }
    let excess = excess * per_mass;

    for (&live, to) in live.iter().zip(&mut *scratch) {
        let way = Vec3x8::load(simd, &to.place) - excess;
        let old = load_quat(simd, &to.rotation);
        let off = q.times(old.conjugate());
        let sign = off.w.simd_lt(0.0).select(f32x8::splat(simd, -1.0), f32x8::splat(simd, 1.0));
        let v = off.vector() * sign;
        let s2 = v.length_squared();
        let angle = v * ((((s2 * (5.0 / 56.0) + 0.15) * s2 + (1.0 / 3.0)) * s2 + 2.0) * stiffness);
        let small = s2.simd_lt(SMALL) & angle.length_squared().simd_lt(SMALL);
        to.way.store(way.columns());
        to.angle.store(angle.columns());
        to.new.store(old.turned(angle * f32x8::splat(simd, 0.5)).columns());
        let far = live & share.active & !(small.to_bitmask() as u8);
        if far != 0 {
            for l in lanes_of(far) {
                let old = Quat::from_array(to.rotation.map(|lane| lane[l]));
                let angle = small_log(rotation[l] * old.inverse()) * share.stiffness[l];
                to.angle.set(l, angle.extend(0.0));
                to.new.set(l, turned(old, angle).into());
            }
        }
    }

    for ((slot, from), &live) in slots.iter().zip(&*scratch).zip(live) {
        let live = live & share.active;
        if live == u8::MAX {
            for l in 0..LANES {
                state.displace(slot.particle[l] as usize, from, l, rate);
            }
        } else {
            for l in lanes_of(live) {
                state.displace(slot.particle[l] as usize, from, l, rate);
            }
        }
        if share.rigid != 0 {
            for l in lanes_of(live & share.rigid) {
                let push = &mut state.rigid_push[slot.particle[l] as usize];
                push[0] += from.way.vector(l) * rate;
                push[1] += from.angle.vector(l) * rate;
            }
        }
    }
}

/// What the kernel changes, of the same length all.
struct State<'a> {
    position: &'a mut [Vec3A],
    velocity: &'a mut [Vec3A],
    rotation: &'a mut [Quat],
    spin: &'a mut [Vec3A],
    rigid_push: &'a mut [[Vec3A; 2]],
}

impl<'a> State<'a> {
    #[inline(always)]
    fn of(p: &'a mut Particles) -> Self {
        let n = p.position.len();
        Self {
            position: &mut p.position,
            velocity: &mut p.velocity[..n],
            rotation: &mut p.rotation[..n],
            spin: &mut p.angular_velocity[..n],
            rigid_push: &mut p.rigid_push,
        }
    }

    #[inline(always)]
    fn displace(&mut self, i: usize, from: &Gathered, l: usize, rate: f32) {
        let way = from.way.vector(l);
        self.position[i] += way;
        self.velocity[i] += way * rate;
        self.rotation[i] = from.new.quat(l);
        self.spin[i] += from.angle.vector(l) * rate;
    }
}

#[inline(always)]
fn lanes_of(mask: u8) -> impl Iterator<Item = usize> {
    (0..LANES).filter(move |l| mask >> l & 1 != 0)
}

/// The rotational part of `a`, lane by lane, from the rotations found last: see [`extract_rotation`].
#[inline(always)]
fn search<S: Simd>(simd: S, a: Mat3x8<S>, rotation: &mut [Quat]) -> Quatx8<S> {
    let guess = |l: usize| rotation.get(l).copied().unwrap_or(Quat::IDENTITY).into();
    let [x, y, z, w] = columns_of(simd, guess);
    let mut q = Quatx8 { x, y, z, w };
    let (zero, one) = (f32x8::splat(simd, 0.0), f32x8::splat(simd, 1.0));
    let norm2 = a.x.length_squared() + a.y.length_squared() + a.z.length_squared();
    let scale = one / norm2.sqrt();
    let wanted = ((1u32 << rotation.len()) - 1) as u8;
    let mut safe = scale.simd_gt(0.0) & scale.simd_lt(f32::INFINITY);
    let n = Mat3x8 { x: a.x * scale, y: a.y * scale, z: a.z * scale };
    let mut found = 0u8;
    for _ in 0..STEPS {
        // M = A·Rᵀ: the columns of A times the rows of Rᵀ.
        let r = q.matrix(simd);
        let mx = n.x * r.x.x + n.y * r.y.x + n.z * r.z.x;
        let my = n.x * r.x.y + n.y * r.y.y + n.z * r.z.y;
        let mz = n.x * r.x.z + n.y * r.y.z + n.z * r.z.z;
        let g = Vec3x8 { x: my.z - mz.y, y: mz.x - mx.z, z: mx.y - my.x };
        let (xx, yy, zz) = (my.y + mz.z, mx.x + mz.z, mx.x + my.y);
        let (xy, xz, yz) = ((my.x + mx.y) * -0.5, (mz.x + mx.z) * -0.5, (mz.y + my.z) * -0.5);
        let c00 = yy * zz - yz * yz;
        let c01 = xz * yz - xy * zz;
        let c02 = xy * yz - xz * yy;
        let det = xx * c00 + xy * c01 + xz * c02;
        let c11 = xx * zz - xz * xz;
        let c12 = xy * xz - xx * yz;
        let c22 = xx * yy - xy * xy;
        safe &= xx.simd_gt(0.0) & c22.simd_gt(0.0) & det.simd_gt(DEFINITE);
        let step =
            Vec3x8 { x: c00 * g.x + c01 * g.y + c02 * g.z, y: c01 * g.x + c11 * g.y + c12 * g.z, z: c02 * g.x + c12 * g.y + c22 * g.z }
                * (one / det);
        let length2 = step.length_squared();
        safe &= length2.simd_lt(1.0);
        // Lanes that are not safe stay where they are, so that they cannot disturb what is asked of all.
        let step = Vec3x8 { x: safe.select(step.x, zero), y: safe.select(step.y, zero), z: safe.select(step.z, zero) };
        q = q.turned(step * f32x8::splat(simd, 0.5));
        found = (safe & length2.simd_lt(TOLERANCE * TOLERANCE)).to_bitmask() as u8;
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
        for l in lanes_of(astray) {
            let [x, y, z] = &columns;
            let a = Mat3A::from_cols(x.vector(l), y.vector(l), z.vector(l));
            new.set(l, extract_rotation(a, rotation[l]).into());
        }
        let [x, y, z, w] = columns_of(simd, |l| new.row(l));
        q = Quatx8 { x, y, z, w };
    }
    for (l, to) in rotation.iter_mut().enumerate() {
        *to = new.quat(l);
    }
    q
}

#[inline(always)]
fn store_quat<S: Simd>(q: Quatx8<S>, to: &mut [Lane; 4]) {
    let [x, y, z, w] = to;
    q.x.store_array(x);
    q.y.store_array(y);
    q.z.store_array(z);
    q.w.store_array(w);
}

#[inline(always)]
fn load_quat<S: Simd>(simd: S, from: &[Lane; 4]) -> Quatx8<S> {
    let [x, y, z, w] = from;
    let load = |lane: &Lane| f32x8::load_array_ref(simd, lane);
    Quatx8 { x: load(x), y: load(y), z: load(z), w: load(w) }
}
