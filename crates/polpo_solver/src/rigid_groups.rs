//! Explicit groups as rigid bodies: their free motion, and what constraints and contacts on members do to it.

use glam::{DMat3, DQuat, DVec3, Mat3A, Quat, Vec3A};

use crate::block_cholesky::invert;
use crate::motor::drive;
use crate::soft_groups::match_soft_groups;
use crate::{ExplicitGroups, Particles, Sweep, extract_rotation};

/// A rigid group between the start of a substep and its end. In `f64`: a few bodies, whose momentum is summed up thousands of times a second and must not leak through rounding.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct RigidBody {
    /// Whether the group is rigid and closed in this substep.
    pub(crate) acting: bool,
    /// Whether its motion has changed since it was last written to its members.
    pub(crate) changed: bool,
    pub(crate) mass: f64,
    /// Centre of mass of the rest offsets \[m\]; not zero where joints share their mass.
    rest_center: DVec3,
    /// J in the group's axes at rest \[kg·m²\] and its inverse.
    pub(crate) inertia: DMat3,
    pub(crate) inverse_inertia: DMat3,
    /// P \[kg·m/s\] and L about the centre \[kg·m²/s\].
    pub(crate) linear: DVec3,
    pub(crate) angular: DVec3,
    /// Where the substep began.
    pub(crate) start: Pose,
    /// Where it ends.
    pub(crate) end: Pose,
    /// ω as last written to the members \[rad/s\], and what of it `f32` could not hold.
    pub(crate) spin: Vec3A,
    pub(crate) lost_spin: DVec3,
}

/// Place of the centre of mass and rotation since rest.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Pose {
    pub(crate) center: DVec3,
    pub(crate) rotation: DQuat,
}

/// What a group last made of a member.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Held {
    position: Vec3A,
    pub(crate) velocity: Vec3A,
    /// What the group's rigid motion has at the member and the member has not: rounding, and at a joint the half of what the two groups differ. Added when the member is read again, so that neither
    /// rounding nor the sharing of a joint changes a group's motion.
    pub(crate) lost_position: Vec3A,
    pub(crate) lost_velocity: Vec3A,
    /// The group's part of the member's mass \[kg\].
    pub(crate) mass: f32,
    /// How many rigid groups share the member, and whether its orientation and its spin are this one's.
    sharers: u32,
    pub(crate) carried: bool,
    pub(crate) pinned: [bool; 2],
}

impl RigidBody {
    pub(crate) fn start_from(&mut self, rotation: DQuat) {
        self.end.rotation = rotation;
        self.start.rotation = self.end.rotation;
    }

    /// ω at the rotation `q` \[rad/s\].
    pub(crate) fn spin_at(&self, q: DQuat) -> DVec3 {
        q * (self.inverse_inertia * (q.conjugate() * self.angular))
    }

    /// The rotation after `dt` \[s\] of free motion from `q`: the rigid midpoint step exp(ω·dt)·q with ω = J⁻¹L at the rotation half way, exp(ω·dt/2)·q, found by iteration.
    ///
    /// L stays fixed in space to the last bit, so that ω precesses as Euler's equations ask (the gyroscopic term) without decaying; the step is its own inverse with −dt. A turn of more than π is cut
    /// short to that; the iteration may then not converge, but stays finite.
    pub(crate) fn turn_freely(&self, q: DQuat, dt: f64) -> DQuat {
        let mut omega = self.spin_at(q);
        for _ in 0..20 {
            let next = self.spin_at(rotate(q, omega * (0.5 * dt)));
            let change = (next - omega).length_squared();
            omega = next;
            if change <= 1e-24 * omega.length_squared() {
                break;
            }
        }
        rotate(q, (omega * dt).clamp_length_max(core::f64::consts::PI))
    }

    /// Sets the end from the start and the momenta.
    pub(crate) fn advance(&mut self, dt: f64) {
        self.end = Pose { center: self.start.center + self.linear * (dt / self.mass), rotation: self.turn_freely(self.start.rotation, dt) };
    }

