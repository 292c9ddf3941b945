//! Stage 3: particles leave the colliders, and friction acts where they touch.

use fearless_simd::Level;
use glam::Vec3A;

use crate::contact_lanes::solve_batch;
use crate::lanes::LANES;
use crate::{Contact, Contacts, ExplicitGroups, Particles};

/// Solves every contact of the body for one substep of `dt` \[s\] and carries its plane on to the end of the substep.
///
/// *Normal.* A plane with normal n through p sees the ellipsoid's support h = √(nᵀΣn); the gap is C = n·(x − p) − h, the contact point x + r with r = −Σn/h. Its gradient is n for the position and
/// r×n for the rotation, so with the generalised inverse mass w = 1/m + |r×n|²/I the impulse λ = −C/w moves x by λ·n/m and turns by λ·(r×n)/I.
///
/// The way goes into the velocities as far as it stops what was approaching, and no further: so a contact takes energy and never gives any. What then is left of the overlap (what others made of it, what the linear step left)
/// is undone in the position alone.
///
/// A gap that was already negative when the substep began is an overlap that nobody's motion made (a body spawned inside a wall, a teleported collider). It is undone at no more than `push_speed`
/// \[m/s\], 0 … ∞, so that it does not become an explosion.
///
/// *Friction.* Coulomb's law on the way that the contact point has slipped over the surface during the substep, u = (x + r) − (x₀ + R₀R⁻¹r) − v_s·Δt with v_s the surface's velocity at the contact,
/// its rotation included: the impulse −u_t·m_t, m_t = 1/(1/m + |r×t|²/I), never more than μ times what the velocity took of the normal one. As a position it holds a resting body without creep; as an impulse it does not depend on Δt. It, too, goes into the velocities as far
/// as it stops them.
///
/// Degenerate: a contact of a particle that does not exist is skipped.
pub fn solve_contacts(contacts: &mut Contacts, particles: &mut Particles, dt: f32, push_speed: f32) {
    solve_all(contacts, particles, dt, push_speed, |_| false);
}

/// [`solve_contacts`] for a body with explicit groups: the members of closed ones take the whole way into their velocities, for [`land_explicit_groups`](crate::land_explicit_groups), which is to be called next, to make the
/// group's out of it; a group leaves what it overlaps with by moving.
pub fn solve_contacts_beside(groups: &ExplicitGroups, contacts: &mut Contacts, particles: &mut Particles, dt: f32, push_speed: f32) {
    solve_all(contacts, particles, dt, push_speed, |i| groups.holds(i));
}

fn solve_all(contacts: &mut Contacts, particles: &mut Particles, dt: f32, push_speed: f32, held: impl Fn(usize) -> bool) {
    for contact in &mut contacts.list {
        contact.point += contact.velocity * dt;
        if contact.angular_velocity != Vec3A::ZERO {
            contact.normal = (contact.normal + contact.angular_velocity.cross(contact.normal) * dt).normalize();
        }
        contact.impulse = 0.0;
    }
    // Twice for those that have several planes, because what turns a particle out of one may turn it into another. A particle's planes stand side by side. Those that have one do not see each other: eight at a time.
    let (mut batch, mut count) = ([0; LANES], 0);
    for pass in 0..2 {
        for k in 0..contacts.list.len() {
            let contact = &contacts.list[k];
            let i = contact.particle as usize;
            if i >= particles.len() || is_above(contact, particles) {
                continue;
            }
            let same = |k: usize| contacts.list.get(k).is_some_and(|other| other.particle == contact.particle);
            if held(i) || same(k + 1) || (k > 0 && same(k - 1)) {
                solve(&mut contacts.list[k], particles, dt, push_speed, held(i));
            } else if pass == 0 {
                batch[count] = k;
                count += 1;
                if count == LANES {
                    solve_batch(Level::new(), &batch, contacts, particles, dt, push_speed);
                    count = 0;
                }
            }
        }
    }
    match count {
        0 => {}
        // Not worth it.
        1 => solve(&mut contacts.list[batch[0]], particles, dt, push_speed, false),
        _ => solve_batch(Level::new(), &batch[..count], contacts, particles, dt, push_speed),
    }
}

/// Whether the particle is above the plane by more than its longest half axis: further no ellipsoid reaches.
#[inline]
fn is_above(contact: &Contact, p: &Particles) -> bool {
    let i = contact.particle as usize;
    contact.normal.dot(p.position[i] - contact.point) >= p.radii[i].max_element()
}

