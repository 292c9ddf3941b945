//! The bodies of one frame: pooled transforms, jobs, and the dispatches they are cut into.
//!
//! A frame goes: [`SkinFrame::clear`], then for each body [`SkinFrame::add_transforms`] and [`SkinFrame::add_body`], then [`SkinFrame::upload`], then [`SkinFrame::dispatch`] inside a
//! compute pass of the caller's. Bodies that share a binding and a target buffer go in one dispatch, whatever their number: a game's many copies of a few creatures cost a few
//! dispatches, and no barrier stands between the copies.
//!
//! After the first frames at a given load no memory is allocated here: vectors and buffers are kept and grow in powers of two; bind groups are kept while they are used.

use std::collections::BTreeMap;
use std::ops::Range;

use bytemuck::{Pod, Zeroable};

use crate::gpu::{NONE, WORKGROUP_SIZE, check_binding_size};
use crate::{GpuBinding, GpuError, ParticleTransform, SkinPipeline, Target, VertexLayout};

/// `Batch` of the shader.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct GpuBatch {
    first_job: u32,
    job_count: u32,
    groups_per_job: u32,
    vertex_count: u32,
    more: u32,
    // A uniform is made of sixteen bytes at a time.
    padding: [u32; 3],
}

/// `Job` of the shader.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
struct GpuJob {
    first_word: u32,
    stride: u32,
    position: u32,
    normal: u32,
    tangent: u32,
    first_transform: u32,
}

/// One body of the frame, before windows are cut.
#[derive(Debug)]
struct Body {
    rest: wgpu::Buffer,
    target: wgpu::Buffer,
    /// Words of the target that the body's vertices take.
    words: Range<u64>,
    vertices: u32,
    more: u32,
    layout: VertexLayout,
    first_transform: u32,
}

/// The bodies of one dispatch, and the bytes of the target they share.
#[derive(Debug)]
struct Window {
    bodies: Range<usize>,
    bytes: Range<u64>,
}

/// What a bind group depends on besides the frame's own buffers: the binding, the target, and the bytes of it that are bound.
type GroupKey = (wgpu::Buffer, wgpu::Buffer, u64, u64);

#[derive(Debug)]
struct Group {
    bind_group: wgpu::BindGroup,
    used: bool,
}

#[derive(Debug)]
struct Dispatch {
    bind_group: wgpu::BindGroup,
    batch_offset: u32,
    groups: [u32; 2],
}

/// A buffer that grows in powers of two and is otherwise reused.
#[derive(Debug, Default)]
struct Pool {
    buffer: Option<wgpu::Buffer>,
}

impl Pool {
    /// Writes `bytes`; true if the buffer is a new one. Empty `bytes` write nothing.
    fn write(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        label: &str,
        usage: wgpu::BufferUsages,
        bytes: &[u8],
    ) -> Result<bool, GpuError> {
        let needed = bytes.len() as u64;
        let grows = self.buffer.as_ref().is_none_or(|buffer| buffer.size() < needed);
        if grows {
            let limits = device.limits();
            check_binding_size(&limits, needed)?;
            let most = limits.max_buffer_size.min(limits.max_storage_buffer_binding_size);
            self.buffer = Some(device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size: needed.next_power_of_two().clamp(256, most.max(needed)),
                usage: usage | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            }));
        }
        if let Some(buffer) = &self.buffer {
            queue.write_buffer(buffer, 0, bytes);
        }
        Ok(grows)
    }
}

/// The bodies of a frame and the buffers that carry them to the GPU. Keep one and reuse it.
#[derive(Debug, Default)]
pub struct SkinFrame {
    transforms: Vec<ParticleTransform>,
    bodies: Vec<Body>,
    windows: Vec<Window>,
    jobs: Vec<GpuJob>,
    batches: Vec<u8>,
    dispatches: Vec<Dispatch>,
    transform_pool: Pool,
    job_pool: Pool,
    batch_pool: Pool,
    groups: BTreeMap<GroupKey, Group>,
}

impl SkinFrame {
    /// Forgets the bodies of the last frame; buffers stay.
    pub fn clear(&mut self) {
        self.transforms.clear();
        self.bodies.clear();
        self.dispatches.clear();
    }

    /// Appends a body's particle transforms to the frame's pool and says where they lie, for [`Self::add_body`].
    pub fn add_transforms(&mut self, transforms: &[ParticleTransform]) -> Range<u32> {
        let first = self.transforms.len();
        self.transforms.extend_from_slice(transforms);
        // Indices beyond u32 cannot be bound either: 4 billion transforms are far over any binding limit, and `upload` then fails on the pool's size.
        first as u32..self.transforms.len() as u32
    }

