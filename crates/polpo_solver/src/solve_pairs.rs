//! Stage 3: particles leave each other, in one body or between two, with friction.
//!
//! A long file, because how two particles touch and what the touch does to them share all of their state.

use glam::{Quat, Vec3A};

use crate::ellipsoid_pair::EllipsoidPair;
use crate::pairs::{Pair, nearest};
use crate::shape_matching::turned;
use crate::{Ellipsoid, Pairs, Particles};

/// Whose particles the pairs are.
#[derive(Debug)]
pub enum Sides<'a> {
    /// Of one body.
    Within {
        /// The body.
        particles: &'a mut Particles,
        /// What [`find_support`](crate::find_support) found for it.
        support: &'a [Vec3A],
    },
    /// Of two.
    Between {
        /// The body of each pair's first particle.
        first: &'a mut Particles,
        /// That of the second.
        second: &'a mut Particles,
        /// The second's origin, seen from the first's \[m\].
        offset: Vec3A,
        /// Whether the first, the second stands still whatever touches it.
        held: [bool; 2],
        /// What [`find_support`](crate::find_support) found for the first, the second.
        support: [&'a [Vec3A]; 2],
    },
}

/// Only from something heavier by this factor is a particle on a collider taken for immovable: lighter ones are thrown to and fro little, and then momentum need not go to the collider. In heaps of bodies alike it would make
/// the heap tremble.
const CRUSHING: f32 = 80.0;
/// A push that goes into a collider at less than this cosine from its normal slides along it.
const INTO: f32 = 0.5;

/// How pairs are solved in a substep.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PairRules {
    /// Length of the substep \[s\].
    pub dt: f32,
    /// Coulomb's coefficient μ, 0 … ∞.
    pub friction: f32,
    /// The speed at most at which an overlap is undone that was there when the substep began \[m/s\], 0 … ∞. As in [`solve_contacts`](crate::solve_contacts), a negative one would deepen it and NaN undo it at once: whoever
    /// takes it from others refuses that.
    pub push_speed: f32,
}

/// How often a substep goes over the pairs: what leaves one neighbour may be pressed into the next.
pub const PAIR_PASSES: u32 = 2;

/// No contact turns a particle by more than this in one go \[rad\], see [`solve_contacts`](crate::solve_contacts).
const LARGEST_TURN: f32 = 0.5;

/// Solves every pair once; `pass` counts up to [`PAIR_PASSES`] in a substep.
///
/// *Normal.* Along the pair's normal n the gap is C = n·d − h₁ − h₂ (see [`EllipsoidPair`]). Both are pushed at one point, midway between their outermost points, at r₁ and r₂ from the centres: with
/// W = Σ 1/m + |r×n|²/I the impulse −C/W. The way goes into the velocities as far as it stops what was approaching, and no further: so a contact takes energy and never gives any. What then is left of the overlap
/// (what others made of it, what the linear step left) is undone in the positions alone.
///
/// An overlap that was there when the substep began is undone in the positions alone as well, within about 1/60 s but at no more than `push_speed`: what was spawned inside another leaves it without having been shot out. If
/// [`Pairs::way_out`] is set, along that.
///
/// *Friction.* Coulomb's law on the way that the contact points have slipped over each other during the substep, as in [`solve_contacts`](crate::solve_contacts), and with the substep's normal impulse as its bound. It,
/// too, goes into the velocities as far as it stops them.
///
/// *Sides.* A pair that moves by more than half its thickness in the substep and was apart before it is held by the plane where it met on its way. A normal does not turn by more than a right angle in a
/// substep while the two overlap: what is pressed deep keeps its side.
///
/// *Momentum.* All impulses are equal and opposite at one point, so P is kept to rounding. L = Σ m·x×v would be kept only at the places where the impulses act: moving two particles by the way ±Δ/m
/// afterwards changes it by Δ×(v₁ − v₂). That is taken back, as a skater's arms do it: from the two's turning about each other, and, the little there is about the line of centres, from their spins. That may cost or give a few
/// thousandths of the energy of a pair that slips by a tenth of its radius a substep.
///
/// Degenerate: pairs of particles that do not exist or are not finite are skipped; of two that cannot be moved nothing is.
pub fn solve_pairs(pairs: &mut Pairs, sides: &mut Sides, rules: &PairRules, pass: u32) {
    let runs = rules.dt > 0.0 && rules.dt.is_finite();
    if !runs {
        return;
    }
    let way_out = pairs.way_out;
    for pair in &mut pairs.list {
        if pass == 0 {
            pair.impulse = 0.0;
            pair.approach = 0.0;
            pair.friction = Vec3A::ZERO;
        }
        if let Some(touch) = look(pair, sides, way_out) {
            pair.touching = true;
            resolve(pair, sides, &touch, way_out.is_some(), rules);
        }
    }
}

