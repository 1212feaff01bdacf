//! Everyone in a frame, as Stage II leaves them.

use edgecap_client::message::{Observation, StageTimes};

/// Everyone seen in a frame.
#[derive(Debug)]
pub struct FrameObservations<'a> {
    /// The people, by falling score.
    pub people: &'a [Observation],
    /// People left out because their neck was not found.
    pub without_neck: u32,
    /// Time spent per stage.
    pub times: StageTimes,
}