    /// How many bodies were added since [`Self::clear`].
    pub fn body_count(&self) -> usize {
        self.bodies.len()
    }

    /// Adds a body: its vertices in `target` will follow `transforms` (from [`Self::add_transforms`]). Attributes that the binding has no rest data for are left alone.
    ///
    /// On an error the body is left out and the others are not touched. Overlapping targets are not looked for: their vertices would be written in no particular order.
    pub fn add_body(&mut self, binding: &GpuBinding, target: Target<'_>, transforms: Range<u32>) -> Result<(), GpuError> {
        if transforms.len() as u32 != binding.particles || transforms.end as usize > self.transforms.len() {
            return Err(GpuError::Transforms { found: transforms.len() as u32, particles: binding.particles });
        }
        let layout = VertexLayout {
            normal: target.layout.normal.filter(|_| binding.has_normals),
            tangent: target.layout.tangent.filter(|_| binding.has_tangents),
            ..target.layout
        };
        let attributes = [Some(layout.position), layout.normal, layout.tangent];
        for offset in attributes.into_iter().flatten() {
            if u64::from(offset) + 3 > u64::from(layout.stride) {
                return Err(GpuError::Layout { offset, stride: layout.stride });
            }
        }
        // first_word comes from the caller and may be anything.
        let length = u64::from(binding.vertices) * u64::from(layout.stride);
        let end = target.first_word.checked_add(length);
        let Some(end) = end.filter(|&end| end <= target.buffer.size() / 4) else {
            return Err(GpuError::TargetRange {
                first_word: target.first_word,
                stride: layout.stride,
                vertices: binding.vertices,
                bytes: target.buffer.size(),
            });
        };
        self.bodies.push(Body {
            rest: binding.rest.clone(),
            target: target.buffer.clone(),
            words: target.first_word..end,
            vertices: binding.vertices,
            more: binding.more,
            layout,
            first_transform: transforms.start,
        });
        Ok(())
    }

    /// Sends the frame's transforms to the GPU and cuts the bodies into dispatches. On an error nothing will be dispatched.
    pub fn upload(&mut self, device: &wgpu::Device, queue: &wgpu::Queue, pipeline: &SkinPipeline) -> Result<(), GpuError> {
        self.dispatches.clear();
        for group in self.groups.values_mut() {
            group.used = false;
        }
        if !self.bodies.is_empty() {
            self.bodies.sort_unstable_by(|a, b| (&a.rest, &a.target, a.words.start).cmp(&(&b.rest, &b.target, b.words.start)));
            let result = self.upload_bodies(device, queue, pipeline);
            if result.is_err() {
                self.dispatches.clear();
            }
            result?;
        }
        // Groups hold on to vertex buffers and bindings, so those of despawned bodies go at once.
        self.groups.retain(|_, group| group.used);
        Ok(())
    }

    fn upload_bodies(&mut self, device: &wgpu::Device, queue: &wgpu::Queue, pipeline: &SkinPipeline) -> Result<(), GpuError> {
        cut_windows(&self.bodies, &pipeline.limits, &mut self.windows)?;
        let align = pipeline.limits.min_uniform_buffer_offset_alignment.max(size_of::<GpuBatch>() as u32) as usize;
        self.pack(align);

        let storage = wgpu::BufferUsages::STORAGE;
        let uploads: [(&mut Pool, &str, _, &[u8]); 3] = [
            (&mut self.transform_pool, "polpo particle transforms", storage, bytemuck::cast_slice(&self.transforms)),
            (&mut self.job_pool, "polpo skin jobs", storage, bytemuck::cast_slice(&self.jobs)),
            (&mut self.batch_pool, "polpo skin batches", wgpu::BufferUsages::UNIFORM, &self.batches),
        ];
        for (pool, label, usage, bytes) in uploads {
            if pool.write(device, queue, label, usage, bytes)? {
                self.groups.clear();
            }
        }

        for (index, window) in self.windows.iter().enumerate() {
            let bodies = &self.bodies[window.bodies.clone()];
            let body = &bodies[0];
            let groups = u64::from(body.vertices.div_ceil(WORKGROUP_SIZE)) * bodies.len() as u64;
            let row = u64::from(pipeline.limits.max_compute_workgroups_per_dimension);
            if groups > row * row || groups > u64::from(u32::MAX) {
                return Err(GpuError::Limit { limit: "max_compute_workgroups_per_dimension, squared", found: row * row, needed: groups });
            }
            let bytes = window.bytes.clone();
            let size = bytes.end - bytes.start;
            let key = (body.rest.clone(), body.target.clone(), bytes.start, size);
            let (Some(batch), Some(jobs), Some(transforms)) = (&self.batch_pool.buffer, &self.job_pool.buffer, &self.transform_pool.buffer)
            else {
                // Not reached: writing a body's bytes made all three.
                return Ok(());
            };
            let group = self.groups.entry(key).or_insert_with(|| Group {
                bind_group: device.create_bind_group(&wgpu::BindGroupDescriptor {
                    label: Some("polpo skin"),
                    layout: &pipeline.layout,
                    entries: &[
                        entry(0, batch, 0, size_of::<GpuBatch>() as u64),
                        entry(1, &body.rest, 0, body.rest.size()),
                        entry(2, jobs, 0, jobs.size()),
                        entry(3, transforms, 0, transforms.size()),
                        entry(4, &body.target, bytes.start, size),
                    ],
                }),
                used: true,
            });
            group.used = true;
            self.dispatches.push(Dispatch {
                bind_group: group.bind_group.clone(),
                batch_offset: (index * align) as u32,
                groups: [groups.min(row) as u32, groups.div_ceil(row) as u32],
            });
        }
        Ok(())
    }

