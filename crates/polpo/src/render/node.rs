//! The compute pass.

use bevy::app::SubApp;
use bevy::prelude::*;
use bevy::render::diagnostic::{RecordDiagnostics, begin_diagnostics_frame};
use bevy::render::render_resource::ComputePassDescriptor;
use bevy::render::renderer::{RenderContext, RenderGraph, RenderGraphSystems};

use super::prepare::SkinBuffers;

pub(super) fn build(render_app: &mut SubApp) {
    render_app.add_systems(
        RenderGraph,
        skin.in_set(RenderGraphSystems::Begin).after(begin_diagnostics_frame).run_if(resource_exists::<SkinBuffers>),
    );
}

/// One pass for all bodies, recorded before any camera's, so that whatever draws a mesh draws it skinned.
fn skin(mut context: RenderContext, buffers: Res<SkinBuffers>) {
    if buffers.frame.dispatch_count() == 0 {
        return;
    }
    let recorder = context.diagnostic_recorder();
    let recorder = recorder.as_deref();
    let descriptor = ComputePassDescriptor { label: Some("skin"), ..default() };
    let mut pass = context.command_encoder().begin_compute_pass(&descriptor);
    let span = recorder.pass_span(&mut pass, "skin");
    buffers.frame.dispatch(&buffers.pipeline, &mut pass);
    span.end(&mut pass);
}
