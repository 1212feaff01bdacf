//! In: joints on the plane z = 1 and the same joints in 3D relative to the pelvis. Out: where the pelvis is in camera
//! space, even where a whole group of joints is wrong in the picture.
//!
//! A person's distance is the ratio of size in space to size in the picture. Legs that are invented near the torso of
//! somebody behind a counter agree with each other and make the whole person look small, so reweighting a fit to all
//! joints is not enough. Every bone chain is therefore asked for a root of its own, in closed form; each root is
//! refined with the joints that agree with it, and the one that leaves the least unexplained wins, trunk and head
//! counting more than limbs.

use glam::DVec3;

use super::Evidence;
use crate::camera::translation::{self, DEPTHS, least_squares};
use crate::joints::{
    EVIDENCE_JOINTS, HEAD_TOP, L_ANKLE, L_ELBOW, L_HIP, L_KNEE, L_SHOULDER, L_WRIST, NECK, R_ANKLE,
    R_ELBOW, R_HIP, R_KNEE, R_SHOULDER, R_WRIST,
};

/// Fewest joints from which a person's distance can be told.
const MIN_JOINTS: usize = 4;
/// Joint sets that are asked for a root: everything, trunk, head and shoulders, upper body, arms, sides, legs.
const CHAINS: [&[usize]; 8] = [
    &[
        HEAD_TOP, NECK, R_SHOULDER, R_ELBOW, R_WRIST, L_SHOULDER, L_ELBOW, L_WRIST, R_HIP, R_KNEE,
        R_ANKLE, L_HIP, L_KNEE, L_ANKLE,
    ],
    &[NECK, R_SHOULDER, L_SHOULDER, R_HIP, L_HIP],
    &HEAD_AND_SHOULDERS,
    &[
        HEAD_TOP, NECK, R_SHOULDER, R_ELBOW, R_WRIST, L_SHOULDER, L_ELBOW, L_WRIST,
    ],
    &[R_SHOULDER, R_ELBOW, R_WRIST, L_SHOULDER, L_ELBOW, L_WRIST],
    &[
        HEAD_TOP, NECK, R_SHOULDER, R_ELBOW, R_WRIST, R_HIP, R_KNEE, R_ANKLE,
    ],
    &[
        HEAD_TOP, NECK, L_SHOULDER, L_ELBOW, L_WRIST, L_HIP, L_KNEE, L_ANKLE,
    ],
    &[R_HIP, R_KNEE, R_ANKLE, L_HIP, L_KNEE, L_ANKLE],
];
const HEAD_AND_SHOULDERS: [usize; 4] = [HEAD_TOP, NECK, R_SHOULDER, L_SHOULDER];
/// What a joint's agreement is worth: trunk and head are seldom invented, limbs often.
const WORTH: [f64; EVIDENCE_JOINTS] = [
    1.0, 1.5, 1.5, 0.7, 0.5, 1.5, 0.7, 0.5, 1.0, 0.7, 0.5, 1.0, 0.7, 0.5,
];
/// Error of a 2D joint, metres at the person's distance, at which it is half lost for the root.
const SIGMA: f64 = 0.12;
/// Rounds of reweighting.
const ROUNDS: usize = 2;
/// Share by which a root at the expected distance may explain less than another, and what counts as that distance
/// (e-folds).
const EXPECTED_BONUS: f64 = 0.15;
const EXPECTED_SPREAD: f64 = 0.15;

/// Pelvis in camera space, metres at canonical stature; `None` where the joints do not determine it. `expected` is the
/// distance that motion predicts, if any: it decides between roots that explain about as much as each other.
pub fn place(evidence: &Evidence, expected: Option<f64>) -> Option<DVec3> {
    if !evidence.known3d || evidence.joints_seen() < MIN_JOINTS {
        return None;
    }
    let expected = expected.filter(|z| *z > DEPTHS[0]);
    let favour = |root: DVec3| {
        expected.map_or(0.0, |z| {
            let off = (root.z / z).ln() / EXPECTED_SPREAD;
            EXPECTED_BONUS * (-0.5 * off * off).exp()
        })
    };
    let mut best: Option<(f64, DVec3)> = None;
    let mut consider = |start: DVec3| {
        let root = refine(evidence, start);
        let score = unexplained(evidence, root) - favour(root);
        if best.is_none_or(|(least, _)| score < least) {
            best = Some((score, root));
        }
    };
    for chain in CHAINS {
        let mut weights = [0.0; EVIDENCE_JOINTS];
        for &j in chain {
            weights[j] = evidence.confidence[j];
        }
        if weights.iter().filter(|w| **w > 0.0).count() < 3 {
            continue;
        }
        if let Some(root) = least_squares(
            &evidence.plane,
            &evidence.points3d[..EVIDENCE_JOINTS],
            &weights,
        ) {
            consider(root);
        }
    }
    if let Some(root) = expected.and_then(|z| at_depth(evidence, z)) {
        consider(root);
    }
    best.map(|(_, root)| root)
}

/// Distance between what is seen of a joint and its 3D joint about `root`, metres at the person's distance.
pub fn disagreement(evidence: &Evidence, root: DVec3, joint: usize) -> f64 {
    let p = root + evidence.points3d[joint];
    if p.z < 0.1 {
        return 1.0;
    }
    (p.truncate() / p.z - evidence.plane[joint]).length() * root.z
}

/// The root at a given distance, from head, neck and shoulders.
fn at_depth(e: &Evidence, depth: f64) -> Option<DVec3> {
    let mut weights = [0.0; EVIDENCE_JOINTS];
    for j in HEAD_AND_SHOULDERS {
        weights[j] = e.confidence[j];
    }
    translation::at_depth(&e.plane, &e.points3d[..EVIDENCE_JOINTS], &weights, depth)
}

/// Least squares again with joints that disagree weighted down (Geman and McClure's weights).
fn refine(e: &Evidence, start: DVec3) -> DVec3 {
    let mut root = start;
    for _ in 0..ROUNDS {
        let weights: [f64; EVIDENCE_JOINTS] = std::array::from_fn(|j| {
            let r = disagreement(e, root, j) / SIGMA;
            e.confidence[j] / (1.0 + r * r).powi(2)
        });
        match least_squares(&e.plane, &e.points3d[..EVIDENCE_JOINTS], &weights) {
            Some(better) => root = better,
            None => break,
        }
    }
    root
}

/// Share of what is seen that a root does not explain, 0–1.
fn unexplained(e: &Evidence, root: DVec3) -> f64 {
    let (mut lost, mut all) = (0.0, 1e-9);
    for j in 0..EVIDENCE_JOINTS {
        let w = WORTH[j] * e.confidence[j];
        let r = disagreement(e, root, j) / SIGMA;
        lost += w * r * r / (1.0 + r * r);
        all += w;
    }
    lost / all
}
