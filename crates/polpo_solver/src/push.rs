//! Stage 3, for what gives way: particles and rigid bodies push each other.

use glam::Vec3A;

use crate::{Contact, Movers, Particles, RigidMover};

/// A contact of a particle with a rigid body that gives way: the plane follows the [`RigidMover`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PushContact {
    /// The particle that must stay above the plane.
    pub particle: u32,
    /// Index of the mover.
    pub mover: u32,
    /// Coulomb's coefficient μ, 0 … ∞.
    pub friction: f32,
    /// Where the mover's centre of mass was at the step's start, relative to the body's origin \[m\].
    pub center: Vec3A,
    /// From there to a point of the surface \[m\].
    pub arm: Vec3A,
    /// Unit normal, out of the mover, towards the particle.
    pub normal: Vec3A,
    /// How fast the plane turns beyond what the mover does \[rad/s\]: a rolling ball's tangent plane does not turn with it. 0 for a flat face.
    pub extra: Vec3A,
    /// The particle's contacts with what does not give way: from … to in [`Contacts::list`](crate::Contacts::list). One that is not there is skipped.
    pub support: [u32; 2],
    /// What it did in the last substep; written by the solver.
    pub state: PushState,
}

/// What a contact has done in a substep.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PushState {
    /// The gap at its start \[m\].
    pub before: f32,
    /// The normal impulse that the particle took as if nothing were behind it \[N·s\].
    pub free: f32,
    /// The one that went through it, borne by its support \[N·s\].
    pub held: f32,
    /// Friction on what was free \[N·s\].
    pub free_rub: Vec3A,
    /// Friction on what was held \[N·s\].
    pub held_rub: Vec3A,
}

impl PushContact {
    /// A contact at the point `arm` \[m\] from the mover's centre of mass, which is at `center` \[m\] from the body's origin. Frictionless, without support, turning with the mover.
    pub fn new(particle: u32, mover: u32, center: Vec3A, arm: Vec3A, normal: Vec3A) -> Self {
        let (friction, extra, support, state) = (0.0, Vec3A::ZERO, [0; 2], PushState::default());
        Self { particle, mover, friction, center, arm, normal, extra, support, state }
    }

    /// The normal impulse of the last substep \[N·s\].
    pub fn impulse(&self) -> f32 {
        self.state.free + self.state.held
    }

    /// How fast the particle and the surface meet \[m/s\], if they do in this substep of `dt` \[s\]; otherwise 0. To be asked before the contact is solved, while the velocities still tell the blow. 0 too if the
    /// particle or the mover does not exist.
    pub fn closing_speed(&self, movers: &Movers, particles: &Particles, dt: f32) -> f32 {
        let (Some(mover), i) = (movers.list.get(self.mover as usize), self.particle as usize) else { return 0.0 };
        if i >= particles.len() {
            return 0.0;
        }
        let (point, n) = self.plane(mover, dt);
        let (h, reach) = particles.ellipsoid(i).support(-n);
        if n.dot(particles.position[i] - point) >= h {
            return 0.0;
        }
        let own = particles.velocity[i] + particles.angular_velocity[i].cross(reach);
        (-n.dot(own - mover.velocity - mover.angular_velocity.cross(self.arm))).max(0.0)
    }

    /// The point of the surface and the normal now.
    #[inline]
    fn plane(&self, mover: &RigidMover, dt: f32) -> (Vec3A, Vec3A) {
        let at = self.center + mover.way + mover.step;
        let normal = mover.turn * self.normal;
        if self.extra == Vec3A::ZERO {
            return (at + mover.turn * self.arm, normal);
        }
        // The shape does not turn with its material: the point slides along its tangent.
        (at + self.arm + mover.angle.cross(self.arm), (normal + self.extra.cross(normal) * dt).normalize())
    }
}