/// Solves one contact.
pub(crate) fn solve(contact: &mut Contact, p: &mut Particles, dt: f32, push_speed: f32, held: bool) {
    let i = contact.particle as usize;
    let n = contact.normal;
    let (h, reach) = p.ellipsoid(i).support(-n);
    let gap = n.dot(p.position[i] - contact.point) - h;
    if gap >= 0.0 {
        return;
    }
    let gap_before = n.dot(p.previous_position[i] - (contact.point - contact.velocity * dt)) - h;
    let allowed = (gap_before + push_speed * dt).min(0.0);
    let depth = allowed - gap;
    if depth <= 0.0 {
        return;
    }
    let (w, inverse_inertia) = (p.inverse_mass[i], p.inverse_inertia[i]);
    if w == 0.0 {
        return;
    }
    let lever = reach.cross(n);
    let yielding = w + inverse_inertia * lever.length_squared();
    let rate = 1.0 / dt;
    let surface = contact.velocity + contact.angular_velocity.cross(p.position[i] + reach - contact.point);
    let approach = n.dot(surface - p.velocity[i] - p.angular_velocity[i].cross(reach));
    let noise = ROUNDING * (p.position[i].length() + h);
    let struck = if held { depth } else { (LIVELY * approach * dt).max(noise).min(depth) } / yielding;
    p.displace(i, n * (struck * w), rate);
    turn(p, i, lever * (struck * inverse_inertia), rate);
    contact.impulse += struck * rate;

    if contact.friction > 0.0 && struck > 0.0 {
        let limit = contact.friction * struck;
        let mut given = Vec3A::ZERO;
        for _ in 0..FRICTION_STEPS {
            let now = p.position[i] + reach;
            let turned_back = p.previous_rotation[i] * p.rotation[i].inverse() * reach;
            let before = p.previous_position[i] + turned_back;
            let surface = contact.velocity + contact.angular_velocity.cross(now - contact.point);
            let slip = now - before - surface * dt;
            let slip = slip - n * n.dot(slip);
            let length = slip.length();
            if length <= 0.0 {
                break;
            }
            let t = slip / length;
            let lever = reach.cross(t);
            let wanted = given - t * (length / (w + inverse_inertia * lever.length_squared()));
            let sticks = wanted.length_squared() <= limit * limit;
            let all = if sticks { wanted } else { wanted.clamp_length_max(limit) };
            rub(p, i, all - given, reach, surface, held, dt);
            given = all;
            if !sticks {
                break;
            }
        }
    }

    // The step above is linear; a small ellipsoid may have been turned so far that its support is another. What is left of the overlap is taken back without
    // turning. It may stop the particle but not send it off: it is an error of the step, not an impulse. Not so what places are rounded by: the next substep's impulse takes that, friction and all. A ball of 0.1 m sinks by
    // 7e-7 m in 1/3840 s, a hundred times the rounding, and would lose half a percent of its friction.
    let (h, _) = p.ellipsoid(i).support(-n);
    let rounding = 8.0 * f32::EPSILON * (p.position[i].abs().max_element() + contact.point.abs().max_element() + h);
    let left = allowed + h - n.dot(p.position[i] - contact.point);
    if left > rounding {
        p.position[i] += n * left;
        let approach = n.dot(contact.velocity - p.velocity[i]);
        p.velocity[i] += n * approach.clamp(0.0, left * rate);
    }
}

/// Gives particle `i` the impulse `by` \[kg·m\] at `reach` from its centre, where it touches what moves at `surface` \[m/s\].
fn rub(p: &mut Particles, i: usize, by: Vec3A, reach: Vec3A, surface: Vec3A, held: bool, dt: f32) {
    let strength = by.length();
    let rubs = strength > 0.0;
    if !rubs {
        return;
    }
    let (w, inverse_inertia, rate) = (p.inverse_mass[i], p.inverse_inertia[i], 1.0 / dt);
    let along = by / strength;
    let yielding = w + inverse_inertia * reach.cross(along).length_squared();
    let noise = ROUNDING * (p.position[i].length() + reach.length());
    let slower = along.dot(surface - p.velocity[i] - p.angular_velocity[i].cross(reach)) * dt;
    let stopped = if held { strength } else { (LIVELY * slower).max(noise).min(strength * yielding) / yielding };
    p.displace(i, along * (stopped * w), rate);
    turn(p, i, reach.cross(along) * (stopped * inverse_inertia), rate);
    p.position[i] += along * ((strength - stopped) * yielding);
}

