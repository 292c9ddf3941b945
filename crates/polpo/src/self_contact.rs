//! Self-contact: a body does not pass through itself.

use bevy::math::Vec3A;
use bevy::prelude::*;
use bevy::utils::Parallel;
use polpo_solver::{PAIR_PASSES, PairFinder, PairRules, PairSearch, Pairs, SelfSearch, Sides, find_support, solve_pairs};

use crate::capability::reject;
use crate::particles::{Awake, for_each_body};
use crate::prototypes::Prototypes;
use crate::recall::KnownPair;
use crate::{Contacts, Frozen, Gravity, Particles, SoftBody, SubstepTime};

/// The particles of the body do not pass through each other: arms lie on arms, a sheet folds onto itself. Not there unless you add it.
///
/// Particles joined by an edge, those that overlap at rest or all but do, and close ones with a neighbour in common never count as touching. Momentum, spin included, is kept to rounding. If nearly everything overlaps at rest there is nothing to hold
/// apart: it is refused with [`CapabilityRejected`](crate::CapabilityRejected).
///
/// Particles flung at each other faster than they moved when the step began may pass through each other in that step.
#[derive(Component, Debug, Clone, Copy, PartialEq)]
pub struct SelfContact {
    /// Coulomb's coefficient of skin on skin. Range 0 (ice) to infinity; default 0.6. Negative and NaN count as 0.
    pub friction: f32,
    /// The speed at most at which an overlap is undone that was there when a substep began \[m/s\]. Range 0 (stays as it is) to infinity (at once); default 3. Negative and NaN count as 0.
    pub push_speed: f32,
}

impl Default for SelfContact {
    fn default() -> Self {
        Self { friction: 0.6, push_speed: 3.0 }
    }
}

/// The pairs of particles that may touch in this step, and which never do. There while [`SelfContact`] is.
#[derive(Component, Debug, Clone, Default)]
pub struct SelfPairs {
    pairs: Pairs,
    search: SelfSearch,
    support: Vec<Vec3A>,
}

impl SelfPairs {
    /// The pairs, with whether they touched in this step and how fast they met.
    pub fn pairs(&self) -> &[polpo_solver::Pair] {
        &self.pairs.list
    }

    /// What is remembered until the next search.
    pub(crate) fn known(&self) -> impl Iterator<Item = KnownPair> {
        self.pairs.known()
    }

    pub(crate) fn remember(&mut self, known: &[KnownPair]) {
        self.pairs.remember(known.iter().copied(), None);
    }
}

/// In phase `Prepare`: bodies with [`SelfContact`] learn which pairs are none, bodies without forget it.
pub(crate) fn build_self_pairs(
    mut commands: Commands,
    mut prototypes: ResMut<Prototypes>,
    lacking: Query<(Entity, &SoftBody, &Particles), (With<SelfContact>, Without<SelfPairs>, Without<Frozen>)>,
    idle: Query<Entity, (With<SelfPairs>, Without<SelfContact>)>,
) {
    for (entity, body, particles) in &lacking {
        match prototypes.self_search(&body.rig, particles) {
            Ok(search) => {
                commands.entity(entity).try_insert(SelfPairs { search, support: Vec::with_capacity(particles.len()), ..default() });
            }
            Err(error) => reject::<SelfContact>(&mut commands, entity, "SelfContact", error),
        }
    }
    for entity in &idle {
        commands.entity(entity).remove::<SelfPairs>();
    }
}

/// In phase `DetectContacts`.
pub(crate) fn find_self_pairs(
    time: Res<Time>,
    gravity: Res<Gravity>,
    scratch: Local<Parallel<PairFinder>>,
    mut bodies: Query<(&Particles, &mut SelfPairs), Awake>,
) {
    let search = pair_search(&time, &gravity);
    for_each_body(
        &mut bodies,
        |(particles, _)| 100 * particles.len(),
        |(particles, mut own)| {
            let SelfPairs { pairs, search: own, .. } = &mut *own;
            own.find(particles, &search, &mut scratch.borrow_local_mut(), pairs);
        },
    );
}

/// In phase `SolveContacts`, before anything from outside.
pub(crate) fn solve_self_pairs(
    time: Res<SubstepTime>,
    mut bodies: Query<(&mut Particles, &mut SelfPairs, &SelfContact, Option<&Contacts>), Awake>,
) {
    let dt = time.delta;
    for_each_body(
        &mut bodies,
        |(_, own, ..)| 60 * own.pairs.list.len(),
        |(mut particles, mut own, contact, contacts)| {
            if own.pairs.list.is_empty() {
                return;
            }
            let rules = PairRules { dt, friction: contact.friction.max(0.0), push_speed: contact.push_speed.max(0.0) };
            let SelfPairs { pairs, support, .. } = &mut *own;
            note_support(pairs, contacts, &particles, dt, support);
            let mut sides = Sides::Within { particles: &mut particles.0, support };
            for pass in 0..PAIR_PASSES {
                solve_pairs(pairs, &mut sides, &rules, pass);
            }
        },
    );
}

/// Which particles lie on a collider, if the body meets any and the pairs want to know.
pub(crate) fn note_support(
    pairs: &Pairs,
    contacts: Option<&Contacts>,
    particles: &polpo_solver::Particles,
    dt: f32,
    support: &mut Vec<Vec3A>,
) {
    match contacts {
        Some(contacts) if pairs.ask_for_support() => find_support(contacts, particles, dt, support),
        _ => support.clear(),
    }
}

/// What the search for pairs needs to know of the step: free, one particle may gain what gravity gives it on one that lies.
pub(crate) fn pair_search(time: &Time, gravity: &Gravity) -> PairSearch {
    let dt = time.delta_secs();
    let gain = gravity.0.length() * dt;
    PairSearch { dt, gain: if gain.is_finite() { gain } else { 0.0 } }
}
