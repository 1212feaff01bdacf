//! Several calibrated views of one person go in; how well one view alone knows what the others see comes out.
//!
//! The views but one are triangulated and reprojected into the one left out, which yields a truth that this view had no
//! part in.

mod check;
mod triangulate;

pub use check::{MultiviewCheck, MultiviewReport};
