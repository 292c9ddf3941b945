//! What a device needs once: the pipeline, and the packed bindings on the GPU. What a frame needs is in [`frame`](crate::frame).
//!
//! Limits of a device and what happens there:
//!
//! - 65535 workgroups a dimension: a dispatch is folded into two dimensions.
//! - `max_storage_buffer_binding_size` (128 MiB by default): a larger target buffer is bound in windows, each holding as many bodies as fit. One body, one binding or the frame's
//!   transforms beyond it (3.3 million vertices of 40 bytes, 2.8 million particles of 48 bytes) is an error.
//! - Fewer than four storage buffers in compute shaders (WebGL 2, some GL): [`SkinPipeline::new`] says so, and [`cpu`](crate::cpu) is the way.

use std::num::NonZeroU64;

use crate::Binding;
use crate::frame::GpuBatch;

/// Vertices a workgroup skins; as in `skin.wgsl`.
pub(crate) const WORKGROUP_SIZE: u32 = 64;

/// What is not there: an attribute that is not written, influences beyond the fourth; as in `skin.wgsl`.
pub(crate) const NONE: u32 = u32::MAX;

/// Why a GPU cannot skin, or cannot skin this.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum GpuError {
    /// The device lacks what the compute pass needs.
    #[error("the device has {limit} = {found}; skinning needs {needed}")]
    Limit {
        /// Name of the limit in `wgpu::Limits`.
        limit: &'static str,
        /// The device's.
        found: u64,
        /// What is needed.
        needed: u64,
    },
    /// An attribute does not fit into its vertex.
    #[error("attribute at word {offset} does not fit into a vertex of {stride} words")]
    Layout {
        /// Word offset of the attribute in the vertex.
        offset: u32,
        /// Words a vertex.
        stride: u32,
    },
    /// The vertices do not fit into the target buffer.
    #[error("{vertices} vertices of {stride} words from word {first_word} end outside a buffer of {bytes} bytes")]
    TargetRange {
        /// First word of the first vertex.
        first_word: u64,
        /// Words a vertex.
        stride: u32,
        /// Vertices.
        vertices: u32,
        /// Size of the target buffer.
        bytes: u64,
    },
    /// A body's transforms do not match its binding.
    #[error("{found} transforms for a binding of {particles} particles")]
    Transforms {
        /// Transforms given.
        found: u32,
        /// Particles of the binding.
        particles: u32,
    },
}

/// Where the attributes lie in an interleaved vertex, in words of 32 bits. Attributes are three (position, normal) or at least three (tangent) consecutive f32.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct VertexLayout {
    /// Words from one vertex to the next.
    pub stride: u32,
    /// Word offset of the position.
    pub position: u32,
    /// Word offset of the normal, `None` to leave normals alone.
    pub normal: Option<u32>,
    /// Word offset of the tangent, `None` to leave tangents alone; its fourth word is never written.
    pub tangent: Option<u32>,
}

/// The vertices of one body: a part of a vertex buffer that has `BufferUsages::STORAGE`.
#[derive(Clone, Copy, Debug)]
pub struct Target<'a> {
    /// The vertex buffer.
    pub buffer: &'a wgpu::Buffer,
    /// First word of the body's first vertex in it.
    pub first_word: u64,
    /// Layout of a vertex.
    pub layout: VertexLayout,
}

/// A [`Binding`] on the GPU, shared by all bodies of the same mesh and rig. Cloning shares the buffer.
#[derive(Clone, Debug)]
pub struct GpuBinding {
    pub(crate) rest: wgpu::Buffer,
    pub(crate) vertices: u32,
    pub(crate) particles: u32,
    pub(crate) has_normals: bool,
    pub(crate) has_tangents: bool,
    /// The word of `rest` at which the fifth to eighth influences start; as many as vertices, [`NONE`] if there are none.
    pub(crate) more: u32,
}

