//! All that is known of cameras: lens, distortion, place in the world, calibration files, clock.
//!
//! Camera axes: x right, y down, z forward; metres; pixels with their centres on integers.

pub mod calibration;
mod clock;
mod distortion;
mod error;
mod file;
mod lifted;
pub mod translation;
mod view;

pub use clock::{Clock, RESTART_NS, Sleep, SystemClock, monotonic_ns};
pub use distortion::Brown;
pub use error::CameraError;
pub(crate) use error::is_nowhere;
pub use file::{CameraFile, DEFAULT_FOV};
pub use lifted::{anchor, to_lens, turn_to_ray};
pub use view::View;
