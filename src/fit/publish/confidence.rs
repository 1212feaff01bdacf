//! In: how a joint was seen and fitted. Out: the probability that it is within 150 mm of the truth (relative to the
//! pelvis, the 3DPCK criterion), from an error model whose numbers were measured on synthetic scenes.

use crate::joints::BODY_JOINTS;
use crate::message::JointState;

/// The radius behind the probability, metres.
pub const RADIUS: f64 = 0.15;

/// Error per axis of an observed joint, metres at canonical stature.
const OBSERVED: [f64; BODY_JOINTS] = [
    0.033, 0.023, 0.027, 0.035, 0.045, 0.027, 0.035, 0.045, 0.017, 0.031, 0.043, 0.017, 0.031,
    0.043, 0.004, 0.017, 0.028, 0.053, 0.053, 0.053, 0.053,
];
/// Factor for joints filled in from the others.
const OCCLUDED: f64 = 1.4;
/// Growth of the error per second without being seen, metres.
const GROWTH: f64 = 0.17;
/// Share of the disagreement between fit and Stage II that is error of the fit.
const DISAGREEMENT: f64 = 0.35;

/// Confidence of one joint.
///
/// `unseen`: seconds since the person was seen; `deviation`: recent distance between fit and Stage II, metres.
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

/// Probability that a point of a standard normal distribution in space is nearer than `x` to its centre.
fn within(x: f64) -> f64 {
    (erf(x / std::f64::consts::SQRT_2)
        - (2.0 / std::f64::consts::PI).sqrt() * x * (-0.5 * x * x).exp())
    .clamp(0.0, 1.0)
}

/// Error function, Abramowitz & Stegun 7.1.26, error below 2e-7.
fn erf(x: f64) -> f64 {
    let t = 1.0 / (1.0 + 0.3275911 * x.abs());
    let poly = t
        * (0.254829592
            + t * (-0.284496736 + t * (1.421413741 + t * (-1.453152027 + t * 1.061405429))));
    (1.0 - poly * (-x * x).exp()).copysign(x)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_values() {
        // Chi distribution with three degrees of freedom.
        assert!((within(1.0) - 0.198748).abs() < 1e-5);
        assert!((within(2.0) - 0.738536).abs() < 1e-5);
        assert!((within(3.0) - 0.970709).abs() < 1e-5);
    }

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
