//! Sleep: a body that has come to rest costs nothing until something happens to it.

use bevy::ecs::change_detection::Tick;
use bevy::ecs::query::QueryData;
use bevy::ecs::system::SystemChangeTick;
use bevy::math::Vec3A;
use bevy::prelude::*;

use crate::particles::{Awake, for_each_body};
use crate::pins::target_of;
use crate::{
    AirDrag, BodyContact, BodyPairs, Collision, Damping, DistanceConstraints, EdgeStiffness, ExplicitGroups, Frozen, Grab, Gravity,
    GravityScale, Inflation, KeepMomentum, ParticleFriction, ParticleStiffness, Particles, Pins, Plasticity, RestPose, Rods, SelfContact,
    ShapeMatching, SolverSettings, StepStart, Torsion, Wind,
};

/// Lets the body fall asleep when it has come to rest. Comes with every [`SoftBody`](crate::SoftBody); a body without it never sleeps.
///
/// A sleeping body has the component [`Sleeping`] and takes no part in the step. It wakes when one of its components is written to, added or removed, when [`Gravity`], [`Wind`] (with [`AirDrag`]) or
/// [`SolverSettings`] differ from what it fell asleep under, when what a pin is tied to moves, and when a collider near it moves, comes, goes or changes (`polpo_rapier` looks after that), and
/// when another body that moves is about to touch it. Bodies that touch fall asleep together.
///
/// Not for measurements of slow things: what moves by less than a five-hundredth of its size a second, a body that creeps to its equilibrium say, is stopped.
#[derive(Component, Debug, Clone, Copy, PartialEq)]
#[require(Stillness)]
pub struct Sleep {
    /// A body is quiet while its particles get on, in the root mean square by mass, by less than this many of its radii of gyration a second \[1/s\]: a body of 0.3 m by less than 0.6 mm/s at the default 0.002.
    /// Range 0 and below, NaN (never) to infinity (always).
    pub speed: f32,
    /// How long it has to be quiet before it sleeps \[s\]; default 0.5. Range 0 (at once) to infinity (never); NaN is never.
    ///
    /// Shorter than a body hangs at the top of its rocking, and it sleeps there.
    pub time: f32,
}

impl Default for Sleep {
    fn default() -> Self {
        Self { speed: 0.002, time: 0.5 }
    }
}

impl Sleep {
    /// The speed below which a body of these `particles` is quiet, and what touches it as quiet as it \[m/s\]: [`speed`](Self::speed) times its radius of gyration. 0 without particles.
    pub fn quiet_speed(&self, particles: &Particles) -> f32 {
        let (mut size, mut mass) = (0.0, 0.0);
        for i in 0..particles.len() {
            size += particles.mass[i] * (particles.position[i].length_squared() + own_size(particles, i));
            mass += particles.mass[i];
        }
        if mass > 0.0 { self.speed * (size / mass).sqrt() } else { 0.0 }
    }
}

/// How long the body has been quiet \[s\]. Comes with [`Sleep`]; set it to 0 to keep a body awake a while longer.
#[derive(Component, Debug, Clone, Copy, PartialEq, Default)]
pub struct Stillness(pub f32);

/// The body sleeps: see [`Sleep`]. Observe its coming and going to be told; remove it to wake a body, insert the default to put one to sleep.
#[derive(Component, Debug, Clone, Default)]
pub struct Sleeping {
    /// What has changed later than this wakes the body. `None`: nothing so far.
    since: Option<Tick>,
    /// The world it fell asleep in.
    world: Option<Conditions>,
}

impl Sleeping {
    /// From now, the world's change tick, on, in a world that is as `world` says.
    pub(crate) fn restored(now: Tick, world: Option<Conditions>) -> Self {
        Self { since: Some(now), world }
    }

    pub(crate) fn conditions(&self) -> Option<Conditions> {
        self.world
    }
}

/// What acts on every body.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub(crate) struct Conditions {
    gravity: Vec3,
    wind: Vec3,
    substeps: u32,
    iterations: u32,
}

impl Conditions {
    pub(crate) fn is_finite(self) -> bool {
        self.gravity.is_finite() && self.wind.is_finite()
    }

    fn of(gravity: &Gravity, wind: &Wind, settings: &SolverSettings, drag: bool) -> Self {
        // A body that does not feel the wind does not wake when it turns.
        Self {
            gravity: gravity.0,
            wind: if drag { wind.0 } else { Vec3::ZERO },
            substeps: settings.substeps,
            iterations: settings.iterations,
        }
    }
}

