//! Stage 3: particles leave each other, in one body or between two, with friction.

use glam::Vec3A;

use crate::pair_ends::Ends;
use crate::pair_touch::{Touch, look};
use crate::pairs::Pair;
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
/// *Normal.* Along the pair's normal n the gap is C = n·d − h₁ − h₂ (see `ellipsoid_pair.rs`). Both are pushed at one point, midway between their outermost points, at r₁ and r₂ from the centres: with
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
/// afterwards changes it by Δ×(v₁ − v₂). That is taken back, as a skater's arms do it: from the two's turning about each other and from their spins. That may cost or give a few thousandths of the energy of a pair that slips by a tenth
/// of its radius a substep.
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
            part(pair, sides, &touch, way_out.is_some(), rules);
        }
    }
}

impl Sides<'_> {
    pub(crate) fn side(&self, k: usize) -> (&Particles, Vec3A, bool) {
        match self {
            Sides::Within { particles, .. } => (particles, Vec3A::ZERO, false),
            Sides::Between { first, held, .. } if k == 0 => (first, Vec3A::ZERO, held[0]),
            Sides::Between { second, offset, held, .. } => (second, *offset, held[1]),
        }
    }

    pub(crate) fn side_mut(&mut self, k: usize) -> (&mut Particles, Vec3A, bool) {
        match self {
            Sides::Within { particles, .. } => (particles, Vec3A::ZERO, false),
            Sides::Between { first, held, .. } if k == 0 => (first, Vec3A::ZERO, held[0]),
            Sides::Between { second, offset, held, .. } => (second, *offset, held[1]),
        }
    }

    /// Whether a particle pressed along `push` lies on something that bears it.
    pub(crate) fn is_supported(&self, k: usize, i: usize, push: Vec3A) -> bool {
        let support = match self {
            Sides::Within { support, .. } => support,
            Sides::Between { support, .. } => support[k],
        };
        support.get(i).is_some_and(|n| n.dot(push) < -INTO)
    }

    /// Where a particle is and was when the substep began.
    #[inline]
    pub(crate) fn places(&self, k: usize, i: usize) -> Option<[Vec3A; 2]> {
        let (p, origin, held) = self.side(k);
        let now = *p.position.get(i)? + origin;
        Some([now, if held { now } else { p.previous_position[i] + origin }])
    }

    pub(crate) fn ellipsoid(&self, k: usize, i: usize) -> Ellipsoid {
        self.side(k).0.ellipsoid(i)
    }

    pub(crate) fn ellipsoid_before(&self, k: usize, i: usize) -> Ellipsoid {
        let (p, _, held) = self.side(k);
        let rotation = if held { p.rotation[i] } else { p.previous_rotation[i] };
        Ellipsoid { radii: p.radii[i], orientation: rotation * p.frame[i] }
    }
}

/// The rate at which an old overlap is undone \[1/s\], if the push speed allows: at once, and particles wedged between others would be shaken, since what is moved here springs back there.
const EASE: f32 = 60.0;

/// Separates two that overlap.
fn part(pair: &mut Pair, sides: &mut Sides, touch: &Touch, leaving: bool, rules: &PairRules) {
    let PairRules { dt, friction, push_speed } = *rules;
    let rate = 1.0 / dt;
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
    let mut both = Ends::new(pair, sides, [n, touch.point]);
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
    both.settle(leaving);
    both.store(pair, sides);
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
