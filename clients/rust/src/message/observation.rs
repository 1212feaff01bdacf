//! What `infer` publishes to `fit`.

use iceoryx2::prelude::ZeroCopySend;
use zerocopy::{FromBytes, Immutable, IntoBytes};

use super::{APPEARANCE_BINS, Intrinsics, MAX_PEOPLE, StageTimes};
use crate::joints::{BODY_JOINTS, EVIDENCE_JOINTS};

/// One person as seen in one frame: Stage II's output.
#[derive(Debug, Clone, Copy, PartialEq, ZeroCopySend, FromBytes, IntoBytes, Immutable)]
#[type_name("EdgecapObservationV1")]
#[repr(C)]
pub struct Observation {
    /// Probability that somebody is there: joints with an object keypoint similarity of 0.5 at least.
    pub score: f32,
    /// Evidence joints: u, v in pixels of the original picture, confidence: the probability that the joint is within
    /// 0.2 of the torso's length of the truth. 0: not seen; u and v are where Stage II's body has the joint once it is
    /// placed over the seen ones, or 0, 0 where that is not known.
    pub joints2d: [[f32; 3]; EVIDENCE_JOINTS],
    /// Body joints relative to the pelvis, camera axes, metres, of the person rescaled to
    /// [`CANONICAL_STATURE`](crate::joints::CANONICAL_STATURE). Complete: unseen joints are filled in by Stage II.
    pub joints3d: [[f32; 3]; BODY_JOINTS],
    /// Hue histogram of the torso, sums to 1; all zero when the torso was not seen.
    pub hue: [f32; APPEARANCE_BINS],
    /// Saturation histogram of the torso, sums to 1; all zero when the torso was not seen.
    pub saturation: [f32; APPEARANCE_BINS],
}

impl Default for Observation {
    fn default() -> Self {
        Self {
            score: 0.0,
            joints2d: [[0.0; 3]; EVIDENCE_JOINTS],
            joints3d: [[0.0; 3]; BODY_JOINTS],
            hue: [0.0; APPEARANCE_BINS],
            saturation: [0.0; APPEARANCE_BINS],
        }
    }
}

/// Everyone seen in one frame: `infer` → `fit`.
#[derive(Debug, Clone, Copy, PartialEq, ZeroCopySend, FromBytes, IntoBytes, Immutable)]
#[type_name("EdgecapObservationFrameV1")]
#[repr(C)]
pub struct ObservationFrame {
    /// Counts the frames of this input from 0; gaps are dropped frames.
    pub sequence: u64,
    /// When the picture was taken.
    pub capture_ns: u64,
    /// When this message was published.
    pub publish_ns: u64,
    /// Width of the original picture, pixels.
    pub width: u32,
    /// Height of the original picture, pixels.
    pub height: u32,
    /// Camera of the original picture.
    pub intrinsics: Intrinsics,
    /// Time spent per stage.
    pub stage_times: StageTimes,
    /// `FLAG_*` bits.
    pub flags: u32,
    /// People left out because their neck was not found: whole arms or legs that belong to nobody.
    pub without_neck: u32,
    /// Valid entries of `people`.
    pub count: u32,
    /// Frames in the input; 0 when not known (cameras, pipes).
    pub frame_total: u32,
    /// The people, by falling score.
    pub people: [Observation; MAX_PEOPLE],
}

impl Default for ObservationFrame {
    fn default() -> Self {
        Self {
            sequence: 0,
            capture_ns: 0,
            publish_ns: 0,
            width: 0,
            height: 0,
            intrinsics: Intrinsics::default(),
            stage_times: StageTimes::default(),
            flags: 0,
            without_neck: 0,
            count: 0,
            frame_total: 0,
            people: [Observation::default(); MAX_PEOPLE],
        }
    }
}

impl ObservationFrame {
    /// The valid people.
    pub fn people(&self) -> &[Observation] {
        &self.people[..(self.count as usize).min(MAX_PEOPLE)]
    }
}
