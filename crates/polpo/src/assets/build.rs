//! Waiting for files, and making bodies of them.

use std::sync::Arc;

use bevy::asset::{AssetLoadError, LoadState};
use bevy::math::Vec3A;
use bevy::prelude::*;
use polpo_rig::{Mesh, Recipe, Rig, RigError};
use polpo_solver::{fit_rigid, momentum};

use super::{RecipeAsset, RigAsset, SoftBodyModel, SoftBodyRig, SoftBodyScene};
use crate::{Particles, SoftBody};

/// Triggered on an entity whose [`SoftBodyScene`] or [`SoftBodyRig`] has become a body, or has been built anew because a file changed. The children that a scene brings are there.
#[derive(EntityEvent, Debug, Clone)]
pub struct SoftBodyReady {
    /// The entity.
    pub entity: Entity,
}

/// Triggered on an entity whose [`SoftBodyScene`] or [`SoftBodyRig`] cannot become a body. A body that was there stays as it was. It is tried again when one of its files changes.
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
}

/// Has to be looked at: files were named or have changed, and not all of them were there yet.
#[derive(Component, Debug, Default)]
pub(super) struct Awaiting;

/// The files as they were when the entity was last looked at to the end, good or bad; what had not loaded is `None`. The same files are not looked at, or told of, again.
#[derive(Component, Debug, Default)]
pub(super) struct Seen {
    pub(super) mesh: Option<Arc<Mesh>>,
    pub(super) rig: Option<Arc<Rig>>,
    pub(super) recipe: Option<Recipe>,
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
    commands.entity(insert.entity).try_remove::<Seen>().try_insert(Awaiting);
}

/// What is made of an asset that has changed, or has come after all, is looked at again.
pub(super) fn await_changed(
    mut commands: Commands,
    mut models: MessageReader<AssetEvent<SoftBodyModel>>,
    mut rigs: MessageReader<AssetEvent<RigAsset>>,
    mut recipes: MessageReader<AssetEvent<RecipeAsset>>,
    scenes: Query<(Entity, &SoftBodyScene)>,
    bodies: Query<(Entity, &SoftBodyRig)>,
) {
    let (models, rigs, recipes) = (changed(&mut models), changed(&mut rigs), changed(&mut recipes));
    if models.is_empty() && rigs.is_empty() && recipes.is_empty() {
        return;
    }
    for (entity, scene) in &scenes {
        let (rig, recipe) = (scene.rig.rig().map(Handle::id), scene.rig.recipe().map(Handle::id));
        if models.contains(&scene.model.id()) || rig.is_some_and(|id| rigs.contains(&id)) || recipe.is_some_and(|id| recipes.contains(&id))
        {
            commands.entity(entity).try_insert(Awaiting);
        }
    }
    for (entity, SoftBodyRig(rig)) in &bodies {
        if rigs.contains(&rig.id()) {
            commands.entity(entity).try_insert(Awaiting);
        }
    }
}

fn changed<A: Asset>(events: &mut MessageReader<AssetEvent<A>>) -> Vec<AssetId<A>> {
    let of = |event: &AssetEvent<A>| match event {
        AssetEvent::Added { id } | AssetEvent::Modified { id } => Some(*id),
        _ => None,
    };
    events.read().filter_map(of).collect()
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

pub(super) fn fail(commands: &mut Commands, entity: Entity, seen: Seen, reason: LoadError) {
    tracing::error!("soft body {entity} was not made: {reason}");
    commands.entity(entity).try_remove::<Awaiting>().try_insert(seen);
    commands.trigger(SoftBodyLoadFailed { entity, reason });
}

/// Makes the entity a body of `rig`, or what is its body already one of `rig` in the same place.
pub(super) fn make_body(world: &mut World, entity: Entity, rig: Arc<Rig>, seen: Seen) {
    let Ok(mut body) = world.get_entity_mut(entity) else { return };
    let mesh = seen.mesh.clone();
    body.remove::<Awaiting>();
    body.insert(seen);
    if body.get::<SoftBody>().is_none_or(|body| !Arc::ptr_eq(&body.rig, &rig)) {
        let before = Motion::of(&body);
        if let Some(before) = &before {
            body.insert(before.transform);
        }
        body.insert(SoftBody::new(rig));
        // An observer of somebody's may have taken it away; a rig that cannot be simulated has been told of.
        let Ok(mut body) = world.get_entity_mut(entity) else { return };
        let Some(mut particles) = body.get_mut::<Particles>() else { return };
        if let Some(before) = before {
            particles.set_rigid_velocity(before.linear, before.angular);
        }
    }
    if let Some(mesh) = mesh {
        world.trigger(SceneBuilt { entity, mesh });
    }
    if world.get_entity(entity).is_ok() {
        world.trigger(SoftBodyReady { entity });
    }
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
