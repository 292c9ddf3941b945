//! Pairs of particles that may touch in one step, and how they are found.

use glam::{Vec3, Vec3A};

use crate::ellipsoid_pair::{EllipsoidPair, FLATTEST};
use crate::pair_ends::is_uneven;
use crate::{Bounds, BroadPhase, Particles};

/// Two particles that may touch in this step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pair {
    /// Their indices: in one body the smaller first; of two bodies the first's first.
    pub particles: [u32; 2],
    /// Unit normal from the first to the second when they were last looked at.
    pub normal: Vec3A,
    /// The normal impulse of the last substep \[N·s\]; written by the solver.
    pub impulse: f32,
    /// The greatest speed at which their surfaces met in this step \[m/s\], 0 if they did not; written by the solver.
    pub closing_speed: f32,
    /// The same of the last substep.
    pub approach: f32,
    /// Whether they touched in this step; written by the solver.
    pub touching: bool,
    /// The friction impulse of the running substep \[N·s\].
    pub(crate) friction: Vec3A,
    /// How far apart their centres can be when they touch \[m\].
    pub(crate) reach: f32,
    /// How near their centres can be when they touch \[m\].
    pub(crate) thickness: f32,
    /// Whether both are spheres.
    pub(crate) round: bool,
    /// Whether `normal` is that of a moment ago, rather than a guess.
    pub(crate) known: bool,
}

impl Pair {
    fn new(i: u32, j: u32, a: &Particles, b: &Particles, d: Vec3A) -> Self {
        let (ra, rb) = (a.radii[i as usize], b.radii[j as usize]);
        let least = |r: Vec3A| r.min_element().max(FLATTEST * r.max_element());
        let round = |r: Vec3A| r.max_element() - r.min_element() <= 1e-5 * r.max_element();
        Self {
            particles: [i, j],
            normal: d.try_normalize().unwrap_or(Vec3A::X),
            impulse: 0.0,
            closing_speed: 0.0,
            approach: 0.0,
            touching: false,
            friction: Vec3A::ZERO,
            reach: ra.max_element() + rb.max_element(),
            thickness: least(ra) + least(rb),
            round: round(ra) && round(rb),
            known: false,
        }
    }
}

/// The pairs of one body with itself, or of two bodies, found once a step. Reuse it: a warmed-up step allocates nothing.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Pairs {
    /// In the order in which they are solved: by their indices.
    pub list: Vec<Pair>,
    /// The way out of an overlap of whole bodies that nobody's motion made, from the first to the second; `None` as long as they touch at their skins only. While it is there, what overlaps is pushed
    /// apart along it, rather than each pair along its own normal, which would lock two lattices into each other.
    pub way_out: Option<Vec3A>,
    /// Whether one of them is so much heavier than the other that what bears the lighter one matters.
    uneven: bool,
    /// What the pairs of the step before remember.
    before: Vec<([u32; 2], Vec3)>,
}

/// Two particles' indices, as a number that sorts like them.
pub(crate) fn key(i: u32, j: u32) -> u64 {
    u64::from(i) << 32 | u64::from(j)
}

/// What the search for pairs needs to know of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PairSearch {
    /// Length of the step \[s\].
    pub dt: f32,
    /// How much faster a particle may get within the step than it is at its start, relative to another \[m/s\]: gravity's share, as a rule.
    pub gain: f32,
}

/// Pairs are looked for within this share of the smaller particle's radius.
const SLACK: f32 = 0.25;
/// At most this many pairs a particle, on average, are kept: the rest of a body that has collapsed into a point must not fill the memory.
pub(crate) const MOST: usize = 64;
/// An overlap deeper than this share of the pair's thickness, at first sight, was not made by motion.
const SUDDEN: f32 = 0.1;
/// Overlaps not deeper than this share of the thickness are skin on skin again.
const SKIN: f32 = 0.05;

/// Finds the pairs of two bodies; lends its memory to [`SelfSearch`](crate::SelfSearch). Reuse it, so that a warmed-up step allocates nothing.
///
/// Each particle is its enveloping sphere on its way through the step, with a margin; what meets is a candidate, and candidates whose paths come near enough at the same time are pairs. So a particle that flies
/// through another within the step is found.
#[derive(Clone, Debug, Default)]
pub struct PairFinder {
    pub(crate) broad: BroadPhase,
    boxes: Vec<Bounds>,
    /// Which particle each box is of, the second body's counted on from the first's.
    pub(crate) owners: Vec<u32>,
    pub(crate) keys: Vec<u64>,
}