/// Begins a substep, after [`Movers::begin`] and [`solve_contacts`](crate::solve_contacts): remembers the gaps at its start.
pub fn begin_pushes(list: &mut [PushContact], movers: &Movers, particles: &Particles, dt: f32) {
    for contact in list {
        contact.state = PushState::default();
        let (Some(mover), i) = (movers.list.get(contact.mover as usize), contact.particle as usize) else { continue };
        if i < particles.len() {
            let (_, n) = contact.plane(mover, dt);
            let point = contact.center + mover.way + contact.arm;
            contact.state.before = n.dot(particles.previous_position[i] - point) - particles.ellipsoid(i).support(-n).0;
        }
    }
}

/// One sweep over the contacts of a body within a substep of `dt` \[s\].
///
/// *Normal.* As in [`solve_contacts`](crate::solve_contacts), with the pair's w = w_particle + w_mover, and the impulse summed up over the sweeps, so that it may shrink again but never pulls: a
/// heavy box on many particles settles on the right share for each. The impulse acts at the common point of where both were when the substep began, which keeps P and L to rounding. An overlap that was
/// there when the substep began is only kept from growing; see [`undo_overlaps`].
///
/// *Support.* A light particle between a heavy body and the ground cannot carry it by exchanging impulses with both in turn: the mass ratio is the number of sweeps it would take. So the particle's way
/// until it meets its `support` is told in advance: of the impulse λ it takes Λ = room/(w·c·Δt), with c = −n·n_support, as a free particle would. What is more goes through it. If both normals are
/// within the angle of nip, c ≥ (1 − μ²)/(1 + μ²), which is when a lump between two jaws of friction μ cannot be squeezed out, it is *jammed*: it gives way no more, and the body stands on the ground
/// through it. Beyond that angle it gives way along its supports, with the part of n that none of them opposes.
///
/// *Friction.* Coulomb's, for both parts. What is jammed is squeezed, it does not roll like the ball of a bearing: what its support bears stops it first, within Coulomb's law, and the mover rubs against the support.
///
/// A contact of a particle or a mover that does not exist is skipped.
pub fn solve_pushes(list: &mut [PushContact], movers: &mut Movers, statics: &[Contact], particles: &mut Particles, dt: f32) {
    for contact in list {
        let Some(mover) = movers.list.get_mut(contact.mover as usize) else { continue };
        if (contact.particle as usize) < particles.len() {
            solve(contact, mover, statics, particles, dt);
        }
    }
}

/// Where the particle of a contact ends up against its supports.
#[derive(Clone, Copy, Debug)]
struct Backing<'a> {
    /// The impulse that takes it there, and the support that it meets first.
    room: f32,
    first: Option<&'a Contact>,
    /// The direction in which it gives way beyond: 0 if it is jammed.
    way: Vec3A,
}

impl<'a> Backing<'a> {
    /// `free` is the impulse that it has taken already.
    fn of(contact: &PushContact, statics: &'a [Contact], n: Vec3A, p: &Particles, dt: f32) -> Self {
        let i = contact.particle as usize;
        let w = p.inverse_mass[i];
        let mut backing = Self { room: f32::INFINITY, first: None, way: n };
        let supports = statics.get(contact.support[0] as usize..contact.support[1] as usize).unwrap_or(&[]);
        for support in supports {
            let c = -n.dot(support.normal);
            if c <= 0.0 || support.particle != contact.particle {
                continue;
            }
            let gap = support.normal.dot(p.position[i] - support.point) - p.ellipsoid(i).support(-support.normal).0;
            let room = (gap / (c * w * dt) + contact.state.free).max(0.0);
            let mu2 = contact.friction.min(support.friction).powi(2);
            let jams = c * (1.0 + mu2) >= (1.0 - mu2) * JAM;
            // Of several, one that jams it; of those, the one it meets first.
            let jammed = backing.way == Vec3A::ZERO;
            if jams && !jammed || jams == jammed && room < backing.room {
                backing.room = room;
                backing.first = Some(support);
            }
            if jams {
                backing.way = Vec3A::ZERO;
            }
        }
        // Cyclic projections onto the half-spaces that the supports leave.
        for _ in 0..3 {
            for support in supports.iter().filter(|support| support.particle == contact.particle) {
                backing.way -= support.normal * support.normal.dot(backing.way).min(0.0);
            }
        }
        backing
    }
}

