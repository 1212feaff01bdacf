//! The laboratory: instruments that make scenes with exact truth, measure results and time the program.
//!
//! What runs on a kiosk never reaches in here; `tests/architecture.rs` holds that wall.

pub mod bench;
pub mod eval;
pub mod humaneva;
pub mod multiview;
pub mod synth;
