//! From the main world to the render world: the transforms of the bodies that some view or light sees.

use std::ops::Range;
use std::sync::Arc;

use bevy::app::SubApp;
use bevy::ecs::entity::EntityHashMap;
use bevy::prelude::*;
use bevy::render::{Extract, ExtractSchedule};

use super::attach::{SharedBinding, Skin};
use super::parts::SkinPart;
use super::pose::SkinPose;
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
    skins: Extract<Query<(Entity, &Skin, &Mesh3d, Option<&SkinPart>, Option<&ViewVisibility>)>>,
    poses: Extract<Query<&SkinPose>>,
    mut extracted: ResMut<ExtractedSkins>,
    mut parted: Local<EntityHashMap<Range<u32>>>,
    buffers: Option<ResMut<SkinBuffers>>,
) {
    extracted.0.clear();
    parted.clear();
    let Some(mut buffers) = buffers else {
        return;
    };
    buffers.frame.clear();
    for (entity, skin, mesh3d, part, visibility) in &skins {
        // Between a change of `Mesh3d` and the next binding the mesh is not ours to write.
        let is_own = mesh3d.0 == *skin.instance();
        if !is_own || visibility.is_some_and(|visibility| !visibility.get()) {
            continue;
        }
        let Ok(pose) = poses.get(part.map_or(entity, |part| part.body)) else {
            continue;
        };
        let mut add = || buffers.frame.add_transforms(pose.transforms());
        // The parts of a body share its transforms.
        let transforms = match part {
            Some(part) => parted.entry(part.body).or_insert_with(add).clone(),
            None => add(),
        };
        extracted.0.push(ExtractedSkin { mesh: mesh3d.0.id(), shared: skin.shared.clone(), transforms });
    }
}
