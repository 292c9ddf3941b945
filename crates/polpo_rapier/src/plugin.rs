//! The plugin: Rapier's colliders in every soft body's step.

use bevy::ecs::batching::BatchingStrategy;
use bevy::ecs::intern::Interned;
use bevy::ecs::schedule::ScheduleLabel;
use bevy::math::Vec3A;
use bevy::prelude::*;
use polpo::{Collision, Contacts, Frozen, Gravity, GravityScale, Particles, PolpoSystems, SoftBody, StepStart, SubstepSchedule};

use crate::push::Pushing;
use crate::{ContactDetector, DetectionInput, FreePositions, Obstacles, RapierWorld, follower, push, touched};

/// Lets soft bodies collide with the colliders of a [`RapierWorld`], which it inserts and steps.
///
/// In the step of `polpo::PolpoPlugin`, which must be in the same schedule: before [`PolpoSystems::Prepare`] each body's memory follows its origin; in [`PolpoSystems::DetectContacts`] the contacts
/// are found; after [`PolpoSystems::SolveContacts`] of every substep, bodies with [`PushRigidBodies`](crate::PushRigidBodies) push rigid ones; after [`PolpoSystems::Writeback`], in [`RapierSystems::Step`], the rigid bodies make the same step. So while the soft bodies step, the rigid ones are at the start of the step with the
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

/// What the detection remembers of a body: see [`FreePositions`]. Comes with [`Contacts`]. Remove it, or clear it, after writing to a body's particles by hand; it is made anew.
#[derive(Component, Debug, Default)]
pub struct ContactMemory {
    free: FreePositions,
    /// Scratch memory of its own, so that bodies can be worked on side by side.
    pub(crate) detector: ContactDetector,
    /// The position of the first particle when contacts were last found, which tells by how much the origin has been shifted since.
    first: Option<Vec3A>,
}

/// The snapshot of the running step.
#[derive(Resource, Default)]
pub(crate) struct Surroundings(pub(crate) Obstacles);

impl Plugin for PolpoRapierPlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<RapierWorld>()
            .init_resource::<Surroundings>()
            .init_resource::<Pushing>()
            .init_resource::<Gravity>()
            .register_required_components::<Contacts, ContactMemory>()
            .add_observer(forget)
            .configure_sets(self.schedule, RapierSystems::Step.after(PolpoSystems::Writeback))
            .add_systems(
                self.schedule,
                (
                    (follow_origin, follower::lead, push::free_the_tied).before(PolpoSystems::Prepare),
                    (detect_contacts, touched::list_touched, push::gather_movers).chain().in_set(PolpoSystems::DetectContacts),
                    (push::hand_over, step_rigid_bodies, push::after_rapier, follower::follow).chain().in_set(RapierSystems::Step),
                ),
            )
            .add_systems(SubstepSchedule, push::solve_pushes.after(PolpoSystems::SolveContacts).before(PolpoSystems::Integrate));
    }
}

/// A body that is built anew has no past.
fn forget(insert: On<Insert, SoftBody>, mut bodies: Query<&mut ContactMemory>) {
    if let Ok(mut memory) = bodies.get_mut(insert.entity) {
        *memory = ContactMemory::default();
    }
}

/// At this time `StepStart` still has the start of the last step, relative to the present origin; contacts were found then, relative to the origin of then. Moving a body by its `Transform` moves
/// its memory along, because nothing here is relative to the world.
fn follow_origin(mut bodies: Query<(&StepStart, &mut ContactMemory), Without<Frozen>>) {
    for (start, mut memory) in &mut bodies {
        if let (Some(now), Some(then)) = (start.position.first(), memory.first) {
            let shift = Vec3::from(*now - then);
            for at in &mut memory.free.position {
                *at += shift;
            }
        }
    }
}

fn detect_contacts(
    time: Res<Time>,
    gravity: Res<Gravity>,
    world: Res<RapierWorld>,
    mut surroundings: ResMut<Surroundings>,
    mut bodies: Query<(&Particles, &Transform, &Collision, Option<&GravityScale>, &mut Contacts, &mut ContactMemory), Without<Frozen>>,
) {
    /// What a particle costs near a collider, and what a parallel query must save before it gains anything \[ns\].
    const PARTICLE: usize = 200;
    const WORTHWHILE: usize = 200_000;
    if bodies.is_empty() {
        return;
    }
    let dt = time.delta_secs();
    surroundings.0.gather(&world.bodies, &world.colliders, dt);
    let (obstacles, colliders, gravity) = (&surroundings.0, &world.colliders, gravity.0);
    let detect = |(particles, transform, collision, scale, mut contacts, mut memory): (
        &Particles,
        &Transform,
        &Collision,
        Option<&GravityScale>,
        Mut<Contacts>,
        Mut<ContactMemory>,
    )| {
        let ContactMemory { free, detector, first } = &mut *memory;
        *first = particles.position.first().copied();
        let input = DetectionInput {
            particles,
            origin: transform.translation,
            acceleration: gravity * scale.map_or(1.0, |s| s.0),
            dt,
            friction: collision.friction,
            memberships: collision.memberships,
            filter: collision.filter,
        };
        detector.detect(&input, obstacles, colliders, free, &mut contacts.0);
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
