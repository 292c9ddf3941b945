//! Waiting for files, and making bodies of them.

use std::sync::Arc;

use bevy::asset::{AssetLoadError, AssetLoadFailedEvent, LoadState};
use bevy::ecs::system::SystemParam;
use bevy::math::Vec3A;
use bevy::prelude::*;
use polpo_rig::{Mesh, Recipe, Rig, RigError};
use polpo_solver::{fit_rigid, momentum};

use super::{RecipeAsset, RigAsset, SoftBodyModel, SoftBodyRig, SoftBodyScene};
use crate::bodies::particles_at;
use crate::{Particles, RejectReason, SoftBody};

/// Triggered on an entity whose [`SoftBodyScene`] or [`SoftBodyRig`] has become a body, or has been built anew because a file changed. The children that a scene brings are there.
#[derive(EntityEvent, Debug, Clone)]
pub struct SoftBodyReady {
    /// The entity.
    pub entity: Entity,
}

/// Triggered on an entity whose [`SoftBodyScene`] or [`SoftBodyRig`] cannot become a body, or cannot become that of a file that has changed. A body that was there stays as it was. It is tried again when one of its files changes; one that
/// could not be read before and still cannot is not told of again.
#[derive(EntityEvent, Debug, Clone)]
pub struct SoftBodyLoadFailed {
    /// The entity.
    pub entity: Entity,
    /// Why.
    pub reason: LoadError,
}

