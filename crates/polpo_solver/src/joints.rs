//! Joints: the impulses that hold rigid groups together where they share a particle, and to what is pinned.

use glam::{DMat3, DQuat, DVec3, Quat, Vec3A};

use crate::block_cholesky::BlockCholesky;
use crate::rigid_groups::{RigidBody, rotate};
use crate::{ImplicitGroups, Particles};

/// All joints of one body's groups, solved at once.
///
/// SHAKE for rigid bodies: impulses at the joints, given where the substep *began*, such that the joints are closed where it *ends*. Newton's method on the gaps C(λ), with the matrix
///
/// ```text
/// K_ij = Δt·Σ ±(1/M·I − [r_i]·J⁻¹·[r_j])        over the groups that joints i and j have in common
/// ```
///
/// at the arms r half way, where it is symmetric to second order, factorised directly: one pass holds a chain of any length, which Gauss–Seidel over its joints would leave sagging. Because both
/// groups of a joint get their impulse at one point, P and L are kept exactly however far Newton has come, and because only momenta are changed the energy of a swinging chain does not drift.
///
/// Of a second particle in the same two groups only the two directions across the line to the first are asked for, of a third only the one across the plane of all three: the distances between them no
/// group can change, and asking for them would make K singular. Loops of hinges do so all the same; a diagonal larger by `SLACK` then keeps small the impulses that do nothing.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Joints {
    list: Vec<Joint>,
    /// Pairs of joints and the group they have in common, with the product of their signs there.
    common: Vec<Common>,
    matrix: BlockCholesky,
    /// Per joint, the arms on its two sides and its impulse.
    arms: Vec<[DVec3; 2]>,
    impulse: Vec<DVec3>,
    mobility: Vec<DMat3>,
    /// Per joint, what of the gap cannot be closed \[m\] or \[rad\]; the impulse given so far, and before the last try.
    left: Vec<DVec3>,
    given: Vec<DVec3>,
    last: Vec<DVec3>,
    /// Per group, P and L before the last try.
    saved: Vec<[DVec3; 2]>,
    /// Per joint, the projection on the directions it asks for.
    asked: Vec<DMat3>,
    /// Scratch of `build`: what might be a joint, with its place; per particle, the first group that has it; the joints as they were.
    candidates: Vec<(Joint, Vec3A)>,
    first: Vec<Option<[u32; 2]>>,
    before: Vec<Joint>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    /// A group keeps a member's pinned orientation.
    Turned,
    /// A group keeps a member's pinned position.
    Pinned,
    /// Two groups meet at a particle.
    Shared,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Joint {
    kind: Kind,
    particle: u32,
    /// The groups; `NOBODY` for the world.
    groups: [u32; 2],
    /// The row entries of the particle there.
    entries: [u32; 2],
    /// The row entries, in the first group, of up to two particles that hold already; itself where there is none.
    holding: [u32; 2],
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Common {
    joints: [u32; 2],
    sides: [u8; 2],
    group: u32,
}

const NOBODY: u32 = u32::MAX;
const SLACK: f64 = 1e-5;
const STEPS: usize = 5;
/// Gaps below this share of the arms' length are closed.
const TOLERANCE: f64 = 1e-8;
/// Gaps at the start of a substep above this share of the arms' length are nobody's motion: closed without momentum.
const OLD_GAP: f64 = 1e-4;

impl Joints {
    /// The joints of the groups that act: between each shared particle's first group and the others, and to the world where members are pinned.
    ///
    /// Of more than three particles in the same two groups, or pinned in one group, the three that span most are taken: the rest is held by them. Where the joints are those that were there, which they are
    /// when a group without joints opens or closes, nothing is allocated.
    pub(crate) fn build(&mut self, bodies: &[RigidBody], shape: &ImplicitGroups, pinned: impl Fn(usize) -> [bool; 2]) {
        let Self { candidates, first, .. } = self;
        candidates.clear();
        first.clear();
        first.resize(shape.moment.len(), None);
        for g in (0..bodies.len()).filter(|&g| bodies[g].acting) {
            let mut turned = false;
            for k in shape.rows[g]..shape.rows[g + 1] {
                let particle = shape.members[k as usize];
                let [position, orientation] = pinned(k as usize);
                let world =
                    |kind| (Joint { kind, particle, groups: [g as u32, NOBODY], entries: [k, k], holding: [k; 2] }, shape.rest[k as usize]);
                if position {
                    candidates.push(world(Kind::Pinned));
                } else if let Some([group, entry]) = first[particle as usize] {
                    candidates.push((
                        Joint { kind: Kind::Shared, particle, groups: [group, g as u32], entries: [entry, k], holding: [entry; 2] },
                        shape.rest[entry as usize],
                    ));
                } else {
                    first[particle as usize] = Some([g as u32, k]);
                }
                if orientation && !turned && !shape.unoriented[particle as usize] {
                    candidates.push(world(Kind::Turned));
                    turned = true;
                }
            }
        }
        // No two are alike in all three.
        candidates.sort_unstable_by_key(|(j, _)| (j.groups, j.kind as u8, j.entries[1]));
        core::mem::swap(&mut self.list, &mut self.before);
        self.list.clear();
        for same in self.candidates.chunk_by(|a, b| (a.0.groups, a.0.kind) == (b.0.groups, b.0.kind)) {
            let (chosen, mut count) = widest(same);
            let turned = self.list.last().is_some_and(|j| j.kind == Kind::Turned && j.groups == same[0].0.groups);
            if turned {
                count = 1;
            }
            for (n, &k) in chosen[..count].iter().enumerate() {
                let mut joint = same[k].0;
                for (held, &other) in joint.holding.iter_mut().zip(&chosen[..n]) {
                    *held = same[other].0.entries[0];
                }
                self.list.push(joint);
            }
        }
        if self.list == self.before && self.mobility.len() == bodies.len() {
            return;
        }

        self.common.clear();
        for (i, a) in self.list.iter().enumerate() {
            for (j, b) in self.list[..=i].iter().enumerate() {
                for s in 0..2u8 {
                    for t in 0..2u8 {
                        let group = a.groups[s as usize];
                        if group != NOBODY && group == b.groups[t as usize] {
                            self.common.push(Common { joints: [i as u32, j as u32], sides: [s, t], group });
                        }
                    }
                }
            }
        }
        let pairs: Vec<[u32; 2]> = self.common.iter().map(|c| c.joints).collect();
        let n = self.list.len();
        self.matrix = BlockCholesky::new(n, &pairs);
        self.arms = vec![[DVec3::ZERO; 2]; n];
        self.impulse = vec![DVec3::ZERO; n];
        self.left = vec![DVec3::ZERO; n];
        self.given = vec![DVec3::ZERO; n];
        self.asked = vec![DMat3::IDENTITY; n];
        self.mobility = vec![DMat3::ZERO; bodies.len()];
    }

    /// Marks the groups that joints connect with a changed one, at any remove, as changed.
    pub(crate) fn mark_neighbours(&self, bodies: &mut [RigidBody]) {
        let mut more = true;
        while more {
            more = false;
            for joint in self.list.iter().filter(|j| j.kind == Kind::Shared) {
                let [a, b] = joint.groups.map(|g| g as usize);
                if bodies[a].changed != bodies[b].changed {
                    (bodies[a].changed, bodies[b].changed, more) = (true, true, true);
                }
            }
        }
    }

    /// Closes the joints where the substep began, by moving the groups without a velocity, if they are wide open: after a start apart, a teleport, an inflation. Otherwise does nothing. What cannot be closed,
    /// because pins or groups contradict each other, is `left` open and no impulse is spent on it.
    pub(crate) fn close_gaps(&mut self, bodies: &mut [RigidBody], rest: &[Vec3A], particles: &Particles) {
        self.left.fill(DVec3::ZERO);
        let (x, q) = (&particles.previous_position, &particles.previous_rotation);
        stay(bodies);
        let (mut open, mut miss) = self.gaps(bodies, rest, x, q, OLD_GAP);
        let mut slack = SLACK;
        for _ in 0..STEPS {
            if !open {
                return;
            }
            self.solve(bodies, rest, 1.0, slack);
            for (joint, &p) in self.list.iter().zip(&self.impulse) {
                for (side, p) in [(0, p), (1, -p)] {
                    let Some(body) = bodies.get_mut(joint.groups[side] as usize) else { continue };
                    let turn = if joint.kind == Kind::Turned {
                        p
                    } else {
                        body.end.center += p / body.mass;
                        (body.start.rotation * body.arm(rest[joint.entries[side] as usize])).cross(p)
                    };
                    let turn = body.mobility(body.start.rotation) * turn;
                    body.end.rotation = rotate(body.end.rotation, turn.clamp_length_max(0.5));
                }
            }
            let now = self.gaps(bodies, rest, x, q, TOLERANCE);
            if now.1 < miss {
                (open, miss) = now;
                for body in bodies.iter_mut().filter(|b| b.acting) {
                    body.start = body.end;
                }
            } else {
                slack *= 100.0;
                stay(bodies);
                self.gaps(bodies, rest, x, q, TOLERANCE);
            }
        }
        if self.gaps(bodies, rest, x, q, OLD_GAP).0 {
            self.left.clone_from(&self.impulse);
        }
    }

    /// Advances the changed groups through the substep of `dt` \[s\] and changes their momenta until the joints are closed at its end.
    ///
    /// By Newton's plain steps, if they come nearer. If they do not, from the beginning by careful ones (Levenberg and Marquardt's way): a step that opens the joints further is taken back and made shorter,
    /// by a hundred times the slack. Joints that ask for the same thing twice contradict each other in second order and spend ever larger impulses on it, which would do nothing only if the arms did not turn.
    pub(crate) fn hold_together(&mut self, bodies: &mut [RigidBody], rest: &[Vec3A], particles: &mut Particles, dt: f64) {
        advance(bodies, dt);
        let (open, miss) = self.gaps(bodies, rest, &particles.position, &particles.rotation, TOLERANCE);
        if !open {
            return;
        }
        self.save(bodies);
        self.given.fill(DVec3::ZERO);
        let mut now = (open, miss);
        for _ in 0..STEPS {
            now = self.try_step(bodies, rest, particles, dt, SLACK);
            if !now.0 {
                break;
            }
        }
        if now.0 && (now.1 >= 0.01 * miss || now.1.is_nan()) {
            self.given.fill(DVec3::ZERO);
            self.take_back(bodies, rest, particles, dt);
            self.hold_carefully(bodies, rest, particles, dt, miss);
        }
        for (joint, &p) in self.list.iter().zip(&self.given).filter(|(j, _)| j.kind == Kind::Pinned) {
            if let Some(reaction) = particles.reaction.get_mut(joint.particle as usize) {
                *reaction -= p.as_vec3a();
            }
        }
    }

    #[cold]
    fn hold_carefully(&mut self, bodies: &mut [RigidBody], rest: &[Vec3A], particles: &Particles, dt: f64, mut miss: f64) {
        let mut slack = SLACK;
        for _ in 0..2 * STEPS {
            self.save(bodies);
            self.last.clone_from(&self.given);
            let (open, now) = self.try_step(bodies, rest, particles, dt, slack);
            if !open {
                return;
            }
            if now < miss {
                miss = now;
                slack = SLACK.max(slack * 0.01);
            } else {
                self.given.clone_from(&self.last);
                self.take_back(bodies, rest, particles, dt);
                slack *= 100.0;
            }
        }
    }

    /// One step of Newton's method from the gaps found last. Tells whether joints are open then, and by how much.
    fn try_step(&mut self, bodies: &mut [RigidBody], rest: &[Vec3A], particles: &Particles, dt: f64, slack: f64) -> (bool, f64) {
        self.solve(bodies, rest, dt, slack);
        for (sum, &p) in self.given.iter_mut().zip(&self.impulse) {
            *sum += p;
        }
        self.push(bodies, rest);
        advance(bodies, dt);
        self.gaps(bodies, rest, &particles.position, &particles.rotation, TOLERANCE)
    }

    fn save(&mut self, bodies: &[RigidBody]) {
        self.saved.clear();
        self.saved.extend(bodies.iter().map(|b| [b.linear, b.angular]));
    }

    fn take_back(&mut self, bodies: &mut [RigidBody], rest: &[Vec3A], particles: &Particles, dt: f64) {
        for (body, &[linear, angular]) in bodies.iter_mut().zip(&self.saved) {
            (body.linear, body.angular) = (linear, angular);
        }
        advance(bodies, dt);
        self.gaps(bodies, rest, &particles.position, &particles.rotation, TOLERANCE);
    }

    /// Gives the groups the impulses, where the substep began.
    fn push(&self, bodies: &mut [RigidBody], rest: &[Vec3A]) {
        for (joint, &p) in self.list.iter().zip(&self.impulse) {
            if joint.kind == Kind::Turned {
                bodies[joint.groups[0] as usize].angular += p;
                continue;
            }
            let at = |side: usize| {
                let body = &bodies[joint.groups[side] as usize];
                body.start.center + body.start.rotation * body.arm(rest[joint.entries[side] as usize])
            };
            let point = if joint.kind == Kind::Shared { (at(0) + at(1)) * 0.5 } else { at(0) };
            for (side, p) in [(0, p), (1, -p)] {
                let Some(body) = bodies.get_mut(joint.groups[side] as usize) else { continue };
                body.linear += p;
                body.angular += (point - body.start.center).cross(p);
            }
        }
    }

    /// Writes minus the gaps at the groups' ends into `impulse`, against the pinned places `x` and orientations `q` and less those that are left open; tells whether any is above `tolerance`, and the sum of their
    /// squares.
    fn gaps(&mut self, bodies: &[RigidBody], rest: &[Vec3A], x: &[Vec3A], q: &[Quat], tolerance: f64) -> (bool, f64) {
        let (mut open, mut miss) = (false, 0.0);
        for (((gap, asked), joint), &left) in self.impulse.iter_mut().zip(&mut self.asked).zip(&self.list).zip(&self.left) {
            let arm = |side: usize| {
                let body = &bodies[joint.groups[side] as usize];
                let arm = body.end.rotation * body.arm(rest[joint.entries[side] as usize]);
                (body.end.center + arm, arm.length())
            };
            let size;
            (*gap, size) = match joint.kind {
                Kind::Shared => {
                    let ((a, r), (b, s)) = (arm(0), arm(1));
                    (b - a, r + s)
                }
                Kind::Pinned => {
                    let (a, r) = arm(0);
                    (x[joint.particle as usize].as_dvec3() - a, r)
                }
                Kind::Turned => {
                    (log(q[joint.particle as usize].as_dquat() * bodies[joint.groups[0] as usize].end.rotation.conjugate()), 1.0)
                }
            };
            let body = &bodies[joint.groups[0] as usize];
            let [own, first, second] = [joint.entries[0], joint.holding[0], joint.holding[1]].map(|k| rest[k as usize]);
            if joint.holding[0] != joint.entries[0] {
                *asked = across(body.end.rotation * (first - own).as_dvec3(), body.end.rotation * (second - own).as_dvec3());
                *gap = *asked * *gap;
            }
            *gap -= left;
            // Pinned places are f32: more digits than they have are not asked for.
            let floor = if joint.kind == Kind::Shared { 0.0 } else { 1e-9 };
            open |= gap.length() > tolerance * size + floor;
            miss += gap.length_squared();
        }
        (open, miss)
    }

    /// Solves for the impulses, given minus the gaps; `slack` larger on the diagonal.
    fn solve(&mut self, bodies: &[RigidBody], rest: &[Vec3A], dt: f64, slack: f64) {
        for (m, body) in self.mobility.iter_mut().zip(bodies).filter(|(_, b)| b.acting) {
            *m = body.mobility(half_way(body));
        }
        for (arms, joint) in self.arms.iter_mut().zip(&self.list) {
            for side in 0..2 {
                if let Some(body) = bodies.get(joint.groups[side] as usize) {
                    let r = body.arm(rest[joint.entries[side] as usize]);
                    arms[side] = (body.start.rotation * r + body.end.rotation * r) * 0.5;
                }
            }
        }
        self.matrix.clear();
        for c in &self.common {
            let [i, j] = c.joints.map(|j| j as usize);
            let [s, t] = c.sides.map(usize::from);
            let body = &bodies[c.group as usize];
            let w = self.mobility[c.group as usize];
            // What joint j's impulse does to the velocity, or the spin, that joint i sees.
            let spin = if self.list[j].kind == Kind::Turned { w } else { w * skew(self.arms[j][t]) };
            let mut block = if self.list[i].kind == Kind::Turned { spin } else { -skew(self.arms[i][s]) * spin };
            if self.list[i].kind != Kind::Turned && self.list[j].kind != Kind::Turned {
                block += DMat3::from_diagonal(DVec3::splat(1.0 / body.mass));
            }
            self.matrix.add(i, j, self.asked[i] * block * self.asked[j] * if s == t { dt } else { -dt });
            if i == j {
                // What is not asked for takes no impulse, whatever is on the diagonal.
                self.matrix.add(i, i, (DMat3::IDENTITY - self.asked[i]) * (dt / body.mass));
            }
        }
        self.matrix.regularise(slack);
        self.matrix.solve(&mut self.impulse);
    }
}

fn stay(bodies: &mut [RigidBody]) {
    for body in bodies.iter_mut().filter(|b| b.acting) {
        body.end = body.start;
    }
}

fn advance(bodies: &mut [RigidBody], dt: f64) {
    for body in bodies.iter_mut().filter(|b| b.acting && b.changed) {
        body.advance(dt);
    }
}

fn half_way(body: &RigidBody) -> DQuat {
    let (a, b) = (body.start.rotation, body.end.rotation);
    let sum = if a.dot(b) < 0.0 { a + -b } else { a + b };
    sum.normalize()
}

/// The rotation vector of `q`, the short way round \[rad\].
fn log(q: DQuat) -> DVec3 {
    let v = DVec3::new(q.x, q.y, q.z) * q.w.signum();
    let s = v.length();
    if s > 1e-12 { v * (2.0 * libm::atan2(s, q.w.abs()) / s) } else { v * 2.0 }
}

/// The projection on what is across `a`, and across `b` too unless that is the same or zero.
fn across(a: DVec3, b: DVec3) -> DMat3 {
    let normal = a.cross(b);
    if normal.length_squared() > 1e-12 * a.length_squared() * b.length_squared() {
        let n = normal.normalize();
        DMat3::from_cols(n * n.x, n * n.y, n * n.z)
    } else {
        let n = a.normalize_or_zero();
        DMat3::IDENTITY - DMat3::from_cols(n * n.x, n * n.y, n * n.z)
    }
}

/// The matrix that takes the cross product with `r` from the left.
fn skew(r: DVec3) -> DMat3 {
    DMat3::from_cols(DVec3::new(0.0, r.z, -r.y), DVec3::new(-r.z, 0.0, r.x), DVec3::new(r.y, -r.x, 0.0))
}

/// Of points: the first, the farthest from it, and the farthest from the line through both, if it is not on that line. With how many that are.
fn widest(points: &[(Joint, Vec3A)]) -> ([usize; 3], usize) {
    let farthest = |distance: &dyn Fn(Vec3A) -> f32| {
        (0..points.len()).fold(0, |best, k| if distance(points[k].1) > distance(points[best].1) { k } else { best })
    };
    let a = points[0].1;
    let second = farthest(&|x| x.distance_squared(a));
    let along = (points[second].1 - a).normalize_or_zero();
    let off_line = |x: Vec3A| (x - a).cross(along).length_squared();
    let third = farthest(&off_line);
    let count = if second == 0 {
        1
    } else if off_line(points[third].1) > 1e-6 * points[second].1.distance_squared(a) {
        3
    } else {
        2
    };
    ([0, second, third], count)
}
