//! Settings of the association.

use std::sync::LazyLock;

use edgecap_client::message::MAX_PEOPLE;
use serde::{Deserialize, Serialize};

use super::{Confidence, PersonScore};

/// When a peak is a joint, when two joints make a limb, and when joints make a person.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AssociationConfig {
    /// Least heatmap value of a neck: every person grows from one.
    pub neck_threshold: f32,
    /// Least heatmap value of any other joint.
    pub joint_threshold: f32,
    /// Least mean, along a limb, of the part affinity field's component in the limb's direction.
    pub limb_threshold: f32,
    /// Least share of the samples along a limb that reach half of `limb_threshold`.
    pub pass_ratio: f32,
    /// Weight, beside a limb's score, of how far its length is from what the rest of the person suggests (logarithm of
    /// the ratio). Where two people stand in line the fields of both agree, and only the lengths say whose hip is
    /// whose.
    pub length_weight: f32,
    /// A limb this many times longer than the rest of the person allows is rejected.
    pub absurd_length: f32,
    /// Two people whose necks are closer than this fraction of their stature, and whose other joints agree, are one.
    pub merge_distance: f32,
    /// Least stature, network input pixels, that a person's limbs suggest.
    pub min_stature: f32,
    /// Fewest joints of a person.
    pub min_joints: usize,
    /// Least expected similarity, by `score`, with somebody who is there.
    pub min_score: f32,
    /// Least probability that somebody is there whom one of two looks at a picture reports, and the other does not.
    pub lone_score: f32,
    /// Most people returned, best first.
    #[serde(default = "most_people")]
    pub max_people: usize,
    /// Most peaks kept for each joint, highest first: bounds the work on pictures the network cannot read.
    pub max_peaks: usize,
    /// Tells people from what only looks like some.
    pub score: PersonScore,
    /// How likely what was found is right.
    pub confidence: Confidence,
}

fn most_people() -> usize {
    MAX_PEOPLE
}

impl Default for AssociationConfig {
    /// `models/association.toml`, fitted to the shipped weights.
    fn default() -> Self {
        static SHIPPED: LazyLock<AssociationConfig> = LazyLock::new(|| {
            toml::from_str(include_str!("../../models/association.toml"))
                .expect("models/association.toml is checked by a test")
        });
        SHIPPED.clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shipped_settings_are_read_whole() {
        let shipped = AssociationConfig::default();
        let again: AssociationConfig = toml::from_str(&toml::to_string(&shipped).unwrap()).unwrap();
        assert_eq!(shipped, again);
        assert_eq!(shipped.max_people, MAX_PEOPLE);
        assert!(shipped.min_score > 0.0 && shipped.min_score < 1.0);
    }
}
