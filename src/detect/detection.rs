//! A person found in the maps.

use crate::engine::HEAD3D_CHANNELS;
use edgecap_client::joints::{EVIDENCE_JOINTS, LIMBS};

/// One person in the network's input, before lifting.
#[derive(Debug, Clone, PartialEq)]
pub struct Detection {
    /// u, v in network input pixels, height of the heatmap's peak 0–1 (0: not seen, u = v = 0).
    pub joints: [[f32; 3]; EVIDENCE_JOINTS],
    /// Probability of every joint to be within 0.2 of the torso's length of the truth; 0 where it was not seen.
    pub confidence: [f32; EVIDENCE_JOINTS],
    /// The 3D head's 63-vector at each seen joint's cell, zero elsewhere.
    pub encodings: [[f32; HEAD3D_CHANNELS]; EVIDENCE_JOINTS],
    /// Every limb's score: mean of the part affinity field along it, 0 where the limb was not found.
    pub limbs: [f32; LIMBS],
    /// Probability that somebody is there: with an object keypoint similarity of 0.5 at least.
    pub score: f32,
}