    /// Jobs and batches in the shader's layout; a batch every `align` bytes.
    fn pack(&mut self, align: usize) {
        self.jobs.clear();
        self.batches.clear();
        self.batches.resize(self.windows.len() * align, 0);
        for (window, bytes) in self.windows.iter().zip(self.batches.chunks_exact_mut(align)) {
            let bodies = &self.bodies[window.bodies.clone()];
            let batch = GpuBatch {
                first_job: self.jobs.len() as u32,
                job_count: bodies.len() as u32,
                groups_per_job: bodies[0].vertices.div_ceil(WORKGROUP_SIZE),
                vertex_count: bodies[0].vertices,
                more: bodies[0].more,
                padding: [0; 3],
            };
            bytes[..size_of::<GpuBatch>()].copy_from_slice(bytemuck::bytes_of(&batch));
            self.jobs.extend(bodies.iter().map(|body| GpuJob {
                first_word: (body.words.start - window.bytes.start / 4) as u32,
                stride: body.layout.stride,
                position: body.layout.position,
                normal: body.layout.normal.unwrap_or(NONE),
                tangent: body.layout.tangent.unwrap_or(NONE),
                first_transform: body.first_transform,
            }));
        }
    }

    /// Records the dispatches of the last [`Self::upload`]. Vertex buffers drawn later in the same submission, or in a later one, show the skinned mesh.
    pub fn dispatch(&self, pipeline: &SkinPipeline, pass: &mut wgpu::ComputePass<'_>) {
        if self.dispatches.is_empty() {
            return;
        }
        pass.set_pipeline(&pipeline.pipeline);
        for dispatch in &self.dispatches {
            pass.set_bind_group(0, &dispatch.bind_group, &[dispatch.batch_offset]);
            pass.dispatch_workgroups(dispatch.groups[0], dispatch.groups[1], 1);
        }
    }

    /// How many dispatches the last [`Self::upload`] made.
    pub fn dispatch_count(&self) -> usize {
        self.dispatches.len()
    }
}

fn entry(binding: u32, buffer: &wgpu::Buffer, offset: u64, size: u64) -> wgpu::BindGroupEntry<'_> {
    wgpu::BindGroupEntry {
        binding,
        resource: wgpu::BindingResource::Buffer(wgpu::BufferBinding { buffer, offset, size: std::num::NonZeroU64::new(size) }),
    }
}

/// Cuts the sorted bodies into runs that share binding and target, and each run into windows that can be bound.
fn cut_windows(bodies: &[Body], limits: &wgpu::Limits, windows: &mut Vec<Window>) -> Result<(), GpuError> {
    let most = limits.max_storage_buffer_binding_size & !3;
    let align = u64::from(limits.min_storage_buffer_offset_alignment).max(4);
    windows.clear();
    for (index, body) in bodies.iter().enumerate() {
        if let Some(window) = windows.last_mut() {
            let first = &bodies[window.bodies.start];
            let same = first.rest == body.rest && first.target == body.target;
            let end = window.bytes.end.max(body.words.end * 4);
            if same && end - window.bytes.start <= most {
                window.bodies.end = index + 1;
                window.bytes.end = end;
                continue;
            }
        }
        // A target that can be bound whole is, so that its bind group outlives bodies that come and go.
        let whole = body.target.size() & !3;
        let bytes = if whole <= most { 0..whole } else { body.words.start * 4 / align * align..body.words.end * 4 };
        if bytes.end - bytes.start > most {
            return Err(GpuError::Limit { limit: "max_storage_buffer_binding_size", found: most, needed: bytes.end - bytes.start });
        }
        windows.push(Window { bodies: index..index + 1, bytes });
    }
    Ok(())
}
