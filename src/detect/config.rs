//! Settings of the association.

use edgecap_client::message::MAX_PEOPLE;
use serde::{Deserialize, Serialize};

/// When a peak is a joint, when two joints make a limb, and when joints make a person.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct AssociationConfig {
    /// Least heatmap value of a neck: every person grows from one, so this decides how easily a person is reported.
    pub neck_threshold: f32,
    /// Least heatmap value of any other joint.
    pub joint_threshold: f32,
    /// Least mean, along a limb, of the part affinity field's component in the limb's direction.
    pub limb_threshold: f32,
    /// Least share of the samples along a limb that reach half of `limb_threshold`.
    pub pass_ratio: f32,
    /// A limb this many times longer than the rest of the person allows is rejected.
    pub absurd_length: f32,
    /// Two people whose necks are closer than this fraction of their stature, and whose other joints agree, are one.
    pub merge_distance: f32,
    /// Least stature, network input pixels, that a person's limbs suggest.
    pub min_stature: f32,
    /// Fewest joints of a person.
    pub min_joints: usize,
    /// Least mean confidence of a person's joints.
    pub min_score: f32,
    /// Least sum of the confidences of a person's joints: many faint joints say as much as a few clear ones.
    pub min_evidence: f32,
    /// Least mean limb score of a person.
    pub min_limb_score: f32,
    /// Most people returned, best first.
    pub max_people: usize,
    /// Most peaks kept for each joint, highest first: bounds the work on pictures the network cannot read.
    pub max_peaks: usize,
}

impl Default for AssociationConfig {
    /// Tuned on real photos with the shipped weights (`examples/tune_association.rs`; run it again for other weights): necks
    /// must be clear, other joints may be faint, and together they must say enough. At the same number of empty pictures in
    /// which somebody is reported this finds more people, and more of their joints, than high thresholds for every joint or a
    /// limit on the mean confidence.
    fn default() -> Self {
        Self {
            neck_threshold: 0.5,
            joint_threshold: 0.15,
            limb_threshold: 0.2,
            pass_ratio: 0.6,
            absurd_length: 2.5,
            merge_distance: 0.08,
            min_stature: 24.0,
            min_joints: 6,
            min_score: 0.0,
            min_evidence: 7.0,
            min_limb_score: 0.0,
            max_people: MAX_PEOPLE,
            max_peaks: 64,
        }
    }
}
