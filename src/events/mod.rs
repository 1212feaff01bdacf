//! What happens in front of a camera: bodies go in frame by frame, events come out once each.
//!
//! Nothing is reported of a single frame: a state must hold for a moment before it counts as changed, so that people at
//! a border do not flicker. All thresholds are in [`EventConfig`].

mod config;
mod detector;
mod hand;
mod line;
mod steady;

pub use config::{EventConfig, Zone};
pub use detector::Detector;
pub use line::Line;

#[cfg(test)]
mod tests;
