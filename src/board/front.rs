//! How corners are looked for in any picture.

use calib_targets_core::{DetectorConfig, ImageRefiner, default_chess_config};

/// Corners where a surface through the pixels has its saddle: on photos of real boards these are about half as far off
/// as the middle of the detector's response.
pub fn front() -> DetectorConfig {
    default_chess_config().with_refiner(ImageRefiner::saddle_point())
}
