//! Snapshots: what a body has come to, in a form that can be kept, sent and put back.

use bevy::math::Vec3A;
use bevy::prelude::*;
use polpo_solver::StateError;
use serde::{Deserialize, Serialize};

use crate::body_contact::Neighbour;
use crate::pins::PinRecord;
use crate::recall::{Memory, Recall};
use crate::sleep::Conditions;
use crate::state_hash::Fnv;
use crate::{BodyPairs, ContactMemory, Frozen, Particles, PinState, Pins, Sleeping, SoftBody, StepStart, Stillness};

/// The state of one body between two steps. Put back, the steps that follow are the same as they would have been, to the bit.
///
/// It holds what a step changes: where the particles are and how they move, where they were last free of colliders, which pins are left, whether the body sleeps or is frozen; what explicit groups, plastic flow and
/// contacts between particles have come to. It does not hold what a step only reads: the rig (of which it keeps a hash), the components and their settings, resources, the clock, colliders. Those are the game's to put back
/// first; a body spawned with the same [`SoftBody`], the same scale and the same components will do, before its first step too. What contacts remember of Rapier's world is in `polpo_rapier`'s snapshot of that.
///
/// Bodies that touch, and what pins are tied to, are known by their entities: put all of them back together, in a world where they have the same ones.
///
/// A particle takes 64 bytes in [`to_bytes`](Self::to_bytes): a body of 300 particles 19.3 kB. To that come 16 bytes for each pair of particles that nearly touch, 13 to 25 a pin, and where they are used 60 bytes an
/// explicit group, 24 for each member of a rigid one, 12 for each member of a dented one, 12 for each member of a group that may flow and 4 for each edge that may. Any format of serde's will do instead; numbers must
/// survive it to the bit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BodySnapshot {
    version: u32,
    /// Of what the body is made of, see [`fingerprint`].
    body: u64,
    origin: Vec3,
    position: Vec<Vec3A>,
    velocity: Vec<Vec3A>,
    rotation: Vec<Quat>,
    angular_velocity: Vec<Vec3A>,
    /// Where each particle was last free; empty if nothing is known.
    free: Vec<Vec3>,
    /// The particles that are pinned, by [`Pins`] or without: index, position, orientation.
    pinned: Vec<(u32, bool, bool)>,
    /// Those that are by [`Pins`].
    held: Vec<u32>,
    pins: Option<Vec<PinRecord>>,
    frozen: bool,
    stillness: f32,
    /// Whether it sleeps, and under what conditions it fell asleep.
    asleep: Option<Option<Conditions>>,
    memory: Memory,
    /// Of each pair of bodies in which this is the first.
    neighbours: Vec<Neighbour>,
}