/// An overlap.
struct Touch {
    /// From the first to the second.
    normal: Vec3A,
    /// Negative \[m\].
    gap: f32,
    /// What it was when the substep began \[m\].
    before: f32,
    /// Where they touch, from the first's centre \[m\].
    point: Vec3A,
}

impl Sides<'_> {
    fn side(&self, k: usize) -> (&Particles, Vec3A, bool) {
        match self {
            Sides::Within { particles, .. } => (particles, Vec3A::ZERO, false),
            Sides::Between { first, held, .. } if k == 0 => (first, Vec3A::ZERO, held[0]),
            Sides::Between { second, offset, held, .. } => (second, *offset, held[1]),
        }
    }

    fn side_mut(&mut self, k: usize) -> (&mut Particles, Vec3A, bool) {
        match self {
            Sides::Within { particles, .. } => (particles, Vec3A::ZERO, false),
            Sides::Between { first, held, .. } if k == 0 => (first, Vec3A::ZERO, held[0]),
            Sides::Between { second, offset, held, .. } => (second, *offset, held[1]),
        }
    }

    /// Whether a particle pressed along `push` lies on something that bears it.
    fn is_supported(&self, k: usize, i: usize, push: Vec3A) -> bool {
        let support = match self {
            Sides::Within { support, .. } => support,
            Sides::Between { support, .. } => support[k],
        };
        support.get(i).is_some_and(|n| n.dot(push) < -INTO)
    }

    /// Where a particle is and was when the substep began.
    #[inline]
    fn places(&self, k: usize, i: usize) -> Option<[Vec3A; 2]> {
        let (p, origin, held) = self.side(k);
        let now = *p.position.get(i)? + origin;
        Some([now, if held { now } else { p.previous_position[i] + origin }])
    }

    fn ellipsoid(&self, k: usize, i: usize) -> Ellipsoid {
        self.side(k).0.ellipsoid(i)
    }

    fn ellipsoid_before(&self, k: usize, i: usize) -> Ellipsoid {
        let (p, _, held) = self.side(k);
        let rotation = if held { p.rotation[i] } else { p.previous_rotation[i] };
        Ellipsoid { radii: p.radii[i], orientation: rotation * p.frame[i] }
    }
}

/// Whether the two overlap, and how. Keeps the pair's normal up to date.
fn look(pair: &mut Pair, sides: &Sides, way_out: Option<Vec3A>) -> Option<Touch> {
    let [i, j] = pair.particles.map(|i| i as usize);
    let ([xa, xa0], [xb, xb0]) = (sides.places(0, i)?, sides.places(1, j)?);
    let (d, d0) = (xb - xa, xb0 - xa0);
    let way = d - d0;
    let fast = way.length_squared() > (0.5 * pair.thickness).powi(2);
    let closest = if fast { nearest(d0, way) } else { d };
    // Neither is what is not finite.
    let near = closest.length_squared() < pair.reach * pair.reach;
    if !near {
        pair.known = false;
        return None;
    }
    let mut touch = if pair.round { look_at_spheres(pair, sides, d, d0, fast) } else { look_at_ellipsoids(pair, sides, d, d0, fast) }?;
    if let Some(out) = way_out {
        // Which of them overlap is theirs to say; where to, the bodies'.
        let e = [sides.ellipsoid(0, i), sides.ellipsoid(1, j)];
        let along = EllipsoidPair::new(&e[0], &e[1], d).along(out);
        touch = Touch { normal: out, gap: along.gap, before: along.gap + out.dot(d0 - d), point: 0.5 * d };
    }
    Some(touch)
}

