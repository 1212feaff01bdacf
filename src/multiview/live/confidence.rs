//! In: how a joint was seen and fitted. Out: the probability that it is within 150 mm of the truth (relative to the
//! pelvis, the 3DPCK criterion), from an error model whose numbers were measured on synthetic scenes of one camera: a
//! probability that is not calibrated.

use crate::fit::confidence::{RADIUS, within};
use crate::joints::BODY_JOINTS;
use crate::message::JointState;

/// Error per axis of an observed joint, metres at canonical stature.
const OBSERVED: [f64; BODY_JOINTS] = [
    0.033, 0.023, 0.027, 0.035, 0.045, 0.027, 0.035, 0.045, 0.017, 0.031, 0.043, 0.017, 0.031,
    0.043, 0.004, 0.017, 0.028, 0.053, 0.053, 0.053, 0.053,
];
/// Factor for joints filled in from the others.
const OCCLUDED: f64 = 1.4;
/// Growth of the error per second without being seen, metres.
const GROWTH: f64 = 0.17;
/// Share of the distance between the fit and where rays meet that is taken for error of the fit: as measured of the
/// fit to one camera against Stage II, not of this distance.
const DISAGREEMENT: f64 = 0.35;

/// Confidence of one joint.
///
/// `unseen`: seconds since the person was seen; `deviation`: recent distance between the fit and where rays meet,
/// metres.
pub fn confidence(joint: usize, state: JointState, unseen: f64, deviation: f64) -> f64 {
    let mut sigma = OBSERVED[joint];
    if state != JointState::OBSERVED {
        sigma *= OCCLUDED;
    }
    let grown = GROWTH * unseen;
    let disagreement = DISAGREEMENT * deviation;
    let sigma = (sigma * sigma + grown * grown + disagreement * disagreement).sqrt();
    within(RADIUS / sigma)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn less_knowledge_is_less_confidence() {
        for joint in 0..BODY_JOINTS {
            let seen = confidence(joint, JointState::OBSERVED, 0.0, 0.03);
            let occluded = confidence(joint, JointState::OCCLUDED, 0.0, 0.03);
            let gone = confidence(joint, JointState::PREDICTED, 0.5, 0.03);
            assert!(seen >= occluded && occluded >= gone && gone > 0.0 && seen <= 1.0);
        }
    }
}