/// Why a body could not be made of files. The message names the file.
#[derive(Debug, Clone, thiserror::Error)]
pub enum LoadError {
    /// A file could not be read, or is not what it should be. What our own loaders found ([`ModelError`](crate::ModelError) for models, `RigError` for rigs and recipes) is in [`AssetLoadError::AssetLoaderError`].
    #[error("{0}")]
    Asset(Arc<AssetLoadError>),
    /// A handle is the default one, which nothing was loaded for. Bevy gives it for a path that is not approved, too.
    #[error("its {0} is the default handle, which nothing was loaded for")]
    Nothing(&'static str),
    /// The model could not be rigged, or its rig is broken or was made for another mesh.
    #[error("{0}")]
    Rig(Arc<RigError>),
    /// The rig is whole, but cannot be simulated at the entity's `Transform`, or the `Transform` is not finite or not uniformly scaled.
    #[error("{name}: {reason}")]
    Rejected {
        /// The rig's file, or else the model's.
        name: String,
        /// What was wrong.
        reason: RejectReason,
    },
}

/// Has to be looked at: files were named or have changed, and not all of them were there yet.
#[derive(Component, Debug, Default)]
pub(crate) struct Awaiting;

/// The files as they were when the entity was last looked at to the end, good or bad; what had not loaded is `None`. The same files are not looked at, or told of, again.
#[derive(Component, Debug, Default)]
pub(super) struct Seen {
    pub(super) mesh: Option<Arc<Mesh>>,
    pub(super) rig: Option<Arc<Rig>>,
    pub(super) recipe: Option<Recipe>,
    /// What was told of a file that changed and is no good: Bevy says so twice.
    pub(super) complaint: Option<String>,
}

impl Seen {
    pub(super) fn is(&self, other: &Seen) -> bool {
        fn same<T>(a: &Option<Arc<T>>, b: &Option<Arc<T>>) -> bool {
            a.as_ref().map(Arc::as_ptr) == b.as_ref().map(Arc::as_ptr)
        }
        same(&self.mesh, &other.mesh) && same(&self.rig, &other.rig) && self.recipe == other.recipe
    }
}

/// What the model shall be drawn with is still loading; its body waits.
#[derive(Component, Debug)]
#[cfg_attr(not(feature = "gltf"), expect(dead_code, reason = "nothing is drawn"))]
pub(crate) struct AwaitsDress;

/// Triggered on a scene before it is ready: time to dress it.
#[derive(EntityEvent, Debug, Clone)]
#[cfg_attr(not(feature = "gltf"), expect(dead_code, reason = "nothing is drawn"))]
pub(crate) struct SceneBuilt {
    pub(crate) entity: Entity,
    pub(crate) mesh: Arc<Mesh>,
}

pub(super) fn await_files<C: Component>(insert: On<Insert, C>, mut commands: Commands) {
    look_again(&mut commands, insert.entity);
}

/// Has an entity looked at as if it never had been.
pub(crate) fn look_again(commands: &mut Commands, entity: Entity) {
    commands.entity(entity).try_remove::<Seen>().try_insert(Awaiting);
}

/// Ends the wait of an entity whose files are those that it has seen; one that has been given others since has seen nothing.
pub(super) fn stop_waiting(commands: &mut Commands, entity: Entity) {
    commands.entity(entity).queue_silenced(|mut entity: EntityWorldMut| {
        if entity.contains::<Seen>() {
            entity.remove::<Awaiting>();
        }
    });
}

/// What has become of the assets of one kind.
#[derive(SystemParam)]
pub(super) struct News<'w, 's, A: Asset> {
    assets: Res<'w, Assets<A>>,
    events: MessageReader<'w, 's, AssetEvent<A>>,
    failures: MessageReader<'w, 's, AssetLoadFailedEvent<A>>,
}

impl<A: Asset> News<'_, '_, A> {
    /// What has changed or come after all, and what is as it was because its new file is no good. What never was there, who waits for it finds out.
    fn read(&mut self) -> Vec<(AssetId<A>, Result<(), LoadError>)> {
        let changed = self.events.read().filter_map(|event| match event {
            AssetEvent::Added { id } | AssetEvent::Modified { id } => Some((*id, Ok(()))),
            _ => None,
        });
        let failures = self.failures.read().filter(|failure| self.assets.contains(failure.id));
        let failed = failures.map(|failure| (failure.id, Err(LoadError::Asset(Arc::new(failure.error.clone())))));
        changed.chain(failed).collect()
    }
}

/// What is made of an asset that has changed, or has come after all, is looked at again; if the new file is no good, that is told.
pub(super) fn await_changed(
    mut commands: Commands,
    mut models: News<SoftBodyModel>,
    mut rigs: News<RigAsset>,
    mut recipes: News<RecipeAsset>,
    scenes: Query<(Entity, &SoftBodyScene, Has<Awaiting>)>,
    bodies: Query<(Entity, &SoftBodyRig, Has<Awaiting>)>,
) {
    let (models, rigs, recipes) = (models.read(), rigs.read(), recipes.read());
    if models.is_empty() && rigs.is_empty() && recipes.is_empty() {
        return;
    }
    for (entity, scene, awaiting) in &scenes {
        let rig = scene.rig.rig().into_iter().flat_map(|rig| news_of(&rigs, rig));
        let recipe = scene.rig.recipe().into_iter().flat_map(|recipe| news_of(&recipes, recipe));
        news_of(&models, &scene.model).chain(rig).chain(recipe).for_each(|news| take_in(&mut commands, entity, awaiting, news));
    }
    for (entity, SoftBodyRig(rig), awaiting) in &bodies {
        news_of(&rigs, rig).for_each(|news| take_in(&mut commands, entity, awaiting, news));
    }
}

fn news_of<'a, A: Asset>(
    news: &'a [(AssetId<A>, Result<(), LoadError>)],
    of: &Handle<A>,
) -> impl Iterator<Item = &'a Result<(), LoadError>> {
    let of = of.id();
    news.iter().filter(move |(id, _)| *id == of).map(|(_, news)| news)
}

fn take_in(commands: &mut Commands, entity: Entity, awaiting: bool, news: &Result<(), LoadError>) {
    match news.clone() {
        Ok(()) => {
            commands.entity(entity).try_insert(Awaiting);
        }
        // One that waits is made of what was there before, and told of that.
        Err(_) if awaiting => {}
        Err(reason) => commands.queue(move |world: &mut World| {
            let Some(mut seen) = world.get_mut::<Seen>(entity) else { return };
            // Without the backtrace, which Bevy adds if it is asked to.
            let complaint = reason.to_string().lines().next().map(str::to_owned);
            if seen.complaint != complaint {
                seen.complaint = complaint;
                fail(world, entity, reason);
            }
        }),
    }
}

/// The asset, or `None` while it loads; `what` it is.
pub(super) fn loaded<'a, A: Asset>(
    assets: &'a Assets<A>,
    handle: &Handle<A>,
    server: &AssetServer,
    what: &'static str,
) -> Result<Option<&'a A>, LoadError> {
    match (assets.get(handle), server.load_state(handle)) {
        (Some(asset), _) => Ok(Some(asset)),
        (None, _) if handle.id() == AssetId::default() => Err(LoadError::Nothing(what)),
        (None, LoadState::Failed(error)) => Err(LoadError::Asset(error)),
        (None, _) => Ok(None),
    }
}

