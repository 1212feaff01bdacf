//! Stage I: an RGB picture of the network's input size goes in, [`Maps`] come out.
//!
//! [`network`] (data) + weights ([`model`]) → `plan` (where every value lies) → `run` (threads over packed kernels).

mod calibrate;
mod flip;
mod maps;
pub mod model;
pub mod network;
mod plan;
mod run;

pub use calibrate::{CalibrationOptions, Trial, WILD};
pub use edgecap_kernels::{Algorithms, Isa};
pub use flip::FlipTest;
pub use maps::{HEAD2D_CHANNELS, HEAD3D_CHANNELS, Maps};
pub use model::{Model, ModelError};
pub use network::{Network, NetworkError};
pub use plan::PlanError;
pub(crate) use run::trim_memory;
pub use run::{Engine, EngineError, EngineOptions, LayerProfile, Precision};
