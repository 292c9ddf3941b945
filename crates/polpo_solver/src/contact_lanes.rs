//! Contacts of eight particles at a time, each with one plane: what [`solve_contacts`](crate::solve_contacts()) says, lane by lane.

use fearless_simd::prelude::*;
use fearless_simd::{Level, dispatch, f32x8, mask32x8};

use crate::lanes::{LANES, Lane, Lanes, Mat3x8, Quatx8, Rows, Vec3x8, bits};
use crate::particles::Moving;
use crate::solve_contacts::{FRICTION_STEPS, LARGEST_TURN, LIVELY, ROUNDING};
use crate::{Contact, Contacts, Particles};

/// Solves up to eight contacts, given by where they stand in the list, whose particles exist, differ and are held by no group. The same bits with the instructions of every `level`.
pub(crate) fn solve_batch(level: Level, batch: &[usize], contacts: &mut Contacts, p: &mut Particles, dt: f32, push_speed: f32) {
    dispatch!(level, simd => solve_lanes(Lanes::<_, false>(simd), batch, contacts, p, dt, push_speed));
}

/// The particles as they are moved.
#[derive(Clone, Copy)]
struct State<S: Simd> {
    x: Vec3x8<S>,
    v: Vec3x8<S>,
    q: Quatx8<S>,
    omega: Vec3x8<S>,
    /// Inverse mass and inertia.
    w: f32x8<S>,
    u: f32x8<S>,
    dt: f32x8<S>,
    rate: f32x8<S>,
}

impl<S: Simd> State<S> {
    /// Moves by `way`, and turns by `angle` or what is allowed of it, where `mask` says so.
    #[inline(always)]
    fn displace<const FUSED: bool>(&mut self, lanes: Lanes<S, FUSED>, mask: mask32x8<S>, way: Vec3x8<S>, angle: Vec3x8<S>) {
        let length2 = lanes.length_squared(angle);
        let long = length2.simd_gt(LARGEST_TURN * LARGEST_TURN);
        let angle = angle * long.select(lanes.splat(LARGEST_TURN) / length2.sqrt(), lanes.splat(1.0));
        let (way, angle) = (way.only(mask), angle.only(mask));
        self.x += way;
        self.v += way * self.rate;
        self.omega += angle * self.rate;
        self.q = lanes.product(lanes.half_exp(angle * lanes.splat(0.5)), self.q);
    }

    /// How easily the point at `reach` yields along `t`.
    #[inline(always)]
    fn yielding<const FUSED: bool>(&self, lanes: Lanes<S, FUSED>, reach: Vec3x8<S>, t: Vec3x8<S>) -> f32x8<S> {
        lanes.mul_add(lanes.length_squared(lanes.cross(reach, t)), self.u, self.w)
    }

    /// How fast a `surface` and the point at `reach` approach each other along `n`.
    #[inline(always)]
    fn approach<const FUSED: bool>(&self, lanes: Lanes<S, FUSED>, n: Vec3x8<S>, surface: Vec3x8<S>, reach: Vec3x8<S>) -> f32x8<S> {
        lanes.dot(n, surface - self.v - lanes.cross(self.omega, reach))
    }
}

