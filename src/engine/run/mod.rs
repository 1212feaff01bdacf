//! Running a planned network: the arena of its buffers, the steps over it, the threads that share them.

mod arena;
mod build;
mod engine;
mod error;
mod picture;
mod pin;
mod step;
mod team;

pub use engine::{Engine, EngineOptions, LayerProfile, Precision};
pub use error::EngineError;
