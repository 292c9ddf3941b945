//! Rigs, recipes and whole models as Bevy assets, and bodies that are made of them.
//!
//! ```no_run
//! use bevy::prelude::*;
//! use polpo::prelude::*;
//!
//! fn spawn(mut commands: Commands, assets: Res<AssetServer>) {
//!     commands.spawn((SoftBodyScene::new(assets.load("fish.glb")), Transform::from_xyz(0.0, 2.0, 0.0)));
//! }
//! ```
//!
//! | file | what |
//! |---|---|
//! | `rig.rs` | `.rig` and `.rig.ron` files: [`RigAsset`]; a body made of one: [`SoftBodyRig`] |
//! | `recipe.rs` | `.rig.toml` files: [`RecipeAsset`] |
//! | `model.rs` | mesh files: [`SoftBodyModel`] |
//! | `scene.rs` | a body made of a model: [`SoftBodyScene`] |
//! | `rigging.rs` | models without a rig are rigged on other threads, if Bevy has any, each once |
//! | `build.rs` | when all is there the body is built; when a file changes it is built anew, where it is |

mod build;
mod document;
mod model;
mod recipe;
mod rig;
mod rigging;
mod scene;

use bevy::prelude::*;

#[cfg(feature = "gltf")]
pub(crate) use build::{Awaiting, AwaitsDress, SceneBuilt, look_again};
pub use build::{LoadError, SoftBodyLoadFailed, SoftBodyReady};
pub use model::{ModelError, SoftBodyModel};
pub use recipe::RecipeAsset;
pub use rig::{RigAsset, SoftBodyRig};
pub use scene::{RigSource, SoftBodyScene};

/// Loads rigs, recipes and models, and makes bodies of [`SoftBodyScene`] and [`SoftBodyRig`]. Comes with the `PolpoRenderPlugin`; add it yourself where nothing is drawn. Needs Bevy's `AssetPlugin` before it, and
/// without that does nothing.
#[derive(Debug, Clone, Copy, Default)]
pub struct PolpoAssetsPlugin;

/// What the plugin's systems in `Update` are in. A body whose files are there by then is built in them.
#[derive(SystemSet, Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct SoftBodyAssetSystems;

impl Plugin for PolpoAssetsPlugin {
    // The `PolpoRenderPlugin` brings it, and so may anybody else.
    fn is_unique(&self) -> bool {
        false
    }

    fn build(&self, app: &mut App) {
        if app.world().contains_resource::<rigging::Rigging>() {
            return;
        }
        if !app.world().contains_resource::<AssetServer>() {
            tracing::warn!(
                "soft bodies are not loaded from files: there is no AssetServer (add PolpoAssetsPlugin or PolpoRenderPlugin after AssetPlugin)"
            );
            return;
        }
        app.init_asset::<RigAsset>()
            .init_asset::<RecipeAsset>()
            .init_asset::<SoftBodyModel>()
            .register_asset_loader(rig::RigLoader)
            .register_asset_loader(recipe::RecipeLoader)
            .register_asset_loader(model::ModelLoader)
            .init_resource::<rigging::Rigging>()
            .add_observer(build::await_files::<SoftBodyScene>)
            .add_observer(build::await_files::<SoftBodyRig>)
            .add_systems(
                Update,
                (build::await_changed, (rig::build_rigs, scene::build_scenes).run_if(any_with_component::<Awaiting>))
                    .chain()
                    .in_set(SoftBodyAssetSystems),
            );
    }
}
