//! Deforms vertex buffers by particle transforms in one wgpu compute pass, with a CPU mirror of the shader.
//!
//! # The quantity
//!
//! A body has particles k with rest position p̄_k, current position p_k and rotation since rest R_k, and a mesh with rest vertices x̄.
//! Every vertex follows up to eight particles with weights w_k that sum to one (linear blend skinning):
//!
//! ```text
//! x = Σ_k w_k·(p_k + s·R_k·(x̄ − p̄_k)) = Σ_k w_k·M_k·(x̄, 1),    M_k = [ s·R_k | p_k − s·R_k·p̄_k ]
//! n = normalise(Σ_k w_k·R_k·n̄),  tangents likewise
//! ```
//!
//! with s the body's uniform scale. M_k is a 3×4 affine map, [`ParticleTransform`], formed once per particle and frame. Because the weights sum to one, blending the matrices
//! first and applying the blend once is the same sum, with fewer products; that is the order both kernels use.
//!
//! Degenerate cases. Where rotations half a turn apart cancel, Σ w_k R_k n̄ has no direction: the normal stays the rest normal. A zero rest normal stays zero. Linear blending loses
//! volume where neighbours twist against each other, by cos(θ/2) between two particles θ apart: 0.92 at 45°, 0.71 at 90°.
//!
//! Rest positions are stored relative to a point in the middle of the body, so that p_k − s·R_k·p̄_k does not cancel digits for a mesh modelled far from its origin.
//!
//! # The pieces, in the order data takes
//!
//! | file | what |
//! |---|---|
//! | [`binding`] | what never changes: rest vertices, particles, weights, checked and packed; built once per mesh and rig |
//! | [`influences`] | up to four particles a vertex, or up to eight |
//! | [`transform`] | what changes every frame: one affine map per particle |
//! | [`gpu`] | the pipeline and the packed bindings on the GPU: `skin.wgsl` writes into interleaved vertex buffers of any layout |
//! | [`frame`] | the bodies of a frame: pooled buffers and dispatches |
//! | [`cpu`] | the mirror of the shader: same packed data, same order of operations |
//! | [`bounds`] | a conservative box around the skinned mesh, for culling, from the transforms alone |
//! | [`headless`] | a device without a window, for tests and tools |
//!
//! Agreement of the two kernels: within 1e-5 of the body's size (GPUs may fuse multiply and add; nothing else differs).

pub mod binding;
pub mod bounds;
pub mod cpu;
#[cfg(feature = "gpu")]
pub mod frame;
#[cfg(feature = "gpu")]
pub mod gpu;
#[cfg(feature = "gpu")]
pub mod headless;
pub mod influences;
pub mod transform;

pub use binding::{Binding, BindingError, RestMesh, RestVertex};
pub use bounds::Aabb;
#[cfg(feature = "gpu")]
pub use frame::SkinFrame;
#[cfg(feature = "gpu")]
pub use gpu::{GpuBinding, GpuError, SkinPipeline, Target, VertexLayout};
pub use influences::{FourInfluences, MOST_INFLUENCES};
pub use transform::ParticleTransform;