    /// Sets the start from the end and the momenta.
    fn step_back(&mut self, dt: f64) {
        self.start = Pose { center: self.end.center - self.linear * (dt / self.mass), rotation: self.turn_freely(self.end.rotation, -dt) };
    }

    /// From the centre of mass to the rest offset `rest` in the group's axes at rest \[m\].
    #[inline]
    pub(crate) fn arm(&self, rest: Vec3A) -> DVec3 {
        rest.as_dvec3() - self.rest_center
    }

    /// J⁻¹ in the world's axes at the rotation `q`.
    pub(crate) fn mobility(&self, q: DQuat) -> DMat3 {
        let r = DMat3::from_quat(q);
        r * self.inverse_inertia * r.transpose()
    }
}

/// `q` turned by the rotation vector `angle` \[rad\].
pub(crate) fn rotate(q: DQuat, angle: DVec3) -> DQuat {
    let a2 = angle.length_squared();
    let (s, c) = if a2 < 1e-6 {
        (0.5 - a2 * (1.0 / 48.0 - a2 / 3840.0), 1.0 - a2 * (0.125 - a2 / 384.0))
    } else {
        let a = a2.sqrt();
        (libm::sin(0.5 * a) / a, libm::cos(0.5 * a))
    };
    let v = angle * s;
    (DQuat::from_xyzw(v.x, v.y, v.z, c) * q).normalize()
}

/// Moves the rigid groups freely through a substep of `dt` \[s\], motors included, and puts their members there. To be called right after [`predict`](crate::predict), in whose place it moves the members.
///
/// A group's P and L, spin included, are read off its members where the substep began, with the velocities that `predict` left; its centre goes on at P/M, its rotation as free rigid bodies turn (see
/// `RigidBody::turn_freely`). Shape matching alone would lose spin, ω(t) = ω₀/√(1 + 2ω₀²Δt·t). Groups that share a particle or have pinned members are then held together by impulses: see `Joints`.
///
/// Deformable groups whose time is over close. Groups that are open or soft are left alone. A particle that two rigid groups share gives half its mass to each, and so on.
pub fn predict_explicit(groups: &mut ExplicitGroups, particles: &mut Particles, dt: f32) {
    if groups.is_empty() {
        return;
    }
    groups.pass_time(particles, dt);
    refresh(groups, particles, dt);
    let time = f64::from(dt);
    for g in 0..groups.len() {
        if groups.bodies[g].acting {
            read(groups, particles, g, true);
        }
    }
    drive(groups, particles, time);
    let ExplicitGroups { bodies, joints, shape, .. } = groups;
    joints.close_gaps(bodies, &shape.rest, particles);
    joints.hold_together(bodies, &shape.rest, particles, time);
    write(groups, particles);
}

/// Pulls the members of every soft group towards its shape, and makes the motion of every rigid group rigid again after other constraints have moved members.
///
/// *Rigid*: c and R are fitted to the members where they are now (A = Σ R_i·B_i + m_i·(x_i − c)(x̄_i − c̄)ᵀ, see [`match_shapes`](crate::match_shapes)), P and L are what they carry now, joints take up what they have to, and
/// the members get the place and the velocity of the rigid body. P and L are thus kept to the rounding of `f64`, where adding way/Δt would turn what is left of the way into spin. A group that nothing
/// has touched is not looked at.
///
/// *Soft*: as [`match_shapes`](crate::match_shapes), with the group's stiffness, and its angular momentum is restored afterwards; a shared particle is pulled by one group after the other.
pub fn match_explicit_groups(groups: &mut ExplicitGroups, particles: &mut Particles, sweep: Sweep) {
    match_soft_groups(groups, particles, sweep);
    hold_explicit_groups(groups, particles, sweep.dt);
}

