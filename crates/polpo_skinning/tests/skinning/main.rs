//! The kernels on a small synthetic body: the CPU mirror against theory, the shader against the mirror.

mod body;
#[cfg(feature = "gpu")]
mod gpu_matches_cpu;
mod kernels;
