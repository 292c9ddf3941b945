//! From the main world to the render world: the transforms of the bodies that some view or light sees.

use std::ops::Range;
use std::sync::Arc;

use bevy::app::SubApp;
use bevy::prelude::*;
use bevy::render::{Extract, ExtractSchedule};

use super::attach::{SharedBinding, Skin};
use super::prepare::SkinBuffers;

/// A body to be skinned in this frame.
pub(super) struct ExtractedSkin {
    pub(super) mesh: AssetId<Mesh>,
    pub(super) shared: Arc<SharedBinding>,
    /// Where its transforms lie in the frame's pool.
    pub(super) transforms: Range<u32>,
}

/// The bodies to be skinned in this frame.
#[derive(Resource, Default)]
pub(super) struct ExtractedSkins(pub(super) Vec<ExtractedSkin>);

pub(super) fn build(render_app: &mut SubApp) {
    render_app.init_resource::<ExtractedSkins>().add_systems(ExtractSchedule, extract_skins);
}

/// A body that nobody sees keeps the vertices it has; it is skinned again in the frame in which it is seen.
fn extract_skins(
    skins: Extract<Query<(&Skin, &Mesh3d, Option<&ViewVisibility>)>>,
    mut extracted: ResMut<ExtractedSkins>,
    buffers: Option<ResMut<SkinBuffers>>,
) {
    extracted.0.clear();
    let Some(mut buffers) = buffers else {
        return;
    };
    buffers.frame.clear();
    for (skin, mesh3d, visibility) in &skins {
        // Between a change of `Mesh3d` and the next binding the mesh is not ours to write.
        let is_own = mesh3d.0 == *skin.instance();
        if is_own && visibility.is_none_or(|visibility| visibility.get()) {
            let transforms = buffers.frame.add_transforms(&skin.transforms);
            extracted.0.push(ExtractedSkin { mesh: mesh3d.0.id(), shared: skin.shared.clone(), transforms });
        }
    }
}