/// The rigid half of [`match_explicit_groups`]: for what moves members outside the sweeps, a hand or the restoring of angular momentum, in a substep of `dt` \[s\]. To be called before contacts are solved,
/// since [`land_explicit_groups`](crate::land_explicit_groups) takes everything that it finds changed for a contact's doing.
pub fn hold_explicit_groups(groups: &mut ExplicitGroups, particles: &mut Particles, dt: f32) {
    let time = f64::from(dt);
    for g in 0..groups.len() {
        if groups.bodies[g].acting && is_touched(groups, particles, g) {
            read(groups, particles, g, false);
            let body = &mut groups.bodies[g];
            body.step_back(time);
            body.changed = true;
        }
    }
    finish(groups, particles, time);
}

/// Advances what has changed, holds it together and puts the members there.
pub(crate) fn finish(groups: &mut ExplicitGroups, particles: &mut Particles, dt: f64) {
    if groups.bodies.iter().any(|b| b.changed) {
        let ExplicitGroups { bodies, joints, shape, .. } = groups;
        joints.mark_neighbours(bodies);
        joints.hold_together(bodies, &shape.rest, particles, dt);
        write(groups, particles);
    }
}

/// Finds out which groups are rigid now, who shares which particle, what it weighs and what is pinned; makes the joints anew if any of that has changed. Other joints than before allocate; a substep that changes none does not.
fn refresh(groups: &mut ExplicitGroups, particles: &Particles, dt: f32) {
    let mut same = true;
    for g in 0..groups.len() {
        let acting = groups.is_rigid(g, dt);
        same &= acting == groups.bodies[g].acting;
        if acting && !groups.bodies[g].acting {
            groups.bodies[g].start_from(groups.shape.rotation[g].as_dquat());
        }
        groups.bodies[g].acting = acting;
        for k in groups.row(g) {
            let i = groups.shape.members[k] as usize;
            let pinned = [particles.inverse_mass[i] == 0.0, particles.inverse_inertia[i] == 0.0];
            let held = &groups.held[k];
            same &= held.pinned == pinned && (!acting || held.mass == particles.mass[i] / held.sharers.max(1) as f32);
        }
    }
    if !same {
        share_out(groups, particles);
    }
}

/// Finds out who shares which particle, and makes the joints of the groups that act.
pub(crate) fn share_out(groups: &mut ExplicitGroups, particles: &Particles) {
    groups.revision = groups.revision.wrapping_add(1);
    let mut sharers = core::mem::take(&mut groups.sharers);
    sharers.clear();
    sharers.resize(particles.len(), 0);
    for g in (0..groups.len()).filter(|&g| groups.bodies[g].acting) {
        for k in groups.row(g) {
            let i = groups.shape.members[k] as usize;
            groups.held[k].carried = sharers[i] == 0;
            sharers[i] += 1;
        }
    }
    for g in 0..groups.len() {
        for k in groups.row(g) {
            let i = groups.shape.members[k] as usize;
            let h = &mut groups.held[k];
            h.pinned = [particles.inverse_mass[i] == 0.0, particles.inverse_inertia[i] == 0.0];
            (h.lost_position, h.lost_velocity) = (Vec3A::ZERO, Vec3A::ZERO);
            h.sharers = sharers[i];
            h.mass = particles.mass[i] / sharers[i].max(1) as f32;
        }
        groups.bodies[g].lost_spin = DVec3::ZERO;
    }
    groups.sharers = sharers;
    groups.joints.build(&groups.bodies, &groups.shape, |k| groups.held[k].pinned);
}

/// Whether anything has changed at a member since the group put it where it was.
pub(crate) fn is_touched(groups: &ExplicitGroups, particles: &Particles, g: usize) -> bool {
    groups.row(g).any(|k| {
        let (i, h) = (groups.shape.members[k] as usize, &groups.held[k]);
        particles.position[i] != h.position
            || particles.velocity[i] != h.velocity
            || (h.carried && !h.pinned[1] && particles.angular_velocity[i] != groups.bodies[g].spin)
    })
}

