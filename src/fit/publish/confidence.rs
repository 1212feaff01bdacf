//! In: how a joint was seen and fitted. Out: the probability that it is within 150 mm of the truth (relative to the
//! pelvis, the 3DPCK criterion).
//!
//! A logistic regression on synthetic films with truth; `examples/body_confidence.rs` fits its numbers.

pub use crate::fit::track::KnownJoint;
use crate::joints::BODY_JOINTS;
use crate::message::JointState;

/// The radius behind the probability, metres.
pub const RADIUS: f64 = 0.15;

/// Joints that are equally hard: head and neck (0), shoulders, elbows, knees, wrists, ankles, hands, tips of feet (7);
/// of hips, pelvis and spine, which are never far from the pelvis, [`PARTS`].
pub const PART: [usize; BODY_JOINTS] = [
    0, 0, 1, 2, 4, 1, 2, 4, 8, 3, 5, 8, 3, 5, 8, 8, 0, 6, 6, 7, 7,
];
/// How many parts there are.
pub const PARTS: usize = 8;
/// What a part starts from, by [`PART`].
const BIAS: [f64; PARTS] = [-1.20, -0.69, -4.18, -3.64, -5.01, -4.10, -5.01, -4.64];
/// Weights of [`features`].
const WEIGHTS: [f64; 3] = [-1.67, 0.18, 0.46];
/// Probability of what is near the pelvis.
const NEAR_PELVIS: f64 = 0.998;
/// Added to a deviation before its logarithm is taken, metres.
const LEAST_DEVIATION: f64 = 0.01;
/// Probabilities nearer to 0 and 1 count as this.
const LEAST: f64 = 0.02;
/// Growth of the error per second without being seen, metres.
const GROWTH: f64 = 0.17;

/// What is regressed on: logarithm of the deviation, 1 where the joint is not seen, logit of what was seen.
pub fn features(known: &KnownJoint) -> [f64; 3] {
    let is_seen = known.state == JointState::OBSERVED;
    let right = known.seen_right.clamp(LEAST, 1.0 - LEAST);
    [
        (known.deviation + LEAST_DEVIATION).ln(),
        f64::from(!is_seen),
        if is_seen {
            (right / (1.0 - right)).ln()
        } else {
            0.0
        },
    ]
}

/// Probability that joint number `joint` is within [`RADIUS`] of the truth.
pub fn of(joint: usize, known: &KnownJoint) -> f64 {
    let stays = drift(known.unseen);
    let part = PART[joint];
    if part == PARTS {
        return NEAR_PELVIS * stays;
    }
    let weighted = features(known)
        .iter()
        .zip(WEIGHTS)
        .map(|(x, w)| x * w)
        .sum::<f64>();
    stays / (1.0 + (-BIAS[part] - weighted).exp())
}

/// Probability that somebody has not moved farther than [`RADIUS`] from where they are expected.
fn drift(unseen: f64) -> f64 {
    if unseen > 0.0 {
        within(RADIUS / (GROWTH * unseen))
    } else {
        1.0
    }
}

/// Probability that a point of a standard normal distribution in space is nearer than `x` to its centre.
pub fn within(x: f64) -> f64 {
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
        let seen = KnownJoint {
            state: JointState::OBSERVED,
            seen_right: 0.9,
            deviation: 0.03,
            unseen: 0.0,
        };
        let worse = [
            KnownJoint {
                seen_right: 0.5,
                ..seen
            },
            KnownJoint {
                state: JointState::OCCLUDED,
                ..seen
            },
            KnownJoint {
                deviation: 0.1,
                ..seen
            },
            KnownJoint {
                unseen: 0.5,
                ..seen
            },
        ];
        for joint in (0..BODY_JOINTS).filter(|j| PART[*j] < PARTS) {
            let sure = of(joint, &seen);
            assert!(sure < 1.0);
            for (k, worse) in worse.iter().enumerate() {
                let less = of(joint, worse);
                assert!(0.0 < less && less < sure, "joint {joint}, {k}");
            }
        }
    }
}
