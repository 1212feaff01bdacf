//! Winograd F(4×4, 3×3): 36 products per channel where the definition takes 144.
//!
//! Output is computed in tiles of 4 × 4 pixels from 6 × 6 input pixels d, on a grid that begins at output (0, 0):
//! `Y = Aᵀ (Σ channels (G w Gᵀ) · (Bᵀ d B)) A`, where `G w Gᵀ` is made when weights are packed. Input pixels outside
//! the tensor and its padding count as 0.

pub(crate) mod float;
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
pub(crate) mod generic;
pub(crate) mod int8;
mod sandwich;
mod walk;

pub(crate) use walk::walk;

/// Output rows and columns of a tile.
pub(crate) const OUT: usize = 4;
/// Input rows and columns of a tile.
pub(crate) const IN: usize = 6;
/// Products per channel.
pub(crate) const POINTS: usize = IN * IN;