/// The components that a sleeping body is watched for. Every component that the step reads, and that others may write, belongs here.
macro_rules! watched {
    ($($name:ident: $component:ty,)*) => {
        #[derive(QueryData)]
        pub(crate) struct Watched {
            $($name: Option<Ref<'static, $component>>,)*
        }

        impl WatchedItem<'_, '_> {
            /// Whether any of them was added or written to after `since`.
            fn touched(&self, since: Tick, now: Tick) -> bool {
                $(self.$name.as_ref().is_some_and(|c| c.last_changed().is_newer_than(since, now)))||*
            }
        }

        /// A component that is taken away wakes the body too.
        pub(crate) fn watch_removals(app: &mut App) {
            $(app.add_observer(wake_without::<$component>);)*
        }
    };
}

watched! {
    particles: Particles,
    transform: Transform,
    sleep: Sleep,
    stillness: Stillness,
    shape_matching: ShapeMatching,
    particle_stiffness: ParticleStiffness,
    distances: DistanceConstraints,
    torsion: Torsion,
    edge_stiffness: EdgeStiffness,
    rods: Rods,
    damping: Damping,
    keep_momentum: KeepMomentum,
    collision: Collision,
    particle_friction: ParticleFriction,
    grab: Grab,
    pins: Pins,
    gravity_scale: GravityScale,
    air_drag: AirDrag,
    body_contact: BodyContact,
    self_contact: SelfContact,
    explicit_groups: ExplicitGroups,
    plasticity: Plasticity,
    rest_pose: RestPose,
    inflation: Inflation,
}

fn wake_without<T: Component>(remove: On<Remove, T>, mut commands: Commands, sleeping: Query<(), With<Sleeping>>) {
    if sleeping.contains(remove.entity)
        && let Ok(mut body) = commands.get_entity(remove.entity)
    {
        body.try_remove::<Sleeping>();
    }
}

/// In phase `Prepare`, before anything else looks at the bodies: wakes those that something was done to.
pub(crate) fn wake(
    mut commands: Commands,
    ticks: SystemChangeTick,
    (gravity, wind, settings): (Res<Gravity>, Res<Wind>, Res<SolverSettings>),
    mut sleeping: Query<(Entity, &mut Sleeping, Watched, Has<Frozen>)>,
    places: TransformHelper,
) {
    let now = ticks.this_run();
    for (entity, mut sleep, watched, frozen) in &mut sleeping {
        let conditions = Conditions::of(&gravity, &wind, &settings, watched.air_drag.is_some());
        let sleep = sleep.bypass_change_detection();
        let touched = sleep.since.is_some_and(|since| watched.touched(since, now));
        sleep.since = Some(now);
        if touched || *sleep.world.get_or_insert(conditions) != conditions || pulled(&watched, &places) || frozen {
            commands.entity(entity).remove::<Sleeping>();
        }
    }
}

/// Whether the target of a pin has left its particle: by more than a thousandth of the particle, or what a float can tell so far out.
fn pulled(watched: &WatchedItem, places: &TransformHelper) -> bool {
    let (Some(pins), Some(p), Some(origin)) = (&watched.pins, &watched.particles, &watched.transform) else { return false };
    pins.list.iter().any(|pin| {
        let i = pin.particle as usize;
        let Some((place, rotation)) = target_of(pin, p, origin, places) else { return false };
        let (Some(&x), Some(&q), Some(radii)) = (p.position.get(i), p.rotation.get(i), p.radii.get(i)) else { return false };
        let here = origin.translation + Vec3::from(x);
        let tolerance = 1e-3 * radii.min_element() + 1e-6 * here.abs().max_element();
        (pin.position && here.distance(place) > tolerance) || (pin.rotation && q.dot(rotation).abs() < 1.0 - 1e-6)
    })
}

/// In phase `DetectContacts`, after the pairs of bodies are found: a body that moves wakes the sleeping ones that it may touch in this step, so that a pile wakes as it
/// slept, together: one that has just woken counts as moving, and wakes those it touches in the next step.
pub(crate) fn wake_touched(
    mut commands: Commands,
    pairs: Res<BodyPairs>,
    bodies: Query<(Option<(&Stillness, &Sleep)>, Has<Sleeping>, Has<Frozen>)>,
) {
    for pair in pairs.iter().filter(|pair| !pair.pairs().is_empty()) {
        let [first, second] = pair.bodies();
        for (sleeper, other) in [(first, second), (second, first)] {
            // A body that never sleeps counts as one that moves: nobody counts its stillness.
            let moves =
                bodies.get(other).is_ok_and(|(still, asleep, frozen)| !asleep && !frozen && still.is_none_or(|(still, _)| still.0 <= 0.0));
            if let (true, Ok((_, true, _))) = (moves, bodies.get(sleeper)) {
                commands.entity(sleeper).remove::<Sleeping>();
            }
        }
    }
}

/// In phase `Writeback`: counts how long each body has been quiet.
pub(crate) fn count_stillness(time: Res<Time>, mut bodies: Query<(&Particles, &StepStart, &Sleep, &mut Stillness), Awake>) {
    let dt = time.delta_secs();
    for_each_body(
        &mut bodies,
        |(particles, ..)| 5 * particles.len(),
        |(particles, start, sleep, mut stillness)| {
            stillness.0 = if is_quiet(particles, start, sleep.speed, dt) { stillness.0 + dt } else { 0.0 };
        },
    );
}

/// In phase `Writeback`, thereafter: puts to sleep those that have been quiet long enough, at rest.
pub(crate) fn fall_asleep(
    mut commands: Commands,
    ticks: SystemChangeTick,
    (gravity, wind, settings): (Res<Gravity>, Res<Wind>, Res<SolverSettings>),
    pairs: Res<BodyPairs>,
    mut ready: Local<Vec<Entity>>,
    awake: Query<(), (With<Particles>, Awake)>,
    mut bodies: Query<(Entity, &mut Particles, &mut StepStart, &Sleep, &mut Stillness, Has<AirDrag>), Awake>,
) {
    ready.clear();
    let enough = |sleep: &Sleep, still: f32| still > 0.0 && still >= sleep.time;
    ready.extend(bodies.iter().filter(|(_, _, _, sleep, still, _)| enough(sleep, still.0)).map(|(entity, ..)| entity));
    ready.sort_unstable();
    // Bodies that touch sleep together: one that touches another that has to wait waits too.
    let mut waiting = !ready.is_empty();
    while waiting {
        waiting = false;
        for pair in pairs.iter().filter(|pair| pair.touch()) {
            let [a, b] = pair.bodies();
            let at = [ready.binary_search(&a), ready.binary_search(&b)];
            let one = match at {
                [Ok(at), Err(_)] if awake.contains(b) => at,
                [Err(_), Ok(at)] if awake.contains(a) => at,
                _ => continue,
            };
            ready.remove(one);
            waiting = true;
        }
    }
    for &entity in &*ready {
        let Ok((_, mut particles, mut start, _, mut stillness, drag)) = bodies.get_mut(entity) else { continue };
        stillness.0 = 0.0;
        particles.velocity.fill(Vec3A::ZERO);
        particles.angular_velocity.fill(Vec3A::ZERO);
        // Nothing moves, so nothing is to be interpolated.
        start.position.clone_from(&particles.position);
        start.rotation.clone_from(&particles.rotation);
        let world = Conditions::of(&gravity, &wind, &settings, drag);
        commands.entity(entity).try_insert(Sleeping { since: Some(ticks.this_run()), world: Some(world) });
    }
}

/// Whether the particles went, or turned with their rims, by less than `speed` times the body's radius of gyration a second, in the step of `dt` \[s\] that began at `start`: in the root mean square by mass.
///
/// What they went, not their velocities and spins: where constraints and contacts turn a particle to and fro within a substep, about different axes, those turns add up to a spin of a radian a second and more that is no
/// turn in the end (rotations do not commute). And the mean, not the fastest: a particle caught between bodies may tremble for ever by a three-hundredth of its radius, because its planes are found anew each step.
fn is_quiet(particles: &Particles, start: &StepStart, speed: f32, dt: f32) -> bool {
    let (mut way, mut size) = (0.0, 0.0);
    for (i, (then, turned)) in start.position.iter().zip(&start.rotation).enumerate().take(particles.len()) {
        let own = own_size(particles, i);
        // Of a small turn by θ, 4·|vector part|² is θ².
        let turn = particles.rotation[i] * turned.inverse();
        let angle2 = 4.0 * turn.xyz().length_squared();
        way += particles.mass[i] * (particles.position[i].distance_squared(*then) + angle2 * own);
        size += particles.mass[i] * (particles.position[i].length_squared() + own);
    }
    // Also false for a speed that is negative or NaN.
    speed > 0.0 && way <= speed * speed * dt * dt * size
}

/// A third of the sum of the squared half axes of particle `i`: the square of their mean, near enough \[m²\].
fn own_size(particles: &Particles, i: usize) -> f32 {
    particles.radii[i].length_squared() * (1.0 / 3.0)
}