/// The velocities take a way of up to so many times that which stops them. Below 2 that gives no energy, and above 1 rounding is not taken for a way that nobody's motion made.
pub(crate) const LIVELY: f32 = 1.5;

/// What a way can be by rounding alone, as a share of the distance from the origin: so much always goes into the velocities, or a body at rest would creep.
pub(crate) const ROUNDING: f32 = 1e-6;

/// How often friction is asked what way is left. One step is linear: where constraints pull hard enough to turn a small particle by a tenth of a radian a substep, it would leave a way of some millionths of a
/// metre, a substep, always to the same side: a millimetre a second.
pub(crate) const FRICTION_STEPS: usize = 3;

/// No contact turns a particle by more than this in one go \[rad\]: beyond, the linear step means nothing and only makes spin.
pub(crate) const LARGEST_TURN: f32 = 0.5;

#[inline]
fn turn(p: &mut Particles, i: usize, by: Vec3A, rate: f32) {
    p.turn(i, by.clamp_length_max(LARGEST_TURN), rate);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Random;
    use crate::{ParticleRest, integrate, predict, quat_exp};
    use glam::Quat;

    const G: Vec3A = Vec3A::new(0.0, -9.81, 0.0);

    fn particle(radii: Vec3A) -> Particles {
        Particles::new(&[ParticleRest { position: Vec3A::ZERO, frame: Quat::IDENTITY, radii, mass: 2.0 }]).unwrap()
    }

    fn floor(normal: Vec3A, friction: f32) -> Contact {
        Contact { particle: 0, friction, point: Vec3A::ZERO, normal, velocity: Vec3A::ZERO, angular_velocity: Vec3A::ZERO, impulse: 0.0 }
    }

    fn step(p: &mut Particles, contact: Contact, dt: f32) -> Contact {
        let mut contacts = Contacts { list: vec![contact] };
        predict(p, G, dt);
        solve_contacts(&mut contacts, p, dt, 3.0);
        integrate(p, dt, 0.0);
        contacts.list[0]
    }

    /// v₀ = 3 m/s, μ = 0.3 stops after v₀²/(2μg) = 1.52905 m and v₀/(μg) = 1.01937 s, at every step. A sphere so small that it does
    /// not matter would roll; this one is held from turning by an infinite inertia.
    #[test]
    fn a_sliding_block_stops_where_coulomb_says() {
        for rate in [60.0, 240.0, 960.0] {
            let dt = 1.0 / rate;
            let mut p = particle(Vec3A::splat(0.1));
            p.inverse_inertia[0] = 0.0;
            p.position[0] = Vec3A::new(0.0, 0.1, 0.0);
            p.velocity[0] = Vec3A::X * 3.0;
            let (mut time, mut travelled) = (0.0, 0.0);
            for k in 0..(2.0 * rate) as usize {
                step(&mut p, floor(Vec3A::Y, 0.3), dt);
                // The origin follows the body, as it does in a scene: far from it, 1.5 m, the 3.2e-6 m that friction takes
                // back in 1/960 s would be rounded by 2 %.
                travelled += p.position[0].x;
                p.shift_origin(Vec3A::X * p.position[0].x);
                if time == 0.0 && p.velocity[0].x.abs() < 2e-4 {
                    time = (k + 1) as f32 * dt;
                }
            }
            assert!((time - 1.01937).abs() < 1.5 * dt + 0.001, "{rate} Hz: {time} s");
            assert!((travelled - 1.52905).abs() < 2.0 * dt, "{rate} Hz: {travelled} m");
        }
    }

    /// A ball that slides into rolling keeps 5/7 of its speed and rolls the right way.
    #[test]
    fn a_sliding_ball_ends_up_rolling() {
        let mut p = particle(Vec3A::splat(0.1));
        p.position[0] = Vec3A::new(0.0, 0.1, 0.0);
        p.velocity[0] = Vec3A::X * 3.0;
        let dt = 1.0 / 480.0;
        for _ in 0..480 {
            step(&mut p, floor(Vec3A::Y, 0.3), dt);
        }
        let v = p.velocity[0].x;
        assert!((v - 15.0 / 7.0).abs() < 0.02, "{v}");
        assert!((p.angular_velocity[0].z + v / 0.1).abs() < 0.02 * v / 0.1, "{}", p.angular_velocity[0]);
    }

    #[test]
    fn a_slope_below_the_angle_of_friction_holds_without_creep() {
        let n = Vec3A::new(libm::sinf(0.3), libm::cosf(0.3), 0.0);
        let mut p = particle(Vec3A::splat(0.1));
        p.inverse_inertia[0] = 0.0;
        p.position[0] = n * 0.1;
        for _ in 0..6000 {
            step(&mut p, floor(n, 0.5), 1.0 / 600.0);
        }
        assert!(p.position[0].distance(n * 0.1) < 1e-4, "crept {} m", p.position[0].distance(n * 0.1));
    }

    #[test]
    fn an_ellipsoid_rests_on_its_support_and_feels_the_lever() {
        let mut p = particle(Vec3A::new(0.4, 0.1, 0.1));
        p.rotation[0] = quat_exp(Vec3A::Z * 0.4);
        let (h, _) = p.ellipsoid(0).support(-Vec3A::Y);
        p.position[0] = Vec3A::Y * h;
        let contact = step(&mut p, floor(Vec3A::Y, 0.0), 1.0 / 240.0);
        assert!(contact.impulse > 0.0);
        // It touches on the side of its long axis that points down and is turned flat.
        assert!(p.angular_velocity[0].z < -0.1, "{}", p.angular_velocity[0]);
        let (h, _) = p.ellipsoid(0).support(-Vec3A::Y);
        assert!(p.position[0].y - h > -1e-4);
    }

    #[test]
    fn a_moving_surface_carries_and_pushes() {
        let mut p = particle(Vec3A::splat(0.1));
        p.inverse_inertia[0] = 0.0;
        p.position[0] = Vec3A::Y * 0.1;
        let dt = 1.0 / 240.0;
        for _ in 0..240 {
            let mut belt = floor(Vec3A::Y, 0.8);
            belt.velocity = Vec3A::X * 0.5;
            step(&mut p, belt, dt);
        }
        assert!((p.velocity[0].x - 0.5).abs() < 1e-3, "{}", p.velocity[0]);
        // A wall that comes at 2 m/s takes the particle along at 2 m/s.
        let mut wall = floor(Vec3A::X, 0.0);
        wall.point = p.position[0] - Vec3A::X * 0.1;
        wall.velocity = Vec3A::X * 2.0;
        step(&mut p, wall, dt);
        assert!((p.velocity[0].x - 2.0).abs() < 1e-2, "{}", p.velocity[0]);
    }

    /// A surface at rest takes energy and never gives any, however deep, fast, rough and slanted, but for what [`ROUNDING`] lets through.
    #[test]
    fn a_contact_gives_no_energy() {
        let mut random = Random(5);
        for _ in 0..20_000 {
            let mut p = particle(random.vector().abs() * 0.1 + 0.02);
            let dt = libm::powf(10.0, random.signed() * 1.2 - 2.3);
            let mut contact = floor((random.vector() + Vec3A::Y * 0.01).normalize(), random.signed() + 1.0);
            p.rotation[0] = quat_exp(random.vector() * 3.0);
            p.velocity[0] = random.vector() * 10.0;
            p.angular_velocity[0] = random.vector() * 50.0;
            let energy = |p: &Particles| crate::momentum(p).kinetic_energy;
            contact.point = p.position[0] - contact.normal * (random.signed() * 0.15 + 0.05);
            let before = energy(&p);
            p.previous_position[0] = p.position[0] - p.velocity[0] * dt;
            let mut contacts = Contacts { list: vec![contact] };
            solve_contacts(&mut contacts, &mut p, dt, 3.0);
            let slack = ROUNDING * 0.3 / dt * (2.0 * p.mass[0] * before).sqrt();
            assert!(energy(&p) <= before * (1.0 + 1e-5) + slack, "{before} → {} J: {contact:?}", energy(&p));
        }
    }

    #[test]
    fn an_old_overlap_is_undone_gently() {
        let mut p = particle(Vec3A::splat(0.1));
        p.position[0] = Vec3A::Y * -0.5;
        let dt = 1.0 / 60.0;
        let mut fastest = 0.0f32;
        for _ in 0..120 {
            step(&mut p, floor(Vec3A::Y, 0.0), dt);
            fastest = fastest.max(p.velocity[0].y);
        }
        assert!(fastest < 3.1, "{fastest} m/s");
        assert!(p.position[0].y > 0.0999);
    }
}