impl PairFinder {
    /// Fills `pairs` with those of two bodies, the second's origin at `offset` \[m\] from the first's. `fresh` says that the two have not been near each other in the step before, so that an overlap is
    /// one that nobody's motion made.
    pub fn find_between(&mut self, a: &Particles, b: &Particles, offset: Vec3A, search: &PairSearch, fresh: bool, pairs: &mut Pairs) {
        // Seen from the first body, which is large as a rule and then still.
        let frame = mean_velocity(a);
        let Self { broad, boxes, owners, keys } = self;
        boxes.clear();
        let mut bounds = |p: &Particles, origin: Vec3A| {
            let mut all = Bounds::NOTHING;
            for i in 0..p.len() {
                let b = swept(p, i, origin, frame, search);
                if b.is_finite() {
                    all.include(&b);
                }
                boxes.push(b);
            }
            all
        };
        let (around_a, around_b) = (bounds(a, Vec3A::ZERO), bounds(b, offset));
        // Only those that are near the other body.
        let count = a.len() as u32;
        let mut kept = 0;
        owners.clear();
        for i in 0..boxes.len() {
            if boxes[i].meets(if i < a.len() { &around_b } else { &around_a }) {
                boxes[kept] = boxes[i];
                kept += 1;
                owners.push(i as u32);
            }
        }
        boxes.truncate(kept);
        keys.clear();
        let most = MOST * (a.len() + b.len());
        broad.pairs_between(boxes, owners.partition_point(|i| *i < count), |i, j| {
            let (i, j) = (owners[i as usize], owners[j as usize] - count);
            if meet_in_step(a, i as usize, b, j as usize, offset, search) {
                keys.push(key(i, j));
            }
            keys.len() < most
        });
        keys.sort_unstable();
        pairs.refill(keys.iter().copied(), a, b, offset);
        if fresh || pairs.way_out.is_some() {
            let limit = if fresh { SUDDEN } else { SKIN };
            if pairs.overlap(a, b, offset, limit) {
                pairs.way_out = pairs.way_out.or_else(|| Some(shortest_way_out(a, b, offset)));
            } else {
                pairs.way_out = None;
            }
        }
    }
}

impl Pairs {
    /// Whether [`solve_pairs`](crate::solve_pairs) asks what the particles lie on: [`find_support`](crate::find_support) is for nothing if not.
    pub fn ask_for_support(&self) -> bool {
        self.uneven
    }

    /// Whether the solver found any two of them touching since they were found.
    pub fn touch(&self) -> bool {
        self.list.iter().any(|pair| pair.touching)
    }

    /// What is remembered until the next search, besides the way out: the particles of the pairs that were near each other when they were last looked at, in the list's order, and their normals.
    pub fn known(&self) -> impl Iterator<Item = ([u32; 2], Vec3A)> {
        self.list.iter().filter(|pair| pair.known).map(|pair| (pair.particles, pair.normal))
    }

    /// Puts back what [`known`](Self::known) and `way_out` said. The list is then good for nothing but the next search. `known` has to be sorted by particles; what is not goes unnoticed by the search.
    pub fn remember(&mut self, known: impl IntoIterator<Item = ([u32; 2], Vec3A)>, way_out: Option<Vec3A>) {
        let pair = |(particles, normal)| Pair {
            particles,
            normal,
            impulse: 0.0,
            closing_speed: 0.0,
            approach: 0.0,
            touching: false,
            friction: Vec3A::ZERO,
            reach: 0.0,
            thickness: 0.0,
            round: false,
            known: true,
        };
        self.list.clear();
        self.list.extend(known.into_iter().map(pair));
        self.way_out = way_out;
    }

    /// Makes the list anew from sorted `keys`; pairs that were in it keep their normals.
    pub(crate) fn refill(&mut self, keys: impl Iterator<Item = u64>, a: &Particles, b: &Particles, offset: Vec3A) {
        let Self { list, before, uneven, .. } = self;
        before.clear();
        before.extend(list.iter().filter(|pair| pair.known).map(|pair| (pair.particles, pair.normal.into())));
        list.clear();
        *uneven = false;
        let mut old = before.iter().peekable();
        for k in keys {
            let (i, j) = ((k >> 32) as u32, k as u32);
            let mut pair = Pair::new(i, j, a, b, b.position[j as usize] + offset - a.position[i as usize]);
            *uneven |= is_uneven(a.mass[i as usize], b.mass[j as usize]);
            while old.next_if(|([i, j], _)| key(*i, *j) < k).is_some() {}
            if let Some((_, normal)) = old.next_if(|([i, j], _)| key(*i, *j) == k) {
                (pair.normal, pair.known) = (Vec3A::from(*normal), true);
            }
            list.push(pair);
        }
    }

