//! Winograd in f32.
//!
//! The polynomials are taken at 0, ±√½, ±√2 and ∞. No other pairs ±a, ±b lose clearly less (README): with 0, ±1, ±2, ∞,
//! as in integers, errors are two to four times as large. Sums are of f32, so that tiers differ as they do by the
//! definition.

pub(crate) mod reference;
mod weights;

pub(crate) use weights::{Points, transform_weights};

/// √½.
pub(crate) const INNER: f32 = std::f32::consts::FRAC_1_SQRT_2;
/// √2.
pub(crate) const OUTER: f32 = std::f32::consts::SQRT_2;
