//! A person's joints and limbs go in, how well they can be expected to fit somebody who is there comes out.

use edgecap_client::joints::{EVIDENCE_JOINTS, LIMBS};
use serde::{Deserialize, Serialize};

/// Values that a [`PersonScore`] weighs.
pub const FEATURES: usize = 2 * EVIDENCE_JOINTS + LIMBS + 3;
/// How many of the clearest joints count together.
const CLEAREST: usize = 4;

/// Expected object keypoint similarity with somebody who is there: logistic regression on what is known of a person.
/// Which joints are clear says more than how clear they are on average: patterns of light make shoulders and hips more
/// often than they make knees, and somebody cut off by the frame has few joints, but clear ones.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PersonScore {
    /// Added to the weighted sum.
    pub bias: f32,
    /// Weight of every joint's confidence.
    pub joint: [f32; EVIDENCE_JOINTS],
    /// Weight of its square.
    pub joint_squared: [f32; EVIDENCE_JOINTS],
    /// Weight of every limb's score.
    pub limb: [f32; LIMBS],
    /// Weight of the share of joints that were found.
    pub found: f32,
    /// Weight of the mean confidence of the four clearest joints.
    pub clearest: f32,
    /// Weight of the highest confidence.
    pub highest: f32,
}

impl PersonScore {
    /// Expected similarity, 0–1, from every joint's confidence and every limb's score (0 where there is none).
    pub fn expected(&self, joints: &[f32; EVIDENCE_JOINTS], limbs: &[f32; LIMBS]) -> f32 {
        let sum: f32 = self
            .weights()
            .zip(features(joints, limbs))
            .map(|(w, x)| w * x)
            .sum();
        1.0 / (1.0 + (-(sum + self.bias)).exp())
    }

    /// The weights in the order of [`features`].
    fn weights(&self) -> impl Iterator<Item = f32> {
        let lists = self.joint.iter().chain(&self.joint_squared);
        let single = [self.found, self.clearest, self.highest];
        lists.chain(&self.limb).copied().chain(single)
    }
}

/// What a [`PersonScore`] weighs: confidences, their squares, limb scores, share of joints found, mean of the four
/// clearest, the highest.
pub fn features(joints: &[f32; EVIDENCE_JOINTS], limbs: &[f32; LIMBS]) -> [f32; FEATURES] {
    let mut out = [0.0; FEATURES];
    let (plain, rest) = out.split_at_mut(EVIDENCE_JOINTS);
    let (squared, rest) = rest.split_at_mut(EVIDENCE_JOINTS);
    let (limb, rest) = rest.split_at_mut(LIMBS);
    plain.copy_from_slice(joints);
    for (to, c) in squared.iter_mut().zip(joints) {
        *to = c * c;
    }
    limb.copy_from_slice(limbs);
    let mut sorted = *joints;
    sorted.sort_unstable_by(|a, b| b.total_cmp(a));
    let found = joints.iter().filter(|c| **c > 0.0).count();
    rest[0] = found as f32 / EVIDENCE_JOINTS as f32;
    rest[1] = sorted[..CLEAREST].iter().sum::<f32>() / CLEAREST as f32;
    rest[2] = sorted[0];
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_feature_meets_its_own_weight() {
        let joints: [f32; EVIDENCE_JOINTS] = std::array::from_fn(|j| 0.05 * (j + 1) as f32);
        let limbs: [f32; LIMBS] = std::array::from_fn(|l| 0.9 - 0.05 * l as f32);
        let none = PersonScore {
            bias: -0.3,
            joint: [0.0; EVIDENCE_JOINTS],
            joint_squared: [0.0; EVIDENCE_JOINTS],
            limb: [0.0; LIMBS],
            found: 0.0,
            clearest: 0.0,
            highest: 0.0,
        };
        let logit = |s: &PersonScore| {
            let p = s.expected(&joints, &limbs);
            (p / (1.0 - p)).ln() + 0.3
        };
        assert!(logit(&none).abs() < 1e-5);
        let near = |s: PersonScore, expected: f32| {
            let found = logit(&s);
            assert!((found - expected).abs() < 1e-4, "{found} {expected}");
        };
        let mut one = none.clone();
        one.joint[5] = 2.0;
        near(one, 2.0 * 0.3);
        let mut one = none.clone();
        one.joint_squared[13] = -1.0;
        near(one, -0.49);
        let mut one = none.clone();
        one.limb[12] = 3.0;
        near(one, 3.0 * 0.3);
        near(
            PersonScore {
                found: 2.0,
                ..none.clone()
            },
            2.0,
        );
        near(
            PersonScore {
                clearest: 1.0,
                ..none.clone()
            },
            (0.7 + 0.65 + 0.6 + 0.55) / 4.0,
        );
        near(
            PersonScore {
                highest: 1.0,
                ..none
            },
            0.7,
        );
    }
}