    /// Makes room for `count` pairs.
    pub(crate) fn reserve(&mut self, count: usize) {
        self.list.reserve(count.saturating_sub(self.list.len()));
        self.before.reserve(count.saturating_sub(self.before.len()));
    }

    /// Whether any pair overlaps by more than `limit` times its thickness.
    fn overlap(&self, a: &Particles, b: &Particles, offset: Vec3A, limit: f32) -> bool {
        self.list.iter().any(|pair| {
            let [i, j] = pair.particles.map(|i| i as usize);
            let d = b.position[j] + offset - a.position[i];
            d.length_squared() < pair.reach * pair.reach
                && EllipsoidPair::new(&a.ellipsoid(i), &b.ellipsoid(j), d).contact().gap < -limit * pair.thickness
        })
    }
}

/// The box of a body's particles on their way through the step, margin included.
pub fn swept_bounds(p: &Particles, search: &PairSearch) -> Bounds {
    let mut all = Bounds::NOTHING;
    for i in 0..p.len() {
        let b = swept(p, i, Vec3A::ZERO, Vec3A::ZERO, search);
        if b.is_finite() {
            all.include(&b);
        }
    }
    all
}

/// The box of a particle on its way through the step, seen from what moves at `frame` \[m/s\].
pub(crate) fn swept(p: &Particles, i: usize, origin: Vec3A, frame: Vec3A, search: &PairSearch) -> Bounds {
    let x = p.position[i] + origin;
    let margin = SLACK * p.radii[i].max_element() + search.gain * search.dt;
    Bounds::of_swept_ball(x, x + (p.velocity[i] - frame) * search.dt, p.radii[i].max_element() + margin)
}

/// Whether two particles come within reach of each other, and some margin, at any time of the step.
pub(crate) fn meet_in_step(a: &Particles, i: usize, b: &Particles, j: usize, offset: Vec3A, search: &PairSearch) -> bool {
    let d = b.position[j] + offset - a.position[i];
    let way = (b.velocity[j] - a.velocity[i]) * search.dt;
    let (ra, rb) = (a.radii[i].max_element(), b.radii[j].max_element());
    nearest(d, way).length_squared() < (ra + rb + SLACK * ra.min(rb) + search.gain * search.dt).powi(2)
}

/// The point nearest to the origin on the way from `d` to `d + way`.
pub(crate) fn nearest(d: Vec3A, way: Vec3A) -> Vec3A {
    let length2 = way.length_squared();
    let t = if length2 > 0.0 { (-d.dot(way) / length2).clamp(0.0, 1.0) } else { 0.0 };
    d + way * t
}

/// Of what is finite; zero for a body without mass.
pub(crate) fn mean_velocity(p: &Particles) -> Vec3A {
    let (mut sum, mut mass) = (Vec3A::ZERO, 0.0);
    for (v, m) in p.velocity.iter().zip(&p.mass) {
        if v.is_finite() {
            sum += *v * *m;
            mass += m;
        }
    }
    let mean = sum / mass;
    if mean.is_finite() { mean } else { Vec3A::ZERO }
}

/// The unit vector along which two bodies' boxes have to go least far to be apart, from the first to the second; up if it is all the same.
fn shortest_way_out(a: &Particles, b: &Particles, offset: Vec3A) -> Vec3A {
    let bounds = |p: &Particles, origin: Vec3A| {
        let mut all = Bounds::NOTHING;
        for (x, r) in p.position.iter().zip(&p.radii).filter(|(x, _)| x.is_finite()) {
            all.include(&Bounds::of_swept_ball(*x + origin, *x + origin, r.max_element()));
        }
        all
    };
    let (a, b) = (bounds(a, Vec3A::ZERO), bounds(b, offset));
    let mut best = (f32::INFINITY, Vec3A::Y);
    for axis in [Vec3A::Y, Vec3A::X, Vec3A::Z] {
        for (way, out) in [((a.max - b.min).dot(axis), axis), ((b.max - a.min).dot(axis), -axis)] {
            if way < best.0 {
                best = (way, out);
            }
        }
    }
    best.1
}
