//! Contact between bodies: they do not pass through each other.

use bevy::math::Vec3A;
use bevy::prelude::*;
use polpo_solver::{Bounds, BroadPhase, PAIR_PASSES, PairFinder, PairRules, Pairs, Sides, solve_pairs, swept_bounds};
use serde::{Deserialize, Serialize};

use crate::recall::{KnownPair, are_known_pairs, is_direction};
use crate::self_contact::{note_support, pair_search};
use crate::{Contacts, Frozen, Gravity, Particles, Sleeping, SubstepTime};

/// The body does not pass through other bodies that have this component. Comes with every [`SoftBody`](crate::SoftBody); remove it, and it meets colliders only.
///
/// Momentum of the two, spin included, is kept to rounding. A [`Frozen`] body is an obstacle that nothing moves; a [`Sleeping`] one wakes when one that moves comes near. Bodies that appear inside each other leave by the shortest way.
#[derive(Component, Debug, Clone, Copy, PartialEq)]
pub struct BodyContact {
    /// Coulomb's coefficient of the body's skin; of two bodies the mean counts. Range 0 (ice) to infinity; default 0.6. Negative and NaN count as 0.
    pub friction: f32,
    /// The layers the body is in, one bit each. Default: the first.
    pub memberships: u32,
    /// The layers whose bodies it meets; two bodies touch if each meets the other. Default: all.
    pub filter: u32,
    /// The speed at most at which an overlap is undone that was there when a substep began \[m/s\]; of two bodies the smaller counts. Range 0 (stays as it is) to infinity (at once); default 3. Negative and NaN
    /// count as 0.
    pub push_speed: f32,
}

impl Default for BodyContact {
    fn default() -> Self {
        Self { friction: 0.6, memberships: 1, filter: u32::MAX, push_speed: 3.0 }
    }
}

/// Two bodies that may touch in this step.
#[derive(Debug, Clone)]
pub struct BodyPair {
    bodies: [Entity; 2],
    pairs: Pairs,
    support: [Vec<Vec3A>; 2],
}

impl BodyPair {
    /// Which two, the smaller first.
    pub fn bodies(&self) -> [Entity; 2] {
        self.bodies
    }

    /// Whether any of their particles have touched in this step, so far.
    pub fn touch(&self) -> bool {
        self.pairs.touch()
    }

    /// The pairs of particles, the first of each of the first body, with whether they touched in this step and how fast they met.
    pub fn pairs(&self) -> &[polpo_solver::Pair] {
        &self.pairs.list
    }
}

/// What a body remembers of another that it may touch, in a snapshot. An entity is kept as its bits, which mean something in the same world only.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Neighbour {
    body: u64,
    way_out: Option<Vec3A>,
    known: Vec<KnownPair>,
}

impl Neighbour {
    /// Whether it can be that of `body`, which has `count` particles.
    pub(crate) fn is_sound(&self, body: Entity, count: usize) -> bool {
        Entity::try_from_bits(self.body).is_some_and(|other| body < other)
            && self.way_out.is_none_or(is_direction)
            && are_known_pairs(&self.known, count)
    }
}

/// All pairs of bodies that may touch in this step, found in phase `DetectContacts`. After the step it tells which did.
#[derive(Resource, Debug, Default)]
pub struct BodyPairs {
    list: Vec<BodyPair>,
    /// Those of the step before, for what they remember.
    before: Vec<BodyPair>,
    candidates: Vec<Candidate>,
    boxes: Vec<Bounds>,
    met: Vec<(u32, u32)>,
    broad: BroadPhase,
    finder: PairFinder,
}

/// A body in the search for pairs.
#[derive(Debug, Clone, Copy)]
struct Candidate {
    entity: Entity,
    memberships: u32,
    filter: u32,
    held: bool,
    asleep: bool,
}

impl BodyPairs {
    /// What is remembered until the next search of the pairs in which `body` is the first.
    pub(crate) fn memory_of(&self, body: Entity) -> Vec<Neighbour> {
        let of_body = self.list.iter().filter(|pair| pair.bodies[0] == body);
        of_body
            .map(|pair| Neighbour { body: pair.bodies[1].to_bits(), way_out: pair.pairs.way_out, known: pair.pairs.known().collect() })
            .collect()
    }

    /// Puts that back in the place of what is remembered now.
    pub(crate) fn remember(&mut self, body: Entity, neighbours: &[Neighbour]) {
        self.list.retain(|pair| pair.bodies[0] != body);
        for neighbour in neighbours {
            let Some(other) = Entity::try_from_bits(neighbour.body) else { continue };
            let mut pairs = Pairs::default();
            pairs.remember(neighbour.known.iter().copied(), neighbour.way_out);
            self.list.push(BodyPair { bodies: [body, other], pairs, support: default() });
        }
        self.list.sort_by_key(|pair| pair.bodies);
    }

    /// Sorted by their entities.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = &BodyPair> {
        self.list.iter()
    }
}