/// Rounding of two opposite normals.
const JAM: f32 = 0.9999;

fn solve(contact: &mut PushContact, mover: &mut RigidMover, statics: &[Contact], p: &mut Particles, dt: f32) {
    let i = contact.particle as usize;
    let (point, n) = contact.plane(mover, dt);
    let (h, reach) = p.ellipsoid(i).support(-n);
    let gap = n.dot(p.position[i] - point) - h;
    let (w, spin) = (p.inverse_mass[i], p.inverse_inertia[i]);
    let lever = reach.cross(n);
    // Where both were when the substep began.
    let arm = p.position[i] - p.velocity[i] * dt + reach - (contact.center + mover.way);
    let wb = mover.yielding(n, arm);
    let wn = w + spin * lever.length_squared();
    let PushState { before, free, held, .. } = contact.state;
    // Several bodies push one mover: a broken one must not break it.
    if !(gap.is_finite() && arm.is_finite()) || wn + wb <= 0.0 || (gap >= before.min(0.0) && free + held == 0.0) {
        return;
    }
    let backing = if w > 0.0 { Backing::of(contact, statics, n, p, dt) } else { Backing { room: 0.0, first: None, way: Vec3A::ZERO } };
    let wd = w * backing.way.length_squared();
    // The gap as it would be without this contact, and the impulse that leaves none.
    let bare = gap - before.min(0.0) - dt * (wn * free + wd * held + wb * (free + held));
    let mut to_free = (-bare / (dt * (wn + wb))).max(0.0);
    let mut to_held = 0.0;
    if to_free > backing.room {
        to_free = backing.room;
        let left = bare + dt * (wn + wb) * to_free;
        to_held = if wd + wb > 0.0 { (-left / (dt * (wd + wb))).max(0.0) } else { 0.0 };
    }
    let (more_free, more_held) = (to_free - free, to_held - held);
    contact.state.free = to_free;
    contact.state.held = to_held;
    p.displace(i, (n * more_free + backing.way * more_held) * (w * dt), 1.0 / dt);
    spin_up(p, i, lever * (more_free * spin), dt);
    mover.push(n * -(more_free + more_held), arm, dt);
    if contact.friction > 0.0 {
        rub(contact, mover, &backing, p, n, reach, arm, dt);
    }
}

#[expect(clippy::too_many_arguments, reason = "all of it is what the normal part knows already")]
fn rub(
    contact: &mut PushContact,
    mover: &mut RigidMover,
    backing: &Backing,
    p: &mut Particles,
    n: Vec3A,
    reach: Vec3A,
    arm: Vec3A,
    dt: f32,
) {
    let i = contact.particle as usize;
    let PushState { free, held, free_rub, held_rub, .. } = contact.state;
    let jammed = held > 0.0 && backing.way == Vec3A::ZERO;
    if jammed && let Some(support) = backing.first {
        stop(p, i, support, support.friction * held, dt);
    }
    let slip = |p: &Particles, mover: &RigidMover| {
        let slip = p.velocity[i] + p.angular_velocity[i].cross(reach) - mover.velocity_at(arm);
        slip - n * n.dot(slip)
    };
    let (bearing, borne) = if jammed { (free, held) } else { (free + held, 0.0) };
    let u = slip(p, mover);
    let length = u.length();
    if length > 0.0 {
        let t = u / length;
        let (w, spin) = (p.inverse_mass[i], p.inverse_inertia[i]);
        let m = w + spin * reach.cross(t).length_squared() + mover.yielding(t, arm);
        if m > 0.0 {
            let rub = (free_rub - u / m).clamp_length_max(contact.friction * bearing);
            let more = rub - free_rub;
            contact.state.free_rub = rub;
            p.displace(i, more * (w * dt), 1.0 / dt);
            spin_up(p, i, reach.cross(more) * spin, dt);
            mover.push(-more, arm, dt);
        }
    }
    let u = slip(p, mover);
    let length = u.length();
    if length > 0.0 && (borne > 0.0 || held_rub != Vec3A::ZERO) {
        let m = mover.yielding(u / length, arm);
        if m > 0.0 {
            let rub = (held_rub - u / m).clamp_length_max(contact.friction * borne);
            mover.push(held_rub - rub, arm, dt);
            contact.state.held_rub = rub;
        }
    }
}

