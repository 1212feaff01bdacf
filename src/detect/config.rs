//! Settings of the association.

use std::sync::LazyLock;

use edgecap_client::joints::EVIDENCE_JOINTS;
use edgecap_client::message::MAX_PEOPLE;
use serde::de::Error as _;
use serde::{Deserialize, Serialize};

use super::{Confidence, PersonScore};
use crate::engine::Model;

/// Most peaks of a joint that settings may ask for: every pair of two joints' peaks is looked at.
const MOST_PEAKS: usize = 256;

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

impl AssociationConfig {
    /// Reads settings in the form of `models/association.toml`.
    ///
    /// # Errors
    /// Keys that are unknown or missing, numbers that are not finite in 32 bits, counts that nothing here can hold,
    /// thresholds and scores outside 0 to 1, lengths and distances below 0.
    pub fn parse(text: &str) -> Result<Self, toml::de::Error> {
        let refused = |what: String| Err(toml::de::Error::custom(what));
        if let Some(key) = not_finite(&text.parse::<toml::Table>()?) {
            return refused(format!("expected a finite number of 32 bits for '{key}'"));
        }
        let read: Self = toml::from_str(text)?;
        for (key, found, most) in [
            ("max_peaks", read.max_peaks, MOST_PEAKS),
            ("max_people", read.max_people, MAX_PEOPLE),
            ("min_joints", read.min_joints, EVIDENCE_JOINTS),
        ] {
            if !(1..=most).contains(&found) {
                return refused(format!("expected '{key}' of 1 to {most}, found {found}"));
            }
        }
        for (key, found) in [
            ("neck_threshold", read.neck_threshold),
            ("joint_threshold", read.joint_threshold),
            ("limb_threshold", read.limb_threshold),
            ("pass_ratio", read.pass_ratio),
            ("min_score", read.min_score),
            ("lone_score", read.lone_score),
        ] {
            if !(0.0..=1.0).contains(&found) {
                return refused(format!("expected '{key}' of 0 to 1, found {found}"));
            }
        }
        for (key, found) in [
            ("length_weight", read.length_weight),
            ("absurd_length", read.absurd_length),
            ("merge_distance", read.merge_distance),
            ("min_stature", read.min_stature),
        ] {
            if found < 0.0 {
                return refused(format!("expected '{key}' of 0 or more, found {found}"));
            }
        }
        Ok(read)
    }

    /// The settings fitted to a model: its own, or those of the shipped weights where it has none.
    ///
    /// # Errors
    /// As [`parse`](Self::parse), of the model's own.
    pub fn of(model: &Model) -> Result<Self, toml::de::Error> {
        model
            .association()
            .map_or_else(|| Ok(Self::default()), Self::parse)
    }
}

/// The first key whose number, or one of whose numbers, is infinite or none as the f32 that it becomes.
fn not_finite(table: &toml::Table) -> Option<&str> {
    fn is_finite(value: &toml::Value) -> bool {
        match value {
            toml::Value::Float(x) => (*x as f32).is_finite(),
            toml::Value::Array(all) => all.iter().all(is_finite),
            toml::Value::Table(inner) => not_finite(inner).is_none(),
            _ => true,
        }
    }
    let mut keys = table.iter().filter(|(_, value)| !is_finite(value));
    keys.next().map(|(key, value)| match value {
        toml::Value::Table(inner) => not_finite(inner).unwrap_or(key),
        _ => key,
    })
}

impl Default for AssociationConfig {
    /// `models/association.toml`, fitted to the shipped weights.
    fn default() -> Self {
        static SHIPPED: LazyLock<AssociationConfig> = LazyLock::new(|| {
            AssociationConfig::parse(include_str!("../../models/association.toml"))
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

    #[test]
    fn settings_that_nothing_can_hold_are_refused_by_their_key() {
        let shipped = toml::to_string(&AssociationConfig::default()).unwrap();
        let with = |from: &str, to: &str| {
            assert!(shipped.contains(from), "{from}");
            AssociationConfig::parse(&shipped.replacen(from, to, 1))
                .unwrap_err()
                .message()
                .to_owned()
        };
        assert!(with("max_peaks = 64", "max_peaks = 100000").contains("'max_peaks' of 1 to 256"));
        assert!(with("max_peaks = 64", "max_peaks = 0").contains("found 0"));
        assert!(with("min_joints = 4", "min_joints = 15").contains("'min_joints' of 1 to 14"));
        assert!(with("pass_ratio = ", "pass_ratio = nan #").contains("'pass_ratio'"));
        for (key, least) in [
            ("neck_threshold", "neck_threshold = -0.1 #"),
            ("joint_threshold", "joint_threshold = -0.01 #"),
            ("limb_threshold", "limb_threshold = 1.5 #"),
            ("pass_ratio", "pass_ratio = 1.01 #"),
            ("min_score", "min_score = 7.0 #"),
            ("lone_score", "lone_score = 3.0 #"),
        ] {
            let said = with(&format!("{key} = "), least);
            assert!(said.contains(&format!("'{key}' of 0 to 1")), "{said}");
        }
        for (key, below) in [
            ("length_weight", "length_weight = -0.2 #"),
            ("absurd_length", "absurd_length = -2.5 #"),
            ("min_stature", "min_stature = -5.0 #"),
        ] {
            let said = with(&format!("{key} = "), below);
            assert!(said.contains(&format!("'{key}' of 0 or more")), "{said}");
        }
        // Numbers that f64 holds, and f32 does not.
        assert!(with("merge_distance = ", "merge_distance = 1e39 #").contains("'merge_distance'"));
        assert!(with("clearest = ", "clearest = -1e300 #").contains("'clearest'"));
        assert!(with("found = ", "found = inf #").contains("'found'"));
        assert!(with("joint_squared = [", "joint_squared = [nan, ").contains("'joint_squared'"));
        assert!(with("bias = ", "biass = ").contains("biass"));
    }
}