fn look_at_spheres(pair: &mut Pair, sides: &Sides, d: Vec3A, d0: Vec3A, fast: bool) -> Option<Touch> {
    let reach = pair.reach;
    let before = d0.length() - reach;
    let mut normal = d.try_normalize().unwrap_or(pair.normal);
    if fast && before >= 0.0 {
        // |d0 + t·way| = reach, the first time.
        let way = d - d0;
        let (a, b) = (way.length_squared(), d0.dot(way));
        let root = b * b - a * (before * (before + 2.0 * reach));
        let t = (-b - root.max(0.0).sqrt()) / a;
        let meet = b < 0.0 && root >= 0.0 && t <= 1.0;
        if !meet {
            return None;
        }
        normal = ((d0 + way * t) / reach).normalize();
    } else if pair.known && normal.dot(pair.normal) < 0.0 {
        normal = pair.normal;
    }
    (pair.normal, pair.known) = (normal, true);
    let gap = normal.dot(d) - reach;
    let overlap = gap < 0.0;
    if !overlap {
        return None;
    }
    let first = sides.side(0).0.radii[pair.particles[0] as usize].x;
    Some(Touch { normal, gap, before, point: normal * (first + 0.5 * gap) })
}

fn look_at_ellipsoids(pair: &mut Pair, sides: &Sides, d: Vec3A, d0: Vec3A, fast: bool) -> Option<Touch> {
    let [i, j] = pair.particles.map(|i| i as usize);
    let both = EllipsoidPair::new(&sides.ellipsoid(0, i), &sides.ellipsoid(1, j), d);
    if pair.known && !fast && both.gap_along(pair.normal) >= 0.0 {
        return None;
    }
    let mut met = None;
    if fast {
        match sweep(pair, &both.at(d0), d - d0) {
            Path::Clear => return None,
            Path::Meets(normal) => met = Some(normal),
            Path::Inside => {}
        }
    }
    let before_is_clear = met.is_some();
    let found = match met {
        Some(normal) => both.along(normal),
        None if pair.known => {
            let found = both.contact_near(pair.normal);
            if found.normal.dot(pair.normal) < 0.0 { both.along(pair.normal) } else { found }
        }
        None => both.contact(),
    };
    let normal_before = core::mem::replace(&mut pair.normal, found.normal);
    if !found.normal.is_finite() {
        (pair.normal, pair.known) = (normal_before, false);
        return None;
    }
    let was_known = core::mem::replace(&mut pair.known, true);
    let overlap = found.gap < 0.0;
    if !overlap {
        return None;
    }
    let before = if before_is_clear {
        0.0
    } else {
        let e = [sides.ellipsoid_before(0, i), sides.ellipsoid_before(1, j)];
        let gap = |n: Vec3A| n.dot(d0) - e[0].support(n).0 - e[1].support(n).0;
        let now = gap(found.normal);
        // Each direction's gap is a bound from below.
        if now < 0.0 && was_known { now.max(gap(normal_before)) } else { now }
    };
    Some(Touch { normal: found.normal, gap: found.gap, before, point: 0.5 * (found.reach[0] + found.reach[1] + d) })
}

/// What two ellipsoids meet with on the way of one past the other.
enum Path {
    /// Nothing.
    Clear,
    /// They overlap at its start.
    Inside,
    /// They meet, with this normal.
    Meets(Vec3A),
}

/// Conservative advancement: the gap along a normal is a bound for the gap all along the way, so going on until that bound is zero never goes too far. The distance is convex along a line, which makes
/// this Newton's method from one side.
fn sweep(pair: &Pair, start: &EllipsoidPair, way: Vec3A) -> Path {
    let mut found = if pair.known { start.contact_near(pair.normal) } else { start.contact() };
    if pair.known && found.gap < 0.0 {
        found = start.contact();
    }
    // A thousandth of an overlap is where the last substep left them.
    let apart = found.gap > -1e-3 * pair.thickness;
    if !apart {
        return Path::Inside;
    }
    let mut t = 0.0;
    for _ in 0..16 {
        let closing = -found.normal.dot(way);
        let meet = closing > 0.0;
        if !meet {
            return Path::Clear;
        }
        t += found.gap.max(0.0) / closing;
        if t >= 1.0 {
            return Path::Clear;
        }
        if found.gap < 1e-3 * pair.thickness {
            break;
        }
        found = start.moved(way * t).contact_near(found.normal);
    }
    Path::Meets(found.normal)
}