/// In phase `DetectContacts`: bodies whose boxes meet in this step, by sort and sweep, then their particles.
///
/// The pairs are in the order of their entities, which is the order in which they are solved, so that the answer does not depend on where components lie in memory.
pub(crate) fn find_body_pairs(
    time: Res<Time>,
    gravity: Res<Gravity>,
    mut found: ResMut<BodyPairs>,
    bodies: Query<(Entity, &Particles, &Transform, &BodyContact, Has<Frozen>, Has<Sleeping>)>,
) {
    let BodyPairs { list, before, candidates, boxes, met, broad, finder } = &mut *found;
    let search = pair_search(&time, &gravity);
    candidates.clear();
    candidates.extend(bodies.iter().map(|(entity, _, _, contact, held, asleep)| Candidate {
        entity,
        memberships: contact.memberships,
        filter: contact.filter,
        held,
        asleep,
    }));
    candidates.sort_unstable_by_key(|c| c.entity);
    boxes.clear();
    // A body alone has nobody to meet.
    if candidates.len() > 1 {
        boxes.extend(
            candidates
                .iter()
                .map(|c| bodies.get(c.entity).map_or(Bounds::NOTHING, |(_, p, place, ..)| in_world(&swept_bounds(p, &search), place))),
        );
    }
    met.clear();
    broad.pairs(boxes, |i, j| {
        let (a, b) = (&candidates[i as usize], &candidates[j as usize]);
        if a.memberships & b.filter != 0 && b.memberships & a.filter != 0 && !(a.held && b.held) {
            met.push((i, j));
        }
        true
    });
    met.sort_unstable();

    core::mem::swap(list, before);
    for &(i, j) in met.iter() {
        let pair = [candidates[i as usize].entity, candidates[j as usize].entity];
        let Ok([(_, a, place_a, ..), (_, b, place_b, ..)]) = bodies.get_many(pair) else { continue };
        let offset = Vec3A::from(place_b.translation - place_a.translation);
        // Take along what the pair remembers.
        let at = before.binary_search_by_key(&pair, |known| known.bodies);
        let (mut pairs, support) = match at {
            Ok(at) => (core::mem::take(&mut before[at].pairs), core::mem::take(&mut before[at].support)),
            Err(_) => default(),
        };
        // Nothing moves between two that sleep; what they remember of each other is kept.
        if !(candidates[i as usize].asleep && candidates[j as usize].asleep && at.is_ok()) {
            finder.find_between(a, b, offset, &search, at.is_err(), &mut pairs);
        }
        list.push(BodyPair { bodies: pair, pairs, support });
    }
    before.clear();
}

/// The box in the world; far out, where floats are coarse, it grows by a few of their steps.
fn in_world(local: &Bounds, place: &Transform) -> Bounds {
    let origin = Vec3A::from(place.translation);
    let slop = 1e-6 * origin.abs().max_element();
    Bounds { min: local.min + origin - slop, max: local.max + origin + slop }
}

fn unheld<'a>(particles: &'a mut Mut<Particles>, held: bool) -> &'a mut polpo_solver::Particles {
    match held {
        true => &mut particles.bypass_change_detection().0,
        false => &mut particles.0,
    }
}

/// In phase `SolveContacts`, before the colliders, which have the last word.
pub(crate) fn solve_body_pairs(
    time: Res<SubstepTime>,
    mut found: ResMut<BodyPairs>,
    mut bodies: Query<(&mut Particles, &Transform, &BodyContact, (Has<Frozen>, Has<Sleeping>), Option<&Contacts>)>,
) {
    for pass in 0..PAIR_PASSES {
        for pair in &mut found.list {
            if pair.pairs.list.is_empty() {
                continue;
            }
            // One of them may be gone since they were found.
            let Ok(
                [(mut a, place_a, contact_a, (frozen_a, asleep_a), planes_a), (mut b, place_b, contact_b, (frozen_b, asleep_b), planes_b)],
            ) = bodies.get_many_mut(pair.bodies)
            else {
                continue;
            };
            let (held_a, held_b) = (frozen_a || asleep_a, frozen_b || asleep_b);
            if held_a && held_b {
                continue;
            }
            // What is held is not written to, or it would be told from one that nobody touched.
            let (a, b) = (unheld(&mut a, held_a), unheld(&mut b, held_b));
            let rules = PairRules {
                dt: time.delta,
                friction: 0.5 * (contact_a.friction.max(0.0) + contact_b.friction.max(0.0)),
                push_speed: contact_a.push_speed.max(0.0).min(contact_b.push_speed.max(0.0)),
            };
            let offset = Vec3A::from(place_b.translation - place_a.translation);
            let BodyPair { pairs, support, .. } = pair;
            if pass == 0 {
                note_support(pairs, planes_a, a, time.delta, &mut support[0]);
                note_support(pairs, planes_b, b, time.delta, &mut support[1]);
            }
            let mut sides = Sides::Between { first: a, second: b, offset, held: [held_a, held_b], support: [&support[0], &support[1]] };
            solve_pairs(pairs, &mut sides, &rules, pass);
        }
    }
}
