//! Pins: particles held where something else says.

use bevy::math::Vec3A;
use bevy::prelude::*;
use polpo_solver::quat_log;
use serde::{Deserialize, Serialize};

use crate::particles::Awake;
use crate::{Gravity, GravityScale, Particles, SubstepTime};

/// Holds particles of the body in place: nails, hinges, a hand, a bone. Change the list at any time; what is no longer in it is free again. A body without pins pays nothing.
///
/// A pinned particle has infinite mass and, where its orientation is pinned, infinite inertia: constraints move only the others. A pin that moves goes from where the particle is to its target in
/// the course of one step, and its velocity is that of this way.
#[derive(Component, Debug, Clone, Default, PartialEq)]
#[require(PinState)]
pub struct Pins {
    /// The pins. Of several for the same particle the last counts; one for a particle that does not exist, or whose target is not finite, is left out.
    pub list: Vec<Pin>,
}

/// One particle held in place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pin {
    /// Index of the particle.
    pub particle: u32,
    /// To what it is tied.
    pub to: PinTarget,
    /// Whether its position is held; default true.
    pub position: bool,
    /// Whether its orientation is held; default false. A rod that is clamped at its end needs both.
    pub rotation: bool,
    /// The pull at which it gives way \[N\], the particle's own weight and inertia included, averaged over a step; default infinity, which never does. Then the pin is taken off the list and [`PinBroken`] is triggered. NaN never gives way.
    pub break_force: f32,
}

/// What a pin holds a particle to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PinTarget {
    /// A place in the world \[m\] and a rotation since rest.
    World(Vec3, Quat),
    /// A place in the axes of another entity, its parents' included: a hand, a bone, a vehicle. If the entity is gone, the particle stays where it is.
    Entity(Entity, Vec3, Quat),
}

impl Pin {
    /// Holds the position of `particle` at `place` \[m\] in the world.
    pub fn at(particle: u32, place: Vec3) -> Self {
        Self::new(particle, PinTarget::World(place, Quat::IDENTITY))
    }

    /// Holds the position of `particle` at `offset` \[m\] in the axes of `entity`.
    pub fn to_entity(particle: u32, entity: Entity, offset: Vec3) -> Self {
        Self::new(particle, PinTarget::Entity(entity, offset, Quat::IDENTITY))
    }

    /// Holds the position of `particle` to `to`.
    pub fn new(particle: u32, to: PinTarget) -> Self {
        Self { particle, to, position: true, rotation: false, break_force: f32::INFINITY }
    }

    /// Holds the orientation too.
    pub fn clamped(self) -> Self {
        Self { rotation: true, ..self }
    }

    /// Gives way at `force` \[N\].
    pub fn breaking_at(self, force: f32) -> Self {
        Self { break_force: force, ..self }
    }
}

/// Triggered on a body one of whose pins gave way.
#[derive(EntityEvent, Debug, Clone)]
pub struct PinBroken {
    /// The body.
    pub entity: Entity,
    /// The pin that was taken off.
    pub pin: Pin,
    /// The pull it did not bear \[N\].
    pub force: f32,
}

/// What the pins of a body did. There while [`Pins`] is.
#[derive(Component, Debug, Clone, Default)]
pub struct PinState {
    /// Which particles are pinned, so that they can be freed.
    pub(crate) held: Vec<u32>,
    /// The impulse that each particle's pin gave in this step \[N·s\]; as long as there are particles while a pin may break.
    impulse: Vec<Vec3A>,
    /// Length of the step so far \[s\].
    time: f32,
}

impl PinState {
    /// Makes room for what pins that may break will give.
    fn begin(&mut self, pins: &Pins, particles: &mut polpo_solver::Particles) {
        let breaking = pins.list.iter().any(|pin| pin.break_force.is_finite());
        let count = if breaking { particles.len() } else { 0 };
        for list in [&mut self.impulse, &mut particles.reaction] {
            list.clear();
            list.resize(count, Vec3A::ZERO);
        }
        self.time = 0.0;
    }

    /// That of `pins` which hold the particles `held`, between two steps.
    pub(crate) fn restored(held: &[u32], pins: &Pins, particles: &mut polpo_solver::Particles) -> Self {
        let mut state = Self { held: held.to_vec(), ..Self::default() };
        state.begin(pins, particles);
        state
    }
}

/// In phase `Prepare`: pins what is in the list, frees what no longer is, and gives what is pinned the velocity that takes it to its target in this step.
pub(crate) fn hold_pins(
    time: Res<Time>,
    mut bodies: Query<(&mut Particles, &Transform, &Pins, &mut PinState), Awake>,
    places: TransformHelper,
) {
    let dt = time.delta_secs();
    for (mut particles, origin, pins, mut state) in &mut bodies {
        release(&mut particles, &mut state.held);
        state.begin(pins, &mut particles);
        for pin in &pins.list {
            let i = pin.particle as usize;
            if !(pin.position || pin.rotation) {
                continue;
            }
            let Some((place, rotation)) = target_of(pin, &particles, origin, &places) else { continue };
            let here = origin.translation + Vec3::from(particles.position[i]);
            if dt <= 0.0 {
                continue;
            }
            particles.pin(i, pin.position, pin.rotation);
            state.held.push(pin.particle);
            if pin.position {
                let velocity = Vec3A::from(place - here) / dt;
                // Of several pins for one particle each sees what is left of the change: together they take it once.
                if let Some(impulse) = state.impulse.get_mut(i) {
                    *impulse += (particles.velocity[i] - velocity) * particles.mass[i];
                }
                particles.velocity[i] = velocity;
            }
            if pin.rotation {
                particles.angular_velocity[i] = quat_log(rotation * particles.rotation[i].inverse()) / dt;
            }
        }
    }
}

