//! In the render world: finding each mesh in its vertex slab and uploading the frame's transforms.

use std::collections::BTreeMap;
use std::sync::{Arc, Weak};

use bevy::app::SubApp;
use bevy::prelude::*;
use bevy::render::mesh::allocator::{MeshAllocator, MeshAllocatorSettings};
use bevy::render::render_resource::BufferUsages;
use bevy::render::renderer::{RenderDevice, RenderQueue};
use bevy::render::{Render, RenderStartup, RenderSystems};
use polpo_skinning::{GpuBinding, GpuError, SkinFrame, SkinPipeline, Target};

use super::attach::SharedBinding;
use super::extract::{ExtractedSkin, ExtractedSkins};

/// All that lives on the GPU; made anew when the device is.
#[derive(Resource)]
pub(super) struct SkinBuffers {
    pub(super) pipeline: SkinPipeline,
    pub(super) frame: SkinFrame,
    /// By the address of the shared binding. The weak pointer keeps the address from being given to another binding.
    bindings: BTreeMap<usize, (Weak<SharedBinding>, Result<GpuBinding, GpuError>)>,
    /// The last error that was logged, so that a lasting one is logged once.
    reported: Option<GpuError>,
}

pub(super) fn build(render_app: &mut SubApp) {
    // The slabs are made when the renderer starts, after all plugins have finished.
    render_app.world_mut().get_resource_or_init::<MeshAllocatorSettings>().extra_buffer_usages |= BufferUsages::STORAGE;
    render_app.add_systems(RenderStartup, start).add_systems(
        Render,
        prepare_skins
            .in_set(RenderSystems::PrepareResources)
            .run_if(resource_exists::<SkinBuffers>)
            .run_if(resource_exists::<MeshAllocator>),
    );
}

fn start(mut commands: Commands, device: Res<RenderDevice>) {
    commands.remove_resource::<SkinBuffers>();
    match SkinPipeline::new(device.wgpu_device()) {
        Ok(pipeline) => {
            let buffers = SkinBuffers { pipeline, frame: SkinFrame::default(), bindings: BTreeMap::new(), reported: None };
            commands.insert_resource(buffers);
        }
        // The limits were checked before, on the same device unless a lost one was replaced by a lesser.
        Err(error) => tracing::error!("soft bodies are not skinned: {error}"),
    }
}

fn prepare_skins(
    mut buffers: ResMut<SkinBuffers>,
    extracted: Res<ExtractedSkins>,
    allocator: Res<MeshAllocator>,
    device: Res<RenderDevice>,
    queue: Res<RenderQueue>,
) {
    let buffers = &mut *buffers;
    buffers.bindings.retain(|_, (shared, _)| shared.strong_count() > 0);
    let mut failed = None;
    for skin in &extracted.0 {
        if let Err(error) = add_body(buffers, skin, &allocator, &device) {
            failed = Some(error);
        }
    }
    if let Err(error) = buffers.frame.upload(device.wgpu_device(), &queue, &buffers.pipeline) {
        failed = Some(error);
    }
    if failed != buffers.reported {
        if let Some(error) = &failed {
            tracing::error!("a soft body is not skinned: {error}");
        }
        buffers.reported = failed;
    }
}

/// A mesh that is not in a slab yet (its upload may wait for a later frame) is left out.
fn add_body(buffers: &mut SkinBuffers, skin: &ExtractedSkin, allocator: &MeshAllocator, device: &RenderDevice) -> Result<(), GpuError> {
    let SkinBuffers { bindings, frame, .. } = buffers;
    let (_, binding) = bindings
        .entry(Arc::as_ptr(&skin.shared) as usize)
        .or_insert_with(|| (Arc::downgrade(&skin.shared), GpuBinding::new(device.wgpu_device(), &skin.shared.binding)));
    let binding = binding.as_ref().map_err(Clone::clone)?;
    // Slabs grow and move, so this is looked up every frame.
    let Some(slice) = allocator.mesh_vertex_slice(&skin.mesh) else {
        return Ok(());
    };
    // Never a vertex of a neighbour's.
    if slice.range.len() < binding.vertex_count() as usize {
        return Ok(());
    }
    let layout = skin.shared.layout;
    let target = Target { buffer: slice.buffer, first_word: u64::from(slice.range.start) * u64::from(layout.stride), layout };
    frame.add_body(binding, target, skin.transforms.clone())
}