#[inline(always)]
fn solve_lanes<S: Simd>(lanes: Lanes<S, false>, batch: &[usize], contacts: &mut Contacts, p: &mut Particles, dt: f32, push_speed: f32) {
    // A lane without a contact repeats the first.
    let contact = |l: usize| &contacts.list[*batch.get(l).unwrap_or(&batch[0])];
    let at: [u32; LANES] = core::array::from_fn(|l| contact(l).particle);
    let friction = lanes.load(&core::array::from_fn(|l| contact(l).friction));
    let (n, point) = (lanes.vectors(|l| contact(l).normal), lanes.vectors(|l| contact(l).point));
    let (moving, turning) = (lanes.vectors(|l| contact(l).velocity), lanes.vectors(|l| contact(l).angular_velocity));
    let (frame, radii) = (lanes.gather_quats(&p.frame, &at), lanes.gather(&p.radii, &at));
    let (x0, q0) = (lanes.gather(&p.previous_position, &at), lanes.gather_quats(&p.previous_rotation, &at));
    let mut state = State {
        x: lanes.gather(&p.position, &at),
        v: lanes.gather(&p.velocity, &at),
        q: lanes.gather_quats(&p.rotation, &at),
        omega: lanes.gather(&p.angular_velocity, &at),
        w: lanes.gather_numbers(&p.inverse_mass, &at),
        u: lanes.gather_numbers(&p.inverse_inertia, &at),
        dt: lanes.splat(dt),
        rate: lanes.splat(1.0 / dt),
    };
    let zero = lanes.splat(0.0);

    let (h, reach) = support(lanes, lanes.product(state.q, frame), radii, n);
    let gap = lanes.dot(n, state.x - point) - h;
    let gap_before = lanes.dot(n, x0 - (point - moving * state.dt)) - h;
    let allowed = lanes.min(gap_before + lanes.splat(push_speed * dt), zero);
    let depth = allowed - gap;
    let touches = gap.simd_lt(zero) & depth.simd_gt(zero) & state.w.simd_gt(zero);
    let touching = touches.to_bitmask() as u8 & ((1u32 << batch.len()) - 1) as u8;
    if touching == 0 {
        return;
    }
    let yielding = state.yielding(lanes, reach, n);
    let surface = moving + lanes.cross(turning, state.x + reach - point);
    let approach = state.approach(lanes, n, surface, reach);
    let noise = lanes.splat(ROUNDING) * (lanes.length_squared(state.x).sqrt() + h);
    let struck = lanes.min(lanes.max(approach * lanes.splat(LIVELY) * state.dt, noise), depth) / yielding;
    state.displace(lanes, touches, n * (struck * state.w), lanes.cross(reach, n) * (struck * state.u));

    let limit = friction * struck;
    let mut rubs = touches & friction.simd_gt(zero) & struck.simd_gt(zero);
    let mut given = lanes.zero();
    for _ in 0..FRICTION_STEPS {
        let now = state.x + reach;
        let back = lanes.matrix(lanes.quotient(q0, state.q));
        let before = lanes.transform_add(back, reach, x0);
        let surface = moving + lanes.cross(turning, now - point);
        let slip = now - before - surface * state.dt;
        let slip = slip - n * lanes.dot(n, slip);
        let length = lanes.length_squared(slip).sqrt();
        rubs &= length.simd_gt(zero);
        if !rubs.any_true() {
            break;
        }
        let t = slip * (lanes.splat(1.0) / length);
        let wanted = given - t * (length / state.yielding(lanes, reach, t));
        let size2 = lanes.length_squared(wanted);
        let sticks = size2.simd_le(limit * limit);
        let all = wanted * sticks.select(lanes.splat(1.0), limit / size2.sqrt());
        rub(lanes, &mut state, rubs, all - given, reach, surface);
        given = all.or(rubs, given);
        rubs &= sticks;
    }

    let (h, _) = support(lanes, lanes.product(state.q, frame), radii, n);
    let rounding = lanes.splat(8.0 * f32::EPSILON) * (state.x.largest() + point.largest() + h);
    let left = allowed + h - lanes.dot(n, state.x - point);
    let rises = touches & left.simd_gt(rounding);
    state.x += (n * left).only(rises);
    let approach = lanes.dot(n, moving - state.v);
    let stopped = lanes.min(lanes.max(approach, zero), left * state.rate);
    state.v += (n * stopped).only(rises);

    let mut rows = [Rows::default(); 4];
    rows[0].store(state.x.columns());
    rows[1].store(state.v.columns());
    rows[2].store(state.q.columns());
    rows[3].store(state.omega.columns());
    let impulse: Lane = (struck * state.rate).to_array();
    let particles = Moving::of(p);
    for l in bits(touching) {
        let i = at[l] as usize;
        particles.position[i] = rows[0].vector(l);
        particles.velocity[i] = rows[1].vector(l);
        particles.rotation[i] = rows[2].quat(l);
        particles.spin[i] = rows[3].vector(l);
        let contact: &mut Contact = &mut contacts.list[batch[l]];
        contact.impulse += impulse[l];
    }
}