/// Where in the world `pin` holds its particle now, and how it is turned there. `None` if the particle does not exist or the target is not finite; where the particle is if the target's entity is gone.
pub(crate) fn target_of(pin: &Pin, particles: &Particles, origin: &Transform, places: &TransformHelper) -> Option<(Vec3, Quat)> {
    let i = pin.particle as usize;
    let (&x, &q) = (particles.position.get(i)?, particles.rotation.get(i)?);
    let (place, rotation) = match pin.to {
        PinTarget::World(place, rotation) => (place, rotation),
        PinTarget::Entity(entity, offset, rotation) => match places.compute_global_transform(entity) {
            Ok(there) => (there.transform_point(offset), there.rotation() * rotation),
            Err(_) => (origin.translation + Vec3::from(x), q),
        },
    };
    (place.is_finite() && rotation.is_finite() && rotation.length_squared() > 0.25).then(|| (place, rotation.normalize()))
}

/// A body that loses its pins is free.
pub(crate) fn release_pins(remove: On<Remove, Pins>, mut commands: Commands, mut bodies: Query<(&mut Particles, &mut PinState)>) {
    if let Ok((mut particles, mut state)) = bodies.get_mut(remove.entity) {
        release(&mut particles, &mut state.held);
        particles.reaction.clear();
        commands.entity(remove.entity).try_remove::<PinState>();
    }
}

fn release(particles: &mut polpo_solver::Particles, held: &mut Vec<u32>) {
    for i in held.drain(..) {
        if (i as usize) < particles.len() {
            particles.pin(i as usize, false, false);
        }
    }
}

/// In phase `Integrate`: sums up what the pins gave: what constraints pulled at them, and the weight of the particles that they hold, which no constraint carries.
pub(crate) fn sum_reactions(
    time: Res<SubstepTime>,
    gravity: Res<Gravity>,
    mut bodies: Query<(&mut Particles, &mut PinState, Option<&GravityScale>), Awake>,
) {
    for (mut particles, mut state, scale) in &mut bodies {
        state.time += time.delta;
        let PinState { impulse, .. } = &mut *state;
        if impulse.is_empty() {
            continue;
        }
        let fall = Vec3A::from(gravity.0) * (scale.map_or(1.0, |s| s.0) * time.delta);
        let polpo_solver::Particles { reaction, mass, inverse_mass, .. } = &mut particles.0;
        for (((sum, reaction), &m), &w) in impulse.iter_mut().zip(reaction).zip(&*mass).zip(&*inverse_mass) {
            *sum += core::mem::take(reaction);
            if w == 0.0 {
                *sum += fall * m;
            }
        }
    }
}

/// In phase `Writeback`: takes off the pins that were pulled too hard, and forgets the pulls: a body that falls asleep now and is woken in the middle of a step starts from nothing, too.
pub(crate) fn break_pins(mut commands: Commands, mut bodies: Query<(Entity, &mut Pins, &mut PinState), Awake>) {
    for (entity, mut pins, mut state) in &mut bodies {
        if state.impulse.is_empty() || state.time <= 0.0 {
            continue;
        }
        let (impulse, time) = (&state.impulse, state.time);
        let force = |pin: &Pin| impulse.get(pin.particle as usize).map_or(0.0, |impulse| impulse.length() / time);
        if pins.list.iter().any(|pin| force(pin) > pin.break_force) {
            pins.list.retain(|pin| {
                let pull = force(pin);
                if pull > pin.break_force {
                    commands.trigger(PinBroken { entity, pin: *pin, force: pull });
                    return false;
                }
                true
            });
        }
        state.impulse.fill(Vec3A::ZERO);
        state.time = 0.0;
    }
}

/// A [`Pin`] in a snapshot. An entity is kept as its bits, which mean something in the same world only.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct PinRecord {
    particle: u32,
    entity: Option<u64>,
    place: Vec3,
    turn: Quat,
    position: bool,
    rotation: bool,
    break_force: f32,
}

impl From<&Pin> for PinRecord {
    fn from(pin: &Pin) -> Self {
        let (entity, place, turn) = match pin.to {
            PinTarget::World(place, turn) => (None, place, turn),
            PinTarget::Entity(entity, place, turn) => (Some(entity.to_bits()), place, turn),
        };
        let Pin { particle, position, rotation, break_force, .. } = *pin;
        Self { particle, entity, place, turn, position, rotation, break_force }
    }
}

impl PinRecord {
    /// The pin. `None` if the bits are no entity's.
    pub(crate) fn pin(&self) -> Option<Pin> {
        let Self { particle, entity, place, turn, position, rotation, break_force } = *self;
        let to = match entity {
            None => PinTarget::World(place, turn),
            Some(bits) => PinTarget::Entity(Entity::try_from_bits(bits)?, place, turn),
        };
        Some(Pin { particle, to, position, rotation, break_force })
    }
}
