//! Winograd in integers:
//! - `V = Bᵀ d B`, exact in i16 (|V| ≤ 100 · 255 = 25500);
//! - `U = round(t · G w Gᵀ)` in i16, made when weights are packed, with one whole number t per output channel, as large
//!   as i16 and the final sum allow;
//! - `M = Σ channels U · V` and `Y = Aᵀ M A` in i32, modulo 2³²: only Y must fit, and t is chosen so that it does;
//! - `Y ≈ t · acc`, so that the epilogue's scale is divided by t, and the bias multiplied by it.
//!
//! All steps are integers: every tier gives the same bits.

pub(crate) mod reference;
mod weights;

pub(crate) use weights::TransformedWeights;

/// The product that reaches every output with factor 1: the bias is added there.
pub(crate) const BIAS_POINT: usize = super::IN + 1;
