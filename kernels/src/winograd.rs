//! Winograd F(4×4, 3×3) in integers: 36 products per channel where the definition takes 144.
//!
//! Output is computed in tiles of 4 × 4 pixels from 6 × 6 input pixels d, on a grid that begins at output (0, 0):
//! - `V = Bᵀ d B`, exact in i16 (|V| ≤ 100 · 255 = 25500);
//! - `U = round(t · G w Gᵀ)` in i16, made when weights are packed, with one whole number t per output channel, as large
//!   as i16 and the final sum allow;
//! - `M = Σ channels U · V` and `Y = Aᵀ M A` in i32, modulo 2³²: only Y must fit, and t is chosen so that it does;
//! - `Y ≈ t · acc`, so that the epilogue's scale is divided by t, and the bias multiplied by it.
//!
//! Input pixels outside the tensor and its padding count as 0. All steps are integers: every tier gives the same bits.

#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
pub(crate) mod generic;
pub(crate) mod reference;
mod weights;

pub(crate) use weights::TransformedWeights;

/// Output rows and columns of a tile.
pub(crate) const OUT: usize = 4;
/// Input rows and columns of a tile.
pub(crate) const IN: usize = 6;
/// Products per channel.
pub(crate) const POINTS: usize = IN * IN;
/// The product that reaches every output with factor 1: the bias is added there.
pub(crate) const BIAS_POINT: usize = IN + 1;
