//! Running a planned network: the arena of its buffers, the steps over it, the threads that share them.

#[allow(
    unsafe_code,
    reason = "threads share one piece of memory by the plan's proof"
)]
mod arena;
mod build;
#[allow(
    unsafe_code,
    reason = "lends its own arena and maps to the threads of a frame"
)]
mod engine;
mod error;
#[allow(unsafe_code, reason = "writes the picture into the arena")]
mod picture;
#[allow(unsafe_code, reason = "runs kernels on disjoint parts of the arena")]
mod step;
#[allow(unsafe_code, reason = "its threads share a frame's memory")]
mod team;
#[allow(unsafe_code, reason = "a call of the C library")]
mod trim;

pub use engine::{Engine, EngineOptions, LayerProfile, Precision};
pub use error::EngineError;
pub(crate) use trim::trim_memory;