impl GpuBinding {
    /// Uploads `binding`: 40 bytes a vertex, 12 more with tangents, 16 more with more than four influences.
    pub fn new(device: &wgpu::Device, binding: &Binding) -> Result<Self, GpuError> {
        let vertices = binding.vertices();
        let tangents = binding.tangents();
        let more = binding.more();
        let bytes = size_of_val(vertices) + size_of_val(tangents) + size_of_val(more);
        check_binding_size(&device.limits(), bytes as u64)?;
        // The shader counts words of this buffer in 32 bits, which is 16 GiB.
        if bytes / 4 > u32::MAX as usize {
            return Err(GpuError::Limit { limit: "words of a binding", found: u32::MAX.into(), needed: bytes as u64 / 4 });
        }
        let rest = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("polpo rest vertices"),
            size: bytes as u64,
            usage: wgpu::BufferUsages::STORAGE,
            mapped_at_creation: true,
        });
        {
            let mut mapped = rest.get_mapped_range_mut(..);
            let (first, second) = (size_of_val(vertices), size_of_val(vertices) + size_of_val(tangents));
            mapped.slice(..first).copy_from_slice(bytemuck::cast_slice(vertices));
            mapped.slice(first..second).copy_from_slice(bytemuck::cast_slice(tangents));
            mapped.slice(second..).copy_from_slice(bytemuck::cast_slice(more));
        }
        rest.unmap();
        Ok(Self {
            rest,
            vertices: vertices.len() as u32,
            particles: binding.rest_particles().len() as u32,
            has_normals: binding.has_normals(),
            has_tangents: !tangents.is_empty(),
            more: if more.is_empty() { NONE } else { ((size_of_val(vertices) + size_of_val(tangents)) / 4) as u32 },
        })
    }

    /// Vertices of the mesh.
    pub fn vertex_count(&self) -> u32 {
        self.vertices
    }

    /// Particles of the body.
    pub fn particle_count(&self) -> u32 {
        self.particles
    }
}

pub(crate) fn check_binding_size(limits: &wgpu::Limits, needed: u64) -> Result<(), GpuError> {
    let checks = [("max_storage_buffer_binding_size", limits.max_storage_buffer_binding_size), ("max_buffer_size", limits.max_buffer_size)];
    for (limit, found) in checks {
        if needed > found {
            return Err(GpuError::Limit { limit, found, needed });
        }
    }
    Ok(())
}

/// The compute pipeline; one for a device.
#[derive(Debug)]
pub struct SkinPipeline {
    pub(crate) layout: wgpu::BindGroupLayout,
    pub(crate) pipeline: wgpu::ComputePipeline,
    pub(crate) limits: wgpu::Limits,
}

impl SkinPipeline {
    /// Whether a device with these limits can skin; the error names the first limit that is too low. Also ask whether its downlevel flags have compute shaders.
    pub fn check_limits(limits: &wgpu::Limits) -> Result<(), GpuError> {
        let needs = [
            ("max_storage_buffers_per_shader_stage", limits.max_storage_buffers_per_shader_stage, 4),
            ("max_compute_invocations_per_workgroup", limits.max_compute_invocations_per_workgroup, WORKGROUP_SIZE),
            ("max_compute_workgroup_size_x", limits.max_compute_workgroup_size_x, WORKGROUP_SIZE),
            ("max_compute_workgroups_per_dimension", limits.max_compute_workgroups_per_dimension, 1),
            ("max_dynamic_uniform_buffers_per_pipeline_layout", limits.max_dynamic_uniform_buffers_per_pipeline_layout, 1),
        ];
        for (limit, found, needed) in needs {
            if found < needed {
                return Err(GpuError::Limit { limit, found: found.into(), needed: needed.into() });
            }
        }
        Ok(())
    }

    /// Compiles the shader. The error names the limit that this device does not meet.
    pub fn new(device: &wgpu::Device) -> Result<Self, GpuError> {
        let limits = device.limits();
        Self::check_limits(&limits)?;
        let shader = device.create_shader_module(wgpu::include_wgsl!("skin.wgsl"));
        let storage = |binding, read_only| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::COMPUTE,
            ty: wgpu::BindingType::Buffer {
                ty: wgpu::BufferBindingType::Storage { read_only },
                has_dynamic_offset: false,
                min_binding_size: None,
            },
            count: None,
        };
        let batch = wgpu::BindGroupLayoutEntry {
            ty: wgpu::BindingType::Buffer {
                ty: wgpu::BufferBindingType::Uniform,
                has_dynamic_offset: true,
                min_binding_size: NonZeroU64::new(size_of::<GpuBatch>() as u64),
            },
            ..storage(0, true)
        };
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("polpo skin"),
            entries: &[batch, storage(1, true), storage(2, true), storage(3, true), storage(4, false)],
        });
        let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some("polpo skin"),
            layout: Some(&device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: Some("polpo skin"),
                bind_group_layouts: &[Some(&layout)],
                immediate_size: 0,
            })),
            module: &shader,
            entry_point: Some("skin"),
            compilation_options: Default::default(),
            cache: None,
        });
        Ok(Self { layout, pipeline, limits })
    }
}
