//! A detection goes in, Stage II's input row comes out; XNect §4.2.

use edgecap_client::joints::{EVIDENCE_JOINTS, NECK};

use super::weights::JOINT_INPUTS;
use crate::detect::Detection;

/// Smallest RMS radius, network pixels: keeps a person whose joints all fall together finite, as in training.
const LEAST_RADIUS: f32 = 1e-3;

/// Fills `row` (`14 × (u, v, confidence, 63 encodings)`): u and v relative to the neck — to the mean of the seen joints
/// where there is none — over the RMS distance of the seen joints from it; zeros where a joint was not seen. Without
/// `encodings` their places stay zero.
pub(crate) fn fill(detection: &Detection, encodings: bool, row: &mut [f32]) {
    row.fill(0.0);
    let joints = &detection.joints;
    let seen = || (0..EVIDENCE_JOINTS).filter(|&j| joints[j][2] > 0.0);
    let count = seen().count().max(1) as f32;
    let origin = if joints[NECK][2] > 0.0 {
        [joints[NECK][0], joints[NECK][1]]
    } else {
        let (mut u, mut v) = (0.0, 0.0);
        for j in seen() {
            u += joints[j][0];
            v += joints[j][1];
        }
        [u / count, v / count]
    };
    let square = |j: usize| (joints[j][0] - origin[0]).powi(2) + (joints[j][1] - origin[1]).powi(2);
    let radius = (seen().map(square).sum::<f32>() / count)
        .sqrt()
        .max(LEAST_RADIUS);
    for j in seen() {
        let to = &mut row[j * JOINT_INPUTS..(j + 1) * JOINT_INPUTS];
        to[0] = (joints[j][0] - origin[0]) / radius;
        to[1] = (joints[j][1] - origin[1]) / radius;
        to[2] = joints[j][2];
        if encodings {
            to[3..].copy_from_slice(&detection.encodings[j]);
        }
    }
}
