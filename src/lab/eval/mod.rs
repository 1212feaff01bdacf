//! Measures: predictions and ground truth go in, numbers come out.
//!
//! Everything here works on files that `infer` and `run` write, so that any run can be measured after the fact, on any
//! machine.

mod bias;
mod error;
mod geometry;
mod identity;
mod jitter;
mod keypoints;
mod matching;
pub mod multiview;
mod mupots;
mod names;
mod noise;
mod oks;
mod pairing;
mod pck;
mod pckh;
mod pose3d;
mod predictions;
mod quiet;
mod recall;
mod report;
mod table;
mod truth;

pub use error::EvalError;
pub use identity::{Identity, IdentityScore};
pub use jitter::Jitter;
pub use keypoints::{JointSet, Keypoint, bounding_box};
pub use matching::{Finding, find_people};
pub use mupots::{Mupots, MupotsPerson, MupotsScore, Protocol};
pub use noise::{Noise, NoiseMeter, Spread};
pub use oks::{AveragePrecision, ImageOks, average_precision, oks};
pub use pck::{Pck, TORSO};
pub use pckh::{HeadSize, Pckh, PckhScore};
pub use pose3d::{Pose3d, PoseErrors, align_similarity};
pub use predictions::{Person, PredictedFrame, Predictions};
pub use quiet::{Quiet, quiet};
pub use recall::RecallRow;
pub use report::{EvalOptions, Report, evaluate};
pub use truth::{Format, JointOrder, ReadOptions, TruthFrame, TruthPerson, TruthSet, Units};