/// A particle while a pair is solved, in the first body's coordinates.
struct End {
    x: Vec3A,
    v: Vec3A,
    q: Quat,
    spin: Vec3A,
    /// Inverse mass and inverse inertia.
    w: [f32; 2],
    inertia: f32,
}

impl End {
    /// `push` is where the pair presses it, `by` the mass \[kg\] of what does.
    fn new(sides: &Sides, k: usize, i: usize, push: Vec3A, by: f32) -> Self {
        let (p, origin, held) = sides.side(k);
        let free = if held { 0.0 } else { 1.0 };
        let crushed = by > CRUSHING * p.mass[i] && sides.is_supported(k, i, push);
        let yields = if held || crushed { 0.0 } else { 1.0 };
        Self {
            x: p.position[i] + origin,
            v: p.velocity[i] * free,
            q: p.rotation[i],
            spin: p.angular_velocity[i] * free,
            w: [p.inverse_mass[i] * yields, p.inverse_inertia[i] * yields],
            inertia: p.inertia[i],
        }
    }

    fn store(self, sides: &mut Sides, k: usize, i: usize) {
        let (p, origin, held) = sides.side_mut(k);
        if !held {
            p.position[i] = self.x - origin;
            p.velocity[i] = self.v;
            p.rotation[i] = self.q;
            p.angular_velocity[i] = self.spin;
        }
    }
}

/// Both ends, the point where they touch, and the angular momentum that moving them has added.
struct Ends {
    ends: [End; 2],
    point: Vec3A,
    /// How fast one moved past the other at first, squared.
    speed2: f32,
    added: Vec3A,
}

impl Ends {
    fn arms(&self) -> [Vec3A; 2] {
        [self.point - self.ends[0].x, self.point - self.ends[1].x]
    }

    /// W along the unit vector `n`: how far apart an impulse of one moves the two at the point where they touch.
    fn yielding(&self, n: Vec3A) -> f32 {
        let arms = self.arms();
        (0..2).map(|k| self.ends[k].w[0] + self.ends[k].w[1] * arms[k].cross(n).length_squared()).sum()
    }

    /// The velocity of the second past the first where they touch \[m/s\].
    fn velocity(&self) -> Vec3A {
        let arms = self.arms();
        let [a, b] = &self.ends;
        b.v + b.spin.cross(arms[1]) - a.v - a.spin.cross(arms[0])
    }

    /// Moves and turns the second by `impulse` \[kg·m\] at the point, the first by the opposite, and gives it to their velocities.
    fn strike(&mut self, impulse: Vec3A, rate: f32) {
        let arms = self.arms();
        for (k, sign) in [(0, -1.0), (1, 1.0)] {
            let end = &mut self.ends[k];
            let angle = arms[k].cross(impulse * sign) * end.w[1];
            end.v += impulse * (sign * end.w[0] * rate);
            end.spin += angle * rate;
            end.q = turned(end.q, angle);
        }
        self.displace(impulse);
    }

    /// Moves the second by `way` \[m\] from the first, by their masses, and leaves the velocities alone.
    fn part(&mut self, way: Vec3A) {
        let sum = self.ends[0].w[0] + self.ends[1].w[0];
        if sum > 0.0 {
            self.displace(way / sum);
        }
    }

    fn displace(&mut self, impulse: Vec3A) {
        let [a, b] = &mut self.ends;
        self.added += impulse.cross(b.v - a.v);
        a.x -= impulse * a.w[0];
        b.x += impulse * b.w[0];
    }

    /// Takes the angular momentum back that moving has added: an impulse j across the line of centres D with D×j = −added, and equal spins for what is left along D.
    fn settle(&mut self) {
        let [a, b] = &mut self.ends;
        let sum = a.w[0] + b.w[0];
        if a.w[0] == 0.0 || b.w[0] == 0.0 || self.added == Vec3A::ZERO {
            return;
        }
        let d = b.x - a.x;
        let length2 = d.length_squared();
        let impulse = d.cross(self.added) / length2;
        // Of two in one place there is no turning about each other.
        let brakes = impulse.length_squared() * sum * sum <= self.speed2;
        if !brakes {
            return;
        }
        a.v -= impulse * a.w[0];
        b.v += impulse * b.w[0];
        if a.w[1] > 0.0 && b.w[1] > 0.0 {
            let turn = d * (self.added.dot(d) / length2 / (a.inertia + b.inertia));
            a.spin -= turn;
            b.spin -= turn;
        }
    }
}