/// Why a snapshot could not be taken, read or put back. The body is then as it was.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SnapshotError {
    /// The entity does not exist or is not a soft body.
    #[error("entity {0} is not a soft body")]
    NoBody(Entity),
    /// It was written by another version of this library.
    #[error("the snapshot has version {found}, this library reads {expected}")]
    Version {
        /// Its version.
        found: u32,
        /// The one that can be read.
        expected: u32,
    },
    /// The bytes end too early or are no snapshot.
    #[error("not a snapshot: {0}")]
    Bytes(String),
    /// Bytes are left over behind the snapshot.
    #[error("{0} bytes are left over behind the snapshot")]
    Trailing(usize),
    /// It is of a body with another number of particles.
    #[error("the snapshot is of a body with {found} particles, this one has {expected}")]
    Count {
        /// How many the snapshot has.
        found: usize,
        /// How many the body has.
        expected: usize,
    },
    /// It is of a body made from another rig, or at another scale.
    #[error("the snapshot is of a body made from another rig or at another scale")]
    OtherBody,
    /// What it says of a capability does not fit the components that the body has.
    #[error("what the snapshot says of {0} does not fit the body")]
    Capability(&'static str),
    /// Its particles are not fit to be stepped.
    #[error("{0}")]
    Particles(#[from] StateError),
    /// Something else in it is out of range.
    #[error("{what} is not {range}")]
    Range {
        /// What.
        what: &'static str,
        /// What it should be.
        range: &'static str,
    },
}

impl BodySnapshot {
    /// The version this library writes and reads.
    pub const VERSION: u32 = 2;

    /// The state of the body `entity`. Between two steps; in the middle of one it is that of the middle.
    ///
    /// # Errors
    ///
    /// If `entity` is not a soft body, or something is wrong with its particles.
    pub fn take(world: &World, entity: Entity) -> Result<Self, SnapshotError> {
        let body = world.get_entity(entity).map_err(|_| SnapshotError::NoBody(entity))?;
        let (Some(soft), Some(particles), Some(transform)) = (body.get::<SoftBody>(), body.get::<Particles>(), body.get::<Transform>())
        else {
            return Err(SnapshotError::NoBody(entity));
        };
        particles.check(particles.len())?;
        let pinned = particles.inverse_mass.iter().zip(&particles.inverse_inertia).zip(0..);
        Ok(Self {
            version: Self::VERSION,
            body: fingerprint(particles, soft),
            origin: transform.translation,
            position: particles.position.clone(),
            velocity: particles.velocity.clone(),
            rotation: particles.rotation.clone(),
            angular_velocity: particles.angular_velocity.clone(),
            free: body.get::<ContactMemory>().map_or(Vec::new(), |memory| memory.position.clone()),
            pinned: pinned.map(|((&w, &j), i)| (i, w == 0.0, j == 0.0)).filter(|&(_, w, j)| w || j).collect(),
            held: body.get::<PinState>().map_or(Vec::new(), |state| state.held.clone()),
            pins: body.get::<Pins>().map(|pins| pins.list.iter().map(PinRecord::from).collect()),
            frozen: body.contains::<Frozen>(),
            stillness: body.get::<Stillness>().map_or(0.0, |still| still.0),
            asleep: body.get::<Sleeping>().map(Sleeping::conditions),
            memory: Memory::of(&body, particles),
            neighbours: world.get_resource::<BodyPairs>().map_or(Vec::new(), |pairs| pairs.memory_of(entity)),
        })
    }

    /// Puts the state back into the body `entity`.
    ///
    /// # Errors
    ///
    /// If `entity` is not a soft body, or not one made from the same rig at the same scale, or lacks a component that the snapshot is about, or something in the snapshot is out of range. Nothing is changed then.
    pub fn restore(&self, world: &mut World, entity: Entity) -> Result<(), SnapshotError> {
        let no_body = || SnapshotError::NoBody(entity);
        let body = world.get_entity(entity).map_err(|_| no_body())?;
        let (Some(now), Some(soft)) = (body.get::<Particles>(), body.get::<SoftBody>()) else { return Err(no_body()) };
        if !(body.contains::<Transform>() && body.contains::<StepStart>()) {
            return Err(no_body());
        }
        let mut particles = self.particles_for(now, soft)?;
        let range = |what, range| SnapshotError::Range { what, range };
        let pins = match &self.pins {
            Some(list) => {
                let list: Option<_> = list.iter().map(PinRecord::pin).collect();
                Some(Pins { list: list.ok_or_else(|| range("the entity a pin is tied to", "an entity's bits"))? })
            }
            None => None,
        };
        if let Some(what) = self.memory.misfit(&body, &particles) {
            return Err(SnapshotError::Capability(what));
        }
        if !self.neighbours.iter().all(|neighbour| neighbour.is_sound(entity, now.len())) {
            return Err(range("what is known of a body nearby", "sound"));
        }

        if let Some(mut pairs) = world.get_resource_mut::<BodyPairs>() {
            pairs.remember(entity, &self.neighbours);
        }
        let mut body = world.entity_mut(entity);
        match pins {
            Some(pins) => {
                let state = PinState::restored(&self.held, &pins, &mut particles);
                body.insert((pins, state));
            }
            None => {
                body.remove::<(Pins, PinState)>();
            }
        }
        if let Some(mut start) = body.get_mut::<StepStart>() {
            *start = StepStart { position: particles.position.clone(), rotation: particles.rotation.clone(), origin: self.origin };
        }
        if let Some(mut memory) = body.get_mut::<ContactMemory>() {
            memory.position.clone_from(&self.free);
        }
        if let Some(mut still) = body.get_mut::<Stillness>() {
            still.0 = self.stillness;
        }
        if let Some(mut old) = body.get_mut::<Particles>() {
            old.0 = particles;
        }
        if let Some(mut transform) = body.get_mut::<Transform>() {
            *transform = Transform::from_translation(self.origin);
        }
        body.insert(Recall(self.memory.clone()));
        match self.frozen {
            true => body.insert(Frozen),
            false => body.remove::<Frozen>(),
        };
        body.remove::<Sleeping>();
        if let Some(conditions) = self.asleep {
            // What was written until now is no reason to wake; what is written from now on is.
            let now = world.increment_change_tick();
            world.entity_mut(entity).insert(Sleeping::restored(now, conditions));
        }
        Ok(())
    }

    /// The snapshot as bytes (postcard).
    pub fn to_bytes(&self) -> Vec<u8> {
        // Writing to memory what derives its form does not fail; if it did, there would be nothing to read.
        postcard::to_stdvec(self).unwrap_or_default()
    }

    /// Reads what [`to_bytes`](Self::to_bytes) wrote.
    ///
    /// # Errors
    ///
    /// If the bytes are of another version, end too early, go on too long, or are no snapshot. What they say is checked by [`restore`](Self::restore).
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, SnapshotError> {
        let garbled = |error: postcard::Error| SnapshotError::Bytes(error.to_string());
        let (found, _) = postcard::take_from_bytes::<u32>(bytes).map_err(garbled)?;
        if found != Self::VERSION {
            return Err(SnapshotError::Version { found, expected: Self::VERSION });
        }
        match postcard::take_from_bytes::<Self>(bytes).map_err(garbled)? {
            (snapshot, []) => Ok(snapshot),
            (_, rest) => Err(SnapshotError::Trailing(rest.len())),
        }
    }

    /// `now` with the state of the snapshot, if that fits it and is in order.
    fn particles_for(&self, now: &polpo_solver::Particles, soft: &SoftBody) -> Result<polpo_solver::Particles, SnapshotError> {
        if self.version != Self::VERSION {
            return Err(SnapshotError::Version { found: self.version, expected: Self::VERSION });
        }
        let count = now.len();
        if self.position.len() != count {
            return Err(SnapshotError::Count { found: self.position.len(), expected: count });
        }
        let mut particles = now.clone();
        particles.position.clone_from(&self.position);
        particles.previous_position.clone_from(&self.position);
        particles.velocity.clone_from(&self.velocity);
        particles.rotation.clone_from(&self.rotation);
        particles.previous_rotation.clone_from(&self.rotation);
        particles.angular_velocity.clone_from(&self.angular_velocity);
        particles.reaction.clear();
        particles.check(count)?;
        if self.body != fingerprint(now, soft) {
            return Err(SnapshotError::OtherBody);
        }
        let memory = self.free.is_empty() || self.free.len() == count;
        for (fine, what, range) in [
            (self.origin.is_finite(), "the origin", "finite"),
            (memory, "the number of free positions", "none or that of the particles"),
            (self.free.iter().all(|at| at.is_finite()), "a free position", "finite"),
            (self.stillness >= 0.0, "the time the body has been still", "0 or more"),
            (
                self.pinned.iter().map(|p| p.0).chain(self.held.iter().copied()).all(|i| (i as usize) < count),
                "a pinned particle",
                "among the particles",
            ),
            (self.asleep.flatten().is_none_or(Conditions::is_finite), "the gravity or wind it fell asleep in", "finite"),
        ] {
            if !fine {
                return Err(SnapshotError::Range { what, range });
            }
        }
        for i in 0..count {
            particles.pin(i, false, false);
        }
        for &(i, position, rotation) in &self.pinned {
            particles.pin(i as usize, position, rotation);
        }
        Ok(particles)
    }
}

/// A number for what a body is made of: its particles at rest, and the rig's edges. Not the masses, which rods may not have given yet.
fn fingerprint(particles: &polpo_solver::Particles, soft: &SoftBody) -> u64 {
    let mut hash = Fnv::default();
    for list in [&particles.rest_position, &particles.radii] {
        hash.eat_all(list.iter().flat_map(|v| v.to_array()));
    }
    hash.eat_all(particles.frame.iter().flat_map(|q| q.to_array()));
    soft.rig.edges.iter().flatten().for_each(|i| hash.eat(&i.to_le_bytes()));
    hash.0
}