/// Mass, inertia, momenta and pose of group `g`, from its members: where the substep began (into `start`) or where they are now (into `end`).
///
/// L is summed about the centre at the members' own places, so that it is the particles' angular momentum to the last bit whatever their distance from the rigid shape; only J is that of the shape.
pub(crate) fn read(groups: &mut ExplicitGroups, particles: &Particles, g: usize, at_start: bool) {
    let row = groups.row(g);
    let ExplicitGroups { bodies, held, shape, .. } = groups;
    let body = &mut bodies[g];
    let (x, q) =
        if at_start { (&particles.previous_position, &particles.previous_rotation) } else { (&particles.position, &particles.rotation) };
    let place = |k: usize, i: usize| x[i].as_dvec3() + held[k].lost_position.as_dvec3();
    let speed = |k: usize, i: usize| particles.velocity[i].as_dvec3() + held[k].lost_velocity.as_dvec3();

    let (mut mass, mut rest_center, mut center, mut linear) = (0.0, DVec3::ZERO, DVec3::ZERO, DVec3::ZERO);
    for k in row.clone() {
        let i = shape.members[k] as usize;
        let m = f64::from(held[k].mass);
        mass += m;
        rest_center += shape.rest[k].as_dvec3() * m;
        center += place(k, i) * m;
        linear += speed(k, i) * m;
    }
    rest_center /= mass;
    center /= mass;
    let velocity = linear / mass;

    let (mut a, mut inertia, mut angular) = (DMat3::ZERO, DMat3::ZERO, DVec3::ZERO);
    for k in row {
        let i = shape.members[k] as usize;
        let m = f64::from(held[k].mass);
        let d = place(k, i) - center;
        let r = shape.rest[k].as_dvec3() - rest_center;
        a += DMat3::from_cols(d * (m * r.x), d * (m * r.y), d * (m * r.z));
        angular += d.cross(speed(k, i) - velocity) * m;
        let round = m * r.length_squared();
        inertia += DMat3::from_diagonal(DVec3::splat(round)) - DMat3::from_cols(r * (m * r.x), r * (m * r.y), r * (m * r.z));
        if held[k].carried {
            let spin = f64::from(particles.inertia[i]);
            inertia += DMat3::from_diagonal(DVec3::splat(spin));
            angular += (particles.angular_velocity[i].as_dvec3() + body.lost_spin) * spin;
        }
        if !shape.unoriented[i] {
            a += (Mat3A::from_quat(q[i]) * shape.moment[i]).as_dmat3();
        }
    }
    let guess = body.end.rotation;
    let rotation = refine(
        a,
        extract_rotation(Mat3A::from_cols(a.x_axis.as_vec3a(), a.y_axis.as_vec3a(), a.z_axis.as_vec3a()), guess.as_quat()),
        guess,
    );
    body.mass = mass;
    body.rest_center = rest_center;
    body.inertia = inertia;
    body.inverse_inertia = invert_inertia(inertia);
    body.linear = linear;
    body.angular = angular;
    let pose = Pose { center, rotation };
    if at_start {
        body.start = pose;
        body.changed = true;
    } else {
        body.end = pose;
    }
}

/// J⁻¹, and for a needle of points without spin, which resists every turn but the one about itself, (J + t·n·nᵀ)⁻¹ − n·nᵀ/t with n along it and t the trace: it does not turn about itself. A little
/// inertia instead would let what rounding makes of L along n spin it ever faster. No other body of masses has a singular J, but a point, which gets zero.
fn invert_inertia(j: DMat3) -> DMat3 {
    let trace = j.x_axis.x + j.y_axis.y + j.z_axis.z;
    // Columns of the adjugate, all along n if J·n = 0.
    let adjugate = [j.y_axis.cross(j.z_axis), j.z_axis.cross(j.x_axis), j.x_axis.cross(j.y_axis)];
    if adjugate[0].dot(j.x_axis) > 1e-9 * trace * trace * trace {
        return invert(j);
    }
    let n = adjugate.into_iter().fold(DVec3::ZERO, |best, c| if c.length_squared() > best.length_squared() { c } else { best });
    let n = n.normalize_or_zero();
    let along = DMat3::from_cols(n * n.x, n * n.y, n * n.z);
    let inverse = invert(j + along * trace) - along * (1.0 / trace);
    if inverse.is_finite() { inverse } else { DMat3::ZERO }
}