fn fail(world: &mut World, entity: Entity, reason: LoadError) {
    tracing::error!("soft body {entity} was not made: {reason}");
    world.trigger(SoftBodyLoadFailed { entity, reason });
}

/// What has come of an entity's files.
pub(super) struct Found {
    /// Names the rig in errors.
    pub(super) name: String,
    pub(super) rig: Result<Arc<Rig>, LoadError>,
    pub(super) seen: Seen,
}

/// Ends the wait of an entity: makes it a body, or tells why not. If its files are not those of `named` any more, they are left to be looked at: an observer of another body's, or of this one's as it is built, may put others there.
pub(super) fn settle<C: Component + PartialEq>(world: &mut World, entity: Entity, named: &C, found: Found) {
    let Found { name, rig, seen } = found;
    let is_named = |world: &World| world.get::<C>(entity) == Some(named);
    if !is_named(world) {
        return;
    }
    let Ok(mut body) = world.get_entity_mut(entity) else { return };
    let mesh = seen.mesh.clone();
    body.insert(seen);
    let made = rig.and_then(|rig| make_body(&mut body, rig, name));
    if let (Ok(()), Some(mesh)) = (&made, mesh)
        && is_named(world)
    {
        world.trigger(SceneBuilt { entity, mesh });
        // The children are still in the world's queue.
        world.flush();
    }
    if !is_named(world) {
        return;
    }
    if let Ok(mut body) = world.get_entity_mut(entity) {
        body.remove::<Awaiting>();
    }
    match made {
        // Somebody's observer has taken the body away.
        Ok(()) if world.get::<Particles>(entity).is_none() => {}
        Ok(()) => world.trigger(SoftBodyReady { entity }),
        Err(reason) => fail(world, entity, reason),
    }
}

/// Makes the entity a body of `rig`, or what is its body already one of `rig` in the same place. A rig that cannot be simulated there changes nothing.
fn make_body(body: &mut EntityWorldMut, rig: Arc<Rig>, name: String) -> Result<(), LoadError> {
    if body.get::<SoftBody>().is_some_and(|body| Arc::ptr_eq(&body.rig, &rig)) {
        return Ok(());
    }
    let before = Motion::of(body);
    let place = before.as_ref().map_or_else(|| body.get::<Transform>().copied().unwrap_or_default(), |before| before.transform);
    particles_at(&rig, &place).map_err(|reason| LoadError::Rejected { name, reason })?;
    body.insert((place, SoftBody::new(rig)));
    if let Some(before) = before
        && !body.is_despawned()
        && let Some(mut particles) = body.get_mut::<Particles>()
    {
        particles.set_rigid_velocity(before.linear, before.angular);
    }
    Ok(())
}

/// Where a body is and how it moves, as a rigid piece.
struct Motion {
    /// The one that puts the rig there.
    transform: Transform,
    linear: Vec3A,
    angular: Vec3A,
}

impl Motion {
    /// `None` for what is no body yet, or one whose numbers are none.
    fn of(body: &EntityWorldMut) -> Option<Motion> {
        let (soft, particles, transform) = (body.get::<SoftBody>()?, body.get::<Particles>()?, body.get::<Transform>()?);
        let (first, radii, rotation) = (soft.rig.particles.first()?, particles.radii.first()?, *particles.rotation.first()?);
        let rest: Vec3A = particles.rest_position.iter().zip(&particles.mass).map(|(&x, &m)| x * m).sum::<Vec3A>() / particles.total_mass();
        let rotation = fit_rigid(particles, rotation).rotation;
        let moving = momentum(particles);
        let transform = Transform {
            translation: transform.translation + Vec3::from(moving.center - rotation * rest),
            rotation,
            scale: Vec3::splat(radii.x / first.radii.x),
        };
        let angular = moving.inertia.inverse() * moving.angular;
        let motion = Motion {
            transform,
            linear: moving.linear / moving.mass,
            // One that has no inertia, or hardly any, does not spin.
            angular: if angular.is_finite() { angular } else { Vec3A::ZERO },
        };
        (motion.transform.is_finite() && motion.linear.is_finite()).then_some(motion)
    }
}
