//! Stage I: an RGB picture of the network's input size goes in, [`Maps`] come out.

mod maps;
pub mod network;

pub use maps::{HEAD2D_CHANNELS, HEAD3D_CHANNELS, Maps};