/// Gives the impulse `by` \[kg·m\] at `reach`, where `mask` says so.
#[inline(always)]
fn rub<S: Simd, const FUSED: bool>(
    lanes: Lanes<S, FUSED>,
    state: &mut State<S>,
    mask: mask32x8<S>,
    by: Vec3x8<S>,
    reach: Vec3x8<S>,
    surface: Vec3x8<S>,
) {
    let strength = lanes.length_squared(by).sqrt();
    let mask = mask & strength.simd_gt(0.0);
    let along = by * (lanes.splat(1.0) / strength);
    let yielding = state.yielding(lanes, reach, along);
    let noise = lanes.splat(ROUNDING) * (lanes.length_squared(state.x).sqrt() + lanes.length_squared(reach).sqrt());
    let slower = state.approach(lanes, along, surface, reach) * state.dt;
    let whole = strength * yielding;
    let stopped = lanes.min(lanes.max(slower * lanes.splat(LIVELY), noise), whole) / yielding;
    state.displace(lanes, mask, along * (stopped * state.w), lanes.cross(reach, along) * (stopped * state.u));
    state.x += (along * ((strength - stopped) * yielding)).only(mask);
}

/// How far an ellipsoid reaches against `n`, and where: see [`Ellipsoid::support`](crate::Ellipsoid::support).
#[inline(always)]
fn support<S: Simd, const FUSED: bool>(
    lanes: Lanes<S, FUSED>,
    orientation: Quatx8<S>,
    radii: Vec3x8<S>,
    n: Vec3x8<S>,
) -> (f32x8<S>, Vec3x8<S>) {
    let axes: Mat3x8<S> = lanes.matrix(orientation);
    let local = lanes.transpose_times(axes, n);
    let scaled = Vec3x8 { x: -radii.x * local.x, y: -radii.y * local.y, z: -radii.z * local.z };
    let h = lanes.length_squared(scaled).sqrt();
    let by = h.simd_gt(0.0).select(lanes.splat(1.0) / h, lanes.splat(0.0));
    let at = Vec3x8 { x: radii.x * scaled.x * by, y: radii.y * scaled.y * by, z: radii.z * scaled.z * by };
    (h, lanes.transform_add(axes, at, lanes.zero()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solve_contacts::solve;
    use crate::testing::{Random, assert_close, blob, same_at_every_level, stir};
    use glam::Vec3A;

    /// Eight contacts side by side come out as one by one, but for rounding; with every instruction set the same bits. Sticking and slipping, deep and shallow, on ground that moves and turns, some pinned.
    #[test]
    fn lanes_do_what_one_contact_does() {
        let (rest, _) = blob();
        let dt = 1.0 / 300.0;
        let mut touched = 0;
        for seed in 0..40 {
            let mut random = Random(seed);
            let mut p = rest.clone();
            p.previous_position.clone_from(&p.position);
            stir(&mut p, seed, 0.05);
            if seed % 5 == 0 {
                p.pin(1, true, false);
                p.pin(2, false, true);
            }
            let contacts = Contacts {
                list: (0..p.len().min(LANES - seed as usize % 3))
                    .map(|i| {
                        let normal = (random.vector() + Vec3A::Y * 2.0).normalize();
                        let (h, _) = p.ellipsoid(i).support(-normal);
                        Contact {
                            particle: i as u32,
                            friction: [0.0, 0.1, 0.6, 50.0][i % 4],
                            point: p.position[i] - normal * (h * (1.0 + 0.02 * random.signed())),
                            normal,
                            velocity: random.vector() * 0.1 * (seed % 2) as f32,
                            angular_velocity: random.vector() * (seed % 4 / 2) as f32,
                            impulse: 0.0,
                        }
                    })
                    .collect(),
            };
            let batch: Vec<usize> = (0..contacts.list.len()).collect();
            let (mut lanes, mut alone) = ((contacts.clone(), p.clone()), (contacts.clone(), p.clone()));
            solve_batch(Level::new(), &batch, &mut lanes.0, &mut lanes.1, dt, 3.0);
            for contact in &mut alone.0.list {
                solve(contact, &mut alone.1, dt, 3.0, false);
            }
            assert_close(&lanes.1, &alone.1, 1e-5);
            for (a, b) in lanes.0.list.iter().zip(&alone.0.list) {
                assert!((a.impulse - b.impulse).abs() < 1e-3 * b.impulse + 1e-4, "{} {}", a.impulse, b.impulse);
                touched += usize::from(b.impulse > 0.0);
            }
            same_at_every_level(&p, |p, level| solve_batch(level, &batch, &mut contacts.clone(), p, dt, 3.0));
        }
        assert!(touched > 80, "{touched}");
    }
}
