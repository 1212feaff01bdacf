//! What one joint of a person is known by.

use crate::message::JointState;

/// What the confidence of a joint rests on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KnownJoint {
    /// How it was seen when its person was seen last.
    pub state: JointState,
    /// Probability that what was seen of it was right, 0–1 ([`Observation`](crate::message::Observation)).
    pub seen_right: f64,
    /// Recent distance between fit and Stage II, metres.
    pub deviation: f64,
    /// Seconds since its person was seen.
    pub unseen: f64,
}
