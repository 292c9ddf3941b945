//! Skinning in Bevy's renderer: a body's particles deform the game's own mesh, under any material.
//!
//! Add [`PolpoRenderPlugin`] after `DefaultPlugins`, and put a `Mesh3d` with the mesh the rig was made for, and any material, beside the [`SoftBody`](crate::SoftBody). What happens then, every
//! frame and in this order:
//!
//! | file | schedule | what |
//! |---|---|---|
//! | `attach.rs` | `PostUpdate` | a new body gets a mesh of its own and the component [`Skin`]; errors go out as [`SkinRejected`] |
//! | `pose.rs` | `PostUpdate` | particle transforms, interpolated between fixed steps; the `Aabb` for culling |
//! | `cpu_fallback.rs` | `PostUpdate` | without compute shaders only: the mesh asset is rewritten |
//! | `extract.rs` | `ExtractSchedule` | transforms of the visible bodies go to the render world |
//! | `prepare.rs` | `Render`, `PrepareResources` | where each mesh lies in its vertex slab; upload |
//! | `node.rs` | `RenderGraph`, `Begin` | one compute pass for all bodies, before any camera draws |
//!
//! The vertices that materials, prepasses and shadows read are the skinned ones, so all of those work unchanged. Not covered: motion vectors know the entity's motion but not the mesh's own
//! deformation, so TAA and motion blur smear it a little.
//!
//! A body of several meshes has them on entities of their own, each a [`SkinPart`]. With the feature `gltf` the parts of a [`SoftBodyScene`](crate::SoftBodyScene) come by themselves, in the
//! materials of its file.
//!
//! [`PolpoGizmosPlugin`] draws particles, edges and contacts.

mod attach;
mod cpu_fallback;
mod extract;
mod gizmos;
mod mesh;
mod node;
mod parts;
mod pose;
mod prepare;

use bevy::asset::AssetEventSystems;
use bevy::diagnostic::DiagnosticPath;
use bevy::prelude::*;
use bevy::render::RenderApp;
use bevy::render::renderer::{RenderAdapter, RenderDevice};
use core::time::Duration;

use crate::PolpoAssetsPlugin;

pub use attach::{Skin, SkinError, SkinRejected};
pub use gizmos::{PolpoGizmoGroup, PolpoGizmos, PolpoGizmosPlugin};
pub use mesh::bevy_mesh;
#[cfg(feature = "gltf")]
pub(crate) use mesh::mesh_of_part;
pub use parts::{SkinPart, SkinParts};
pub use polpo_skinning as skinning;
pub use pose::SkinPose;

/// The diagnostic with the GPU time of the skinning pass \[ms\]. It is there if `RenderDiagnosticsPlugin` was added and the GPU has timestamps.
pub const SKIN_GPU_TIME: DiagnosticPath = DiagnosticPath::const_new("render/skin/elapsed_gpu");

/// Where the vertices are computed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SkinningBackend {
    /// In a compute shader where there is one, else on the CPU with a warning in the log.
    #[default]
    Auto,
    /// On the CPU: the mesh asset is rewritten and uploaded every frame. For comparison, and for drivers that cannot be trusted.
    Cpu,
}

/// Skins soft bodies in Bevy's renderer. Add it after `DefaultPlugins` (or `RenderPlugin`); before them, or without a renderer, the CPU does the work.
#[derive(Debug, Clone)]
pub struct PolpoRenderPlugin {
    /// Where the vertices are computed. Default: in a compute shader if possible.
    pub backend: SkinningBackend,
    /// Whether the mesh is drawn between the last two fixed steps, by the overstep of `Time<Fixed>`. Default true: motion is smooth at any frame rate, and lags by up to a step.
    ///
    /// Set it to false if the [`PolpoPlugin`](crate::PolpoPlugin) runs in another schedule than `FixedPostUpdate`: there, the last step is the present.
    pub interpolate: bool,
}

impl Default for PolpoRenderPlugin {
    fn default() -> Self {
        Self { backend: SkinningBackend::Auto, interpolate: true }
    }
}

/// What the plugin's systems in `PostUpdate` are in. They read [`Particles`](crate::Particles): whatever moves particles by hand in `PostUpdate` goes before this set.
#[derive(SystemSet, Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct SkinSystems;

/// What skinning did in the last frame.
#[derive(Resource, Debug, Clone, Copy, Default)]
pub struct SkinningStats {
    /// Whether the CPU computes the vertices.
    pub on_cpu: bool,
    /// Bodies with a [`Skin`], on themselves or on parts.
    pub bodies: usize,
    /// Time for the particle transforms and boxes of all bodies.
    pub pose_time: Duration,
    /// Time for the vertices on the CPU; zero if the GPU does them, whose time is under [`SKIN_GPU_TIME`].
    pub cpu_skin_time: Duration,
}

/// Whether poses are interpolated; see [`PolpoRenderPlugin::interpolate`].
#[derive(Resource, Debug, Clone, Copy)]
struct Interpolate(bool);

impl Plugin for PolpoRenderPlugin {
    fn build(&self, app: &mut App) {
        app.add_plugins(PolpoAssetsPlugin);
        #[cfg(feature = "gltf")]
        app.add_plugins(crate::dress::DressPlugin);
        app.insert_resource(Interpolate(self.interpolate))
            .init_resource::<SkinningStats>()
            .init_resource::<attach::Bindings>()
            .configure_sets(
                PostUpdate,
                // Meshes added or rewritten here are in this frame's asset events, so that they are drawn in this frame.
                SkinSystems.before(AssetEventSystems),
            )
            .add_systems(
                PostUpdate,
                (
                    attach::detach_skins,
                    attach::attach_skins,
                    pose::pose_skins,
                    pose::bound_parts.run_if(any_with_component::<SkinPart>),
                    cpu_fallback::skin_on_cpu.run_if(on_cpu),
                )
                    .chain()
                    .in_set(SkinSystems)
                    .run_if(resource_exists::<Assets<Mesh>>),
            );
    }

    fn finish(&self, app: &mut App) {
        let on_cpu = match (self.backend, gpu_fault(app)) {
            (SkinningBackend::Cpu, _) => true,
            (SkinningBackend::Auto, None) => false,
            (SkinningBackend::Auto, Some(fault)) => {
                tracing::warn!("soft bodies are skinned on the CPU: {fault}");
                true
            }
        };
        app.world_mut().resource_mut::<SkinningStats>().on_cpu = on_cpu;
        if !on_cpu && let Some(render_app) = app.get_sub_app_mut(RenderApp) {
            extract::build(render_app);
            prepare::build(render_app);
            node::build(render_app);
        }
    }
}

/// Why this app cannot skin in a compute shader.
fn gpu_fault(app: &App) -> Option<String> {
    use bevy::render::render_resource::DownlevelFlags;
    let world = app.world();
    let (Some(device), Some(adapter)) = (world.get_resource::<RenderDevice>(), world.get_resource::<RenderAdapter>()) else {
        return Some("there is no renderer (add PolpoRenderPlugin after DefaultPlugins)".into());
    };
    if !adapter.get_downlevel_capabilities().flags.contains(DownlevelFlags::COMPUTE_SHADERS) {
        return Some("the graphics backend has no compute shaders".into());
    }
    polpo_skinning::SkinPipeline::check_limits(&device.limits()).err().map(|error| error.to_string())
}

fn on_cpu(stats: Res<SkinningStats>) -> bool {
    stats.on_cpu
}