/// Friction against `support` stops particle `i`, spin included, by an impulse of `most` at most.
fn stop(p: &mut Particles, i: usize, support: &Contact, most: f32, dt: f32) {
    let slip = p.velocity[i] - support.velocity;
    let slip = slip - support.normal * support.normal.dot(slip);
    let most_way = most * p.inverse_mass[i];
    p.displace(i, -slip.clamp_length_max(most_way) * dt, 1.0 / dt);
    let spin = p.angular_velocity[i] - support.angular_velocity;
    let most_spin = most * p.radii[i].min_element() * p.inverse_inertia[i];
    spin_up(p, i, -spin.clamp_length_max(most_spin), dt);
}

/// No contact turns a particle by more than this in one go \[rad\]: beyond, the linear step means nothing. Its spin takes all.
const LARGEST_TURN: f32 = 0.5;

#[inline]
fn spin_up(p: &mut Particles, i: usize, dw: Vec3A, dt: f32) {
    let angle = dw * dt;
    let turn = angle.clamp_length_max(LARGEST_TURN);
    p.turn(i, turn, 1.0 / dt);
    p.angular_velocity[i] += (angle - turn) / dt;
}

/// Ends a substep of `dt` \[s\]: what was an overlap when it began is undone at no more than `push_speed` \[m/s\], by moving both without making either faster; planes that do not turn with their mover
/// are carried on. Call [`RigidMover::settle`] (or [`Movers::begin`]) next.
///
/// The particle moves until it meets its support, then the body does. Moved without velocity, the pair keeps P, and L but for the way times the momentum of its slip.
pub fn undo_overlaps(list: &mut [PushContact], movers: &mut Movers, statics: &[Contact], p: &mut Particles, dt: f32, push_speed: f32) {
    for contact in &mut *list {
        let i = contact.particle as usize;
        let Some(mover) = movers.list.get_mut(contact.mover as usize) else { continue };
        if i >= p.len() || contact.state.before >= 0.0 {
            continue;
        }
        let (point, n) = contact.plane(mover, dt);
        let (h, reach) = p.ellipsoid(i).support(-n);
        let depth = (h - n.dot(p.position[i] - point)).min(push_speed * dt);
        let w = p.inverse_mass[i];
        let arm = p.position[i] + reach - (contact.center + mover.way + mover.step);
        let wb = if mover.anchored { 0.0 } else { mover.yielding(n, arm) };
        if depth.is_nan() || depth <= 0.0 || w + wb <= 0.0 {
            continue;
        }
        let room = if w > 0.0 {
            Backing::of(&PushContact { state: PushState::default(), ..*contact }, statics, n, p, dt).room * w * dt
        } else {
            0.0
        };
        let own = (depth * w / (w + wb)).min(room);
        p.position[i] += n * own;
        if wb > 0.0 {
            mover.shift(n * (-(depth - own) / wb), arm);
        }
    }
    for contact in list {
        let Some(mover) = movers.list.get(contact.mover as usize) else { continue };
        let (point, normal) = contact.plane(mover, dt);
        contact.arm = point - (contact.center + mover.way + mover.step);
        contact.normal = normal;
    }
}
