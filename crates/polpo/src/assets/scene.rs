//! A soft body from a model's file, in one component.

use std::sync::Arc;

use bevy::prelude::*;
use polpo_rig::{Recipe, Rig};

use super::build::{Awaiting, AwaitsDress, Found, LoadError, Seen, loaded, settle, stop_waiting};
use super::rigging::Rigging;
use super::{RecipeAsset, RigAsset, SoftBodyModel};

/// Makes an entity the soft body of a model: `SoftBodyScene::new(assets.load("fish.glb"))`.
///
/// As soon as the model and its rig are there, the entity becomes a [`SoftBody`](crate::SoftBody) where its `Transform` says, and [`SoftBodyReady`](crate::SoftBodyReady) is triggered. The entity should have no parent that moves.
/// With the feature `gltf` and the `PolpoRenderPlugin`, each node and primitive of a glTF becomes a child with its own mesh and material, which follows the body's particles
/// ([`SkinPart`](crate::render::SkinPart)); meshes of other formats become plain white children. Without, there is the body and nothing to see, as a server wants it.
///
/// What cannot be loaded or rigged is told by [`SoftBodyLoadFailed`](crate::SoftBodyLoadFailed) and an error in the log. When a file changes, which is noticed with Bevy's feature `file_watcher` only or told by `AssetServer::reload`,
/// its bodies are built anew, where they are and as fast as they are; if the new file is no good, they stay as they were, and that is told, too. A body that is built anew has back what comes with a [`SoftBody`](crate::SoftBody) and was taken off,
/// `Sleep` or `Torsion` say: take it off again when it is ready.
///
/// Inserting it again, with another model say, makes another body in the same place. Taking it off leaves the body.
///
/// One failure is not told: if a `.meta` file beside the model names another loader than ours, see [`SoftBodyModel`], there never is a body.
#[derive(Component, Debug, Clone, PartialEq)]
#[component(immutable)]
#[require(Transform)]
pub struct SoftBodyScene {
    /// The model.
    pub model: Handle<SoftBodyModel>,
    /// Where its rig comes from.
    pub rig: RigSource,
}

/// Where a model's rig comes from.
#[derive(Debug, Clone, PartialEq, Default)]
pub enum RigSource {
    /// From the model's own file. One that has none is rigged by the default [`Recipe`], once in a session: a second or so, in which there is no body yet. That is off the main thread with Bevy's feature `multi_threaded`; without, and on the web,
    /// the frame takes as long.
    #[default]
    Model,
    /// From a file of its own, which must have been made for this model.
    Rig(Handle<RigAsset>),
    /// It is made by this recipe, likewise once in a session.
    Recipe(Handle<RecipeAsset>),
}

impl RigSource {
    pub(super) fn rig(&self) -> Option<&Handle<RigAsset>> {
        match self {
            Self::Rig(rig) => Some(rig),
            _ => None,
        }
    }

    pub(super) fn recipe(&self) -> Option<&Handle<RecipeAsset>> {
        match self {
            Self::Recipe(recipe) => Some(recipe),
            _ => None,
        }
    }
}

impl SoftBodyScene {
    /// A body made of `model` and the rig in its file, or if it has none, rigged by the default recipe.
    pub fn new(model: Handle<SoftBodyModel>) -> Self {
        Self { model, rig: RigSource::Model }
    }

    /// The same with a rig from a file of its own.
    pub fn with_rig(self, rig: Handle<RigAsset>) -> Self {
        Self { rig: RigSource::Rig(rig), ..self }
    }

    /// The same with a rig made by a recipe.
    pub fn with_recipe(self, recipe: Handle<RecipeAsset>) -> Self {
        Self { rig: RigSource::Recipe(recipe), ..self }
    }

    /// The model's rig; `None` as long as something is still loading or being made.
    fn resolve(
        &self,
        models: &Assets<SoftBodyModel>,
        rigs: &Assets<RigAsset>,
        recipes: &Assets<RecipeAsset>,
        server: &AssetServer,
        rigging: &mut Rigging,
    ) -> Result<Option<Arc<Rig>>, LoadError> {
        let Some(model) = loaded(models, &self.model, server, "model")? else { return Ok(None) };
        model.check().map_err(LoadError::Rig)?;
        let mut made = |recipe: &Recipe| rigging.rig(model, recipe).map_err(LoadError::Rig);
        let rig = match &self.rig {
            RigSource::Rig(handle) => loaded(rigs, handle, server, "rig")?.map(|rig| rig.0.clone()),
            RigSource::Recipe(handle) => match loaded(recipes, handle, server, "recipe")? {
                Some(recipe) => made(recipe)?,
                None => None,
            },
            RigSource::Model => match model.rig().map_err(|error| LoadError::Rig(error.clone()))? {
                Some(rig) => Some(rig.clone()),
                None => made(&Recipe::default())?,
            },
        };
        let Some(rig) = rig else { return Ok(None) };
        model.check_rig(&rig).map_err(|error| LoadError::Rig(Arc::new(error)))?;
        Ok(Some(rig))
    }
}

pub(super) fn build_scenes(
    mut commands: Commands,
    awaiting: Query<(Entity, &SoftBodyScene, Option<&Seen>), (With<Awaiting>, Without<AwaitsDress>)>,
    models: Res<Assets<SoftBodyModel>>,
    rigs: Res<Assets<RigAsset>>,
    recipes: Res<Assets<RecipeAsset>>,
    server: Res<AssetServer>,
    mut rigging: ResMut<Rigging>,
) {
    for (entity, scene, seen) in &awaiting {
        let now = Seen {
            mesh: models.get(&scene.model).map(|model| model.mesh().clone()),
            rig: scene.rig.rig().and_then(|rig| rigs.get(rig)).map(|rig| rig.0.clone()),
            recipe: scene.rig.recipe().and_then(|recipe| recipes.get(recipe)).map(|recipe| recipe.0.clone()),
            complaint: None,
        };
        if seen.is_some_and(|seen| seen.is(&now)) {
            stop_waiting(&mut commands, entity);
            continue;
        }
        let Some(rig) = scene.resolve(&models, &rigs, &recipes, &server, &mut rigging).transpose() else { continue };
        let name = scene.rig.rig().and_then(Handle::path).or(scene.model.path()).map_or_else(|| "the rig".to_owned(), ToString::to_string);
        let (scene, found) = (scene.clone(), Found { name, rig, seen: now });
        commands.queue(move |world: &mut World| settle(world, entity, &scene, found));
    }
}