/// The rotation of polar(A) to the digits of `f64`, from `found`, its value in `f32`, or from `guess` if that is as near: Newton's steps as in [`extract_rotation`]. What A leaves open is left alone.
fn refine(a: DMat3, found: Quat, guess: DQuat) -> DQuat {
    let found = found.as_dquat();
    let mut q = if found.dot(guess).abs() > 1.0 - 1e-12 { guess } else { found.normalize() };
    for _ in 0..2 {
        let m = a * DMat3::from_quat(q).transpose();
        let g = DVec3::new(m.y_axis.z - m.z_axis.y, m.z_axis.x - m.x_axis.z, m.x_axis.y - m.y_axis.x);
        let trace = m.x_axis.x + m.y_axis.y + m.z_axis.z;
        let h = DMat3::from_diagonal(DVec3::splat(trace * (1.0 + 1e-9))) - (m + m.transpose()) * 0.5;
        let step = invert(h) * g;
        if step.length_squared() >= 1e-6 || !step.is_finite() {
            break;
        }
        q = rotate(q, step);
    }
    q
}

/// Puts the members of the changed groups where these end, with their velocities. A shared member gets the mean.
fn write(groups: &mut ExplicitGroups, particles: &mut Particles) {
    let ExplicitGroups { bodies, held, shape, .. } = groups;
    for pass in 0..3 {
        for (g, body) in bodies.iter_mut().enumerate().filter(|(_, b)| b.acting && b.changed) {
            let rotation = DMat3::from_quat(body.end.rotation);
            let velocity = body.linear / body.mass;
            let omega = body.spin_at(body.end.rotation);
            if pass == 0 {
                body.spin = omega.as_vec3a();
                body.lost_spin = omega - body.spin.as_dvec3();
                shape.rotation[g] = body.end.rotation.as_quat();
            }
            let row = shape.rows[g] as usize..shape.rows[g + 1] as usize;
            for ((&i, &rest), h) in shape.members[row.clone()].iter().zip(&shape.rest[row.clone()]).zip(&mut held[row]) {
                let i = i as usize;
                let arm = rotation * body.arm(rest);
                let (x, v) = (body.end.center + arm, velocity + omega.cross(arm));
                match pass {
                    0 => {
                        if !h.pinned[0] {
                            let alone = h.sharers <= 1;
                            particles.position[i] = if alone { x.as_vec3a() } else { Vec3A::ZERO };
                            particles.velocity[i] = if alone { v.as_vec3a() } else { Vec3A::ZERO };
                        }
                        if h.carried && !h.pinned[1] {
                            particles.rotation[i] = shape.rotation[g];
                            particles.angular_velocity[i] = body.spin;
                        }
                    }
                    1 if h.sharers > 1 && !h.pinned[0] => {
                        let part = 1.0 / f64::from(h.sharers);
                        particles.position[i] += (x * part).as_vec3a();
                        particles.velocity[i] += (v * part).as_vec3a();
                    }
                    2 => {
                        (h.position, h.velocity) = (particles.position[i], particles.velocity[i]);
                        h.lost_position = (x - h.position.as_dvec3()).as_vec3a();
                        h.lost_velocity = (v - h.velocity.as_dvec3()).as_vec3a();
                    }
                    _ => {}
                }
            }
        }
    }
    for body in bodies {
        body.changed = false;
    }
}
