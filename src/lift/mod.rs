//! Stage II: detections go in, observations (full 3D per person) come out. XNect §4.2.

mod error;
mod frame;
mod input;
mod lifter;
mod mlp;
mod torso_colours;
mod unseen;
mod view;
mod weights;

pub use error::LiftError;
pub use frame::FrameObservations;
pub use lifter::{Encodings, Lifter};
pub use weights::{INPUTS, JOINT_INPUTS, OUTPUTS};