/// The rate at which an old overlap is undone \[1/s\], if the push speed allows: at once, and particles wedged between others would be shaken, since what is moved here springs back there.
const EASE: f32 = 60.0;

fn resolve(pair: &mut Pair, sides: &mut Sides, touch: &Touch, leaving: bool, rules: &PairRules) {
    let PairRules { dt, friction, push_speed } = *rules;
    let rate = 1.0 / dt;
    let [i, j] = pair.particles.map(|i| i as usize);
    let n = touch.normal;
    let goal = if touch.before < 0.0 {
        let share = if leaving { 1.0 } else { EASE * dt / (1.0 + EASE * dt) };
        touch.before + (push_speed * dt).min(-touch.before * share)
    } else {
        0.0
    };
    let depth = goal - touch.gap;
    let deep = depth > 0.0;
    if !deep {
        return;
    }
    let mass = [sides.side(0).0.mass[i], sides.side(1).0.mass[j]];
    let ends = [End::new(sides, 0, i, -n, mass[1]), End::new(sides, 1, j, n, mass[0])];
    let speed2 = (ends[1].v - ends[0].v).length_squared();
    let mut both = Ends { point: ends[0].x + touch.point, ends, speed2, added: Vec3A::ZERO };
    let yielding = both.yielding(n);
    let approach = -n.dot(both.velocity());
    pair.approach = pair.approach.max(approach);
    pair.closing_speed = pair.closing_speed.max(approach);
    let yields = yielding > 0.0;
    if !yields {
        return;
    }
    let made_now = (touch.before.min(0.0) - touch.gap).max(0.0);
    let mut struck = made_now.min((approach * dt).max(0.0));
    let turn = (0..2).map(|k| both.arms()[k].cross(n).length() * both.ends[k].w[1]).fold(0.0, f32::max) * struck / yielding;
    if turn > LARGEST_TURN {
        struck *= LARGEST_TURN / turn;
    }
    if struck > 0.0 {
        both.strike(n * (struck / yielding), rate);
        pair.impulse += struck / yielding * rate;
    }
    if friction > 0.0 && pair.impulse > 0.0 && !leaving {
        rub(pair, sides, &mut both, n, friction, dt);
    }
    if depth > struck {
        both.part(n * (depth - struck));
    }
    both.settle();
    let [a, b] = both.ends;
    a.store(sides, 0, i);
    b.store(sides, 1, j);
}

/// Friction, on the way that the points which touch have slipped over each other in this substep.
fn rub(pair: &mut Pair, sides: &Sides, both: &mut Ends, n: Vec3A, friction: f32, dt: f32) {
    let arms = both.arms();
    let way = |k: usize| {
        let (p, origin, held) = sides.side(k);
        let i = pair.particles[k] as usize;
        let end = &both.ends[k];
        if held {
            Vec3A::ZERO
        } else {
            both.point - (p.previous_position[i] + origin + p.previous_rotation[i] * (end.q.inverse() * arms[k]))
        }
    };
    let slip = way(1) - way(0);
    let slip = slip - n * n.dot(slip);
    let length = slip.length();
    let slips = length > 0.0;
    if !slips {
        return;
    }
    let t = slip / length;
    let rate = 1.0 / dt;
    let hold = t * (length / both.yielding(t) * rate);
    let sum = (pair.friction - hold).clamp_length_max(friction * pair.impulse);
    let impulse = sum - pair.friction;
    pair.friction = sum;
    let strength = impulse.length();
    let rubs = strength > 0.0;
    if !rubs {
        return;
    }
    let along = impulse / strength;
    let yielding = both.yielding(along);
    // In metres: how far the two are to be moved, and how far that only stops them.
    let way = strength * dt * yielding;
    let stopped = way.min((-along.dot(both.velocity()) * dt).max(0.0));
    if stopped > 0.0 {
        both.strike(along * (stopped / yielding), rate);
    }
    if way > stopped {
        both.part(along * (way - stopped));
    }
}
