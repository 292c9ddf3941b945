//! Recipes as assets.

use bevy::asset::io::Reader;
use bevy::asset::{Asset, AssetLoader, LoadContext};
use bevy::prelude::*;
use bevy::reflect::TypePath;
use polpo_rig::{Recipe, RigError};

use super::document::all_of;

/// A recipe that was loaded from a `.rig.toml` file, or made by a program. When it changes, models rigged by it are rigged anew.
#[derive(Asset, TypePath, Debug, Clone, PartialEq, Deref)]
pub struct RecipeAsset(pub Recipe);

#[derive(TypePath)]
pub(super) struct RecipeLoader;

impl AssetLoader for RecipeLoader {
    type Asset = RecipeAsset;
    type Settings = ();
    type Error = RigError;

    async fn load(&self, reader: &mut dyn Reader, _: &(), context: &mut LoadContext<'_>) -> Result<RecipeAsset, RigError> {
        let name = context.path().to_string();
        let bytes = all_of(reader).await.map_err(|source| RigError::Io { name: name.clone(), source })?;
        let text = std::str::from_utf8(&bytes).map_err(|e| RigError::Recipe { name: name.clone(), reason: e.to_string() })?;
        Recipe::from_toml(&name, text).map(RecipeAsset)
    }

    fn extensions(&self) -> &[&str] {
        &["rig.toml"]
    }
}
