//! The plugin: Rapier's colliders in every soft body's step.

use bevy::ecs::batching::BatchingStrategy;
use bevy::ecs::intern::Interned;
use bevy::ecs::schedule::ScheduleLabel;
use bevy::prelude::*;
use polpo::{Awake, Collision, ContactMemory, Contacts, Gravity, GravityScale, ParticleFriction, Particles, PolpoSystems, SubstepSchedule};

use crate::last_look::{self, LastLook};
use crate::push::Pushing;
use crate::{ContactDetector, DetectionInput, Obstacles, RapierWorld, follower, push, sleep, touched};

/// Lets soft bodies collide with the colliders of a [`RapierWorld`], which it inserts and steps.
///
/// In the step of `polpo::PolpoPlugin`, which must be in the same schedule: in [`PolpoSystems::DetectContacts`] sleeping bodies wake near which a collider moves, has come, gone or changed, and the contacts are
/// found; after [`PolpoSystems::SolveContacts`] of every substep, bodies with [`PushRigidBodies`](crate::PushRigidBodies) push rigid ones, and particles that went into colliders where nobody had looked are
/// put back ([`LastLook`]); after [`PolpoSystems::Writeback`], in [`RapierSystems::Step`], the
/// rigid bodies make the same step. So while the soft bodies step, the rigid ones are at the start of the step with the
/// velocity they will have in it.
pub struct PolpoRapierPlugin {
    schedule: Interned<dyn ScheduleLabel>,
}

impl PolpoRapierPlugin {
    /// Works in `schedule` instead of `FixedPostUpdate`.
    pub fn new(schedule: impl ScheduleLabel) -> Self {
        Self { schedule: schedule.intern() }
    }
}

impl Default for PolpoRapierPlugin {
    fn default() -> Self {
        Self::new(FixedPostUpdate)
    }
}

/// What the plugin adds to the step.
#[derive(SystemSet, Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum RapierSystems {
    /// The rigid bodies are stepped. Drive kinematic ones before the soft step, in `FixedUpdate` say.
    Step,
}

/// Scratch memory of a body's own, so that bodies can be worked on side by side.
#[derive(Component, Debug, Default)]
pub(crate) struct Detector(pub(crate) ContactDetector);

/// The snapshot of the running step.
#[derive(Resource, Default)]
pub(crate) struct Surroundings(pub(crate) Obstacles);

impl Plugin for PolpoRapierPlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<RapierWorld>()
            .init_resource::<Surroundings>()
            .init_resource::<Pushing>()
            .init_resource::<LastLook>()
            .init_resource::<Gravity>()
            .register_required_components::<Contacts, ContactMemory>()
            .register_required_components::<Contacts, Detector>()
            .configure_sets(self.schedule, RapierSystems::Step.after(PolpoSystems::Writeback))
            .add_systems(
                self.schedule,
                (
                    (follower::lead, push::free_the_tied).before(PolpoSystems::Prepare),
                    (
                        gather_obstacles,
                        sleep::disturb,
                        detect_contacts,
                        touched::list_touched,
                        push::gather_movers,
                        sleep::wait_for_each_other,
                    )
                        .chain()
                        .after(PolpoSystems::FindPairs)
                        .in_set(PolpoSystems::DetectContacts),
                    (sleep::lull, push::hand_over, step_rigid_bodies, push::after_rapier, follower::follow)
                        .chain()
                        .in_set(RapierSystems::Step),
                ),
            )
            .add_observer(sleep::wake_carried)
            .add_observer(sleep::let_go)
            .add_systems(
                SubstepSchedule,
                (push::solve_pushes, last_look::last_look).chain().after(PolpoSystems::SolveContacts).before(PolpoSystems::Integrate),
            );
    }
}

fn gather_obstacles(time: Res<Time>, world: Res<RapierWorld>, mut surroundings: ResMut<Surroundings>, bodies: Query<(), With<Collision>>) {
    if !bodies.is_empty() {
        surroundings.0.gather(&world.bodies, &world.colliders, time.delta_secs());
    }
}

fn detect_contacts(
    time: Res<Time>,
    gravity: Res<Gravity>,
    world: Res<RapierWorld>,
    surroundings: Res<Surroundings>,
    mut bodies: Query<
        (
            &Particles,
            &Transform,
            (&Collision, Option<&ParticleFriction>),
            Option<&GravityScale>,
            &mut Contacts,
            &mut ContactMemory,
            &mut Detector,
        ),
        Awake,
    >,
) {
    /// What a particle costs near a collider, and what a parallel query must save before it gains anything \[ns\].
    const PARTICLE: usize = 200;
    const WORTHWHILE: usize = 200_000;
    if bodies.is_empty() {
        return;
    }
    let dt = time.delta_secs();
    let (obstacles, colliders, gravity) = (&surroundings.0, &world.colliders, gravity.0);
    let detect = |(particles, transform, (collision, frictions), scale, mut contacts, mut memory, mut detector): (
        &Particles,
        &Transform,
        (&Collision, Option<&ParticleFriction>),
        Option<&GravityScale>,
        Mut<Contacts>,
        Mut<ContactMemory>,
        Mut<Detector>,
    )| {
        let input = DetectionInput {
            particles,
            origin: transform.translation,
            acceleration: gravity * scale.map_or(1.0, |s| s.0),
            dt,
            friction: collision.friction,
            frictions: frictions.map_or(&[], |each| &each.0),
            memberships: collision.memberships,
            filter: collision.filter,
        };
        detector.0.detect(&input, obstacles, colliders, &mut memory.0, &mut contacts.0);
    };
    // Bodies do not see each other here, so the result does not depend on the number of threads.
    let total: usize = bodies.iter().map(|(particles, ..)| particles.len() * PARTICLE).sum();
    if !obstacles.is_empty() && total > WORTHWHILE {
        bodies.par_iter_mut().batching_strategy(BatchingStrategy::new().max_batch_size(1)).for_each(detect);
    } else {
        bodies.iter_mut().for_each(detect);
    }
}

fn step_rigid_bodies(time: Res<Time>, gravity: Res<Gravity>, mut world: ResMut<RapierWorld>) {
    world.step(gravity.0, time.delta_secs());
}
