//! Rigs as assets.

use std::sync::Arc;

use bevy::asset::io::Reader;
use bevy::asset::{Asset, AssetLoader, LoadContext};
use bevy::prelude::*;
use bevy::reflect::TypePath;
use polpo_rig::{Rig, RigError};

use super::build::{Awaiting, Found, Seen, loaded, settle, stop_waiting};
use super::document::all_of;

/// A rig that was loaded from a `.rig` or a `.rig.ron` file. When the file changes (with Bevy's feature `file_watcher`), or the asset by hand, the bodies made of it are built anew, where they are.
#[derive(Asset, TypePath, Debug, Clone, Deref)]
pub struct RigAsset(pub Arc<Rig>);

impl RigAsset {
    /// A rig made by a program, for `Assets::add`.
    pub fn new(rig: impl Into<Arc<Rig>>) -> Self {
        Self(rig.into())
    }
}

/// Makes an entity a soft body as soon as the rig is loaded: inserts [`SoftBody`](crate::SoftBody). For one in a mesh of the game's own; [`SoftBodyScene`](crate::SoftBodyScene) brings its meshes along.
///
/// Triggers [`SoftBodyReady`](crate::SoftBodyReady), or [`SoftBodyLoadFailed`](crate::SoftBodyLoadFailed). Taking it off leaves the body as it is.
/// A body that is built anew because the file changed has back what comes with a [`SoftBody`](crate::SoftBody) and was taken off: take it off again when it is ready.
#[derive(Component, Debug, Clone, PartialEq)]
#[component(immutable)]
#[require(Transform)]
pub struct SoftBodyRig(pub Handle<RigAsset>);

#[derive(TypePath)]
pub(super) struct RigLoader;

impl AssetLoader for RigLoader {
    type Asset = RigAsset;
    type Settings = ();
    type Error = RigError;

    async fn load(&self, reader: &mut dyn Reader, _: &(), context: &mut LoadContext<'_>) -> Result<RigAsset, RigError> {
        let name = context.path().to_string();
        let bytes = all_of(reader).await.map_err(|source| RigError::Io { name: name.clone(), source })?;
        let is_text = context.path().path().extension().is_some_and(|e| e.eq_ignore_ascii_case("ron"));
        let rig = if is_text {
            let text = std::str::from_utf8(&bytes).map_err(|e| RigError::NotARig { name: name.clone(), reason: e.to_string() })?;
            Rig::from_ron(&name, text)?
        } else {
            Rig::from_postcard(&name, &bytes)?
        };
        Ok(RigAsset::new(rig))
    }

    fn extensions(&self) -> &[&str] {
        &["rig", "rig.ron"]
    }
}

pub(super) fn build_rigs(
    mut commands: Commands,
    awaiting: Query<(Entity, &SoftBodyRig, Option<&Seen>), With<Awaiting>>,
    rigs: Res<Assets<RigAsset>>,
    server: Res<AssetServer>,
) {
    for (entity, named, seen) in &awaiting {
        let SoftBodyRig(handle) = named;
        let now = Seen { rig: rigs.get(handle).map(|rig| rig.0.clone()), ..default() };
        if seen.is_some_and(|seen| seen.is(&now)) {
            stop_waiting(&mut commands, entity);
            continue;
        }
        let rig = loaded(&rigs, handle, &server, "rig").map(|rig| rig.map(|rig| rig.0.clone()));
        let Some(rig) = rig.transpose() else { continue };
        let name = handle.path().map_or_else(|| "the rig".to_owned(), ToString::to_string);
        let (named, found) = (named.clone(), Found { name, rig, seen: now });
        commands.queue(move |world: &mut World| settle(world, entity, &named, found));
    }
}
