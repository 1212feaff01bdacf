//! How high a peak is and how well a person scores go in, how likely they are right comes out.

use edgecap_client::joints::EVIDENCE_JOINTS;
use serde::{Deserialize, Serialize};

/// Values nearer to 0 and 1 than this are taken for this.
const LEAST: f32 = 0.01;
/// Size at which only `joint_bias` and `joint_slope` count, network input pixels.
const SIZE: f32 = 200.0;
/// Smallest size that makes a difference, network input pixels.
const SMALLEST: f32 = 20.0;

/// Probabilities of being right: logistic regression on the logits of what was measured, fitted to photos in which
/// everybody is labelled (`models/train/confidence.py`).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Confidence {
    /// Logit of a joint whose peak is 0.5 high, in a person of 200 px.
    pub joint_bias: f32,
    /// Weight of the logit of a peak's height.
    pub joint_slope: f32,
    /// Weight of the logarithm of the person's size over 200 px: the same peak is nearer to a large person's joint.
    pub joint_size: f32,
    /// Logit of a person whose expected similarity is 0.5.
    pub person_bias: f32,
    /// Weight of the logit of the expected similarity.
    pub person_slope: f32,
}

impl Confidence {
    /// Probability, for each joint, of being within 0.2 of the torso's length of the truth; 0 where it was not seen.
    /// `joints` are u, v in network input pixels and the peak's height.
    pub fn joints(&self, joints: &[[f32; 3]; EVIDENCE_JOINTS]) -> [f32; EVIDENCE_JOINTS] {
        let size = self.joint_size * (size(joints).max(SMALLEST) / SIZE).ln();
        joints.map(|[_, _, height]| {
            if height > 0.0 {
                logistic(self.joint_bias + size + self.joint_slope * logit(height))
            } else {
                0.0
            }
        })
    }

    /// Probability that somebody is where a person of this expected similarity ([`PersonScore`](super::PersonScore))
    /// is: with an object keypoint similarity of 0.5 at least.
    pub fn person(&self, expected: f32) -> f32 {
        logistic(self.person_bias + self.person_slope * logit(expected))
    }
}

/// Diagonal of the box around the seen joints, in their unit.
pub(super) fn size(joints: &[[f32; 3]; EVIDENCE_JOINTS]) -> f32 {
    let (mut low, mut high) = ([f32::INFINITY; 2], [f32::NEG_INFINITY; 2]);
    for [u, v, height] in joints {
        if *height > 0.0 {
            low = [low[0].min(*u), low[1].min(*v)];
            high = [high[0].max(*u), high[1].max(*v)];
        }
    }
    (high[0] - low[0])
        .max(0.0)
        .hypot((high[1] - low[1]).max(0.0))
}

fn logit(p: f32) -> f32 {
    let p = p.clamp(LEAST, 1.0 - LEAST);
    (p / (1.0 - p)).ln()
}

fn logistic(x: f32) -> f32 {
    1.0 / (1.0 + (-x).exp())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::detect::AssociationConfig;

    /// A person whose seen joints lie in a box of `size` pixels across.
    fn person(size: f32, height: f32) -> [[f32; 3]; EVIDENCE_JOINTS] {
        let side = size / 5.0;
        let mut joints = [[0.0; 3]; EVIDENCE_JOINTS];
        joints[0] = [10.0, 20.0, height];
        joints[1] = [10.0 + 3.0 * side, 20.0 + 4.0 * side, height];
        joints
    }

    #[test]
    fn known_values() {
        let map = Confidence {
            joint_bias: 0.5,
            joint_slope: 2.0,
            joint_size: 1.0,
            person_bias: 1.0,
            person_slope: 3.0,
        };
        let near = |found: f32, expected: f32| assert!((found - expected).abs() < 1e-5, "{found}");
        near(map.joints(&person(200.0, 0.5))[1], 0.62245935);
        near(map.joints(&person(100.0, 0.5))[1], 0.45186275);
        near(map.joints(&person(200.0, 0.8))[0], 0.9634769);
        near(map.person(0.5), 0.7310586);
        near(map.person(0.25), 0.0914683);
    }

    #[test]
    fn shipped_probabilities_rise_with_what_was_seen_and_stay_in_bounds() {
        let map = AssociationConfig::default().confidence;
        let at = |size: f32, height: f32| map.joints(&person(size, height))[0];
        for k in 1..=100 {
            let (lower, higher) = (0.01 * (k - 1) as f32, 0.01 * k as f32);
            assert!(map.person(lower) <= map.person(higher));
            assert!(k == 1 || at(150.0, lower) <= at(150.0, higher));
            assert!(at(60.0, higher) < at(250.0, higher));
            assert!((0.0..=1.0).contains(&at(1e4, higher)) && at(0.0, higher) > 0.0);
        }
        assert_eq!(at(150.0, 0.0), 0.0, "not seen stays not seen");
    }
}
