//! Joints of other layouts in a picture as the 14 evidence joints.
//!
//! Where a layout puts a joint elsewhere, the evidence joint is a fixed combination of others in the picture, from
//! proportions of the shipped body at rest: its neck is 0.101 m above the middle of the shoulders, the head's top 0.345
//! m, hips are 0.458 m below it and 0.209 m apart.

use glam::DVec2;

use super::archive::{COCO_JOINTS, JOINTS};
use crate::joints::{
    EVIDENCE_JOINTS, HEAD_TOP, L_ANKLE, L_ELBOW, L_HIP, L_KNEE, L_SHOULDER, L_WRIST, NECK, R_ANKLE,
    R_ELBOW, R_HIP, R_KNEE, R_SHOULDER, R_WRIST,
};
use crate::message::Observation;

/// Neck from the middle of the shoulders towards the head's top.
const NECK_TO_HEAD: f64 = 0.101 / 0.345;
/// Neck from the middle of the shoulders away from the middle of the hips.
const NECK_FROM_HIPS: f64 = 0.101 / 0.458;
/// The set's hips are about 0.095 m apart: half of what a body's are.
const HIPS: f64 = 0.209 / 0.095;
/// How sure any joint is: neither archive says.
const CONFIDENCE: f32 = 0.9;
/// Score of everybody: who is annotated is there.
const SURE: f32 = 0.98;

/// Evidence joints, right before left, from shoulders to ankles: which of the set's they are.
const OF_SET: [(usize, usize); 12] = [
    (R_SHOULDER, 5),
    (R_ELBOW, 6),
    (R_WRIST, 7),
    (L_SHOULDER, 2),
    (L_ELBOW, 3),
    (L_WRIST, 4),
    (R_HIP, 11),
    (R_KNEE, 12),
    (R_ANKLE, 13),
    (L_HIP, 8),
    (L_KNEE, 9),
    (L_ANKLE, 10),
];
/// The same of COCO's.
const OF_COCO: [(usize, usize); 12] = [
    (R_SHOULDER, 6),
    (R_ELBOW, 8),
    (R_WRIST, 10),
    (L_SHOULDER, 5),
    (L_ELBOW, 7),
    (L_WRIST, 9),
    (R_HIP, 12),
    (R_KNEE, 14),
    (R_ANKLE, 16),
    (L_HIP, 11),
    (L_KNEE, 13),
    (L_ANKLE, 15),
];

/// The set's joints, exact: its head is the head's top, the neck is set anew, hips are drawn apart.
pub fn of_set(pixels: &[DVec2; JOINTS]) -> Observation {
    let mut joints = [None; EVIDENCE_JOINTS];
    for (own, theirs) in OF_SET {
        joints[own] = Some(pixels[theirs]);
    }
    let hips = pixels[8].midpoint(pixels[11]);
    for (own, theirs) in [(R_HIP, 11), (L_HIP, 8)] {
        joints[own] = Some(hips + HIPS * (pixels[theirs] - hips));
    }
    let shoulders = pixels[2].midpoint(pixels[5]);
    joints[NECK] = Some(shoulders + NECK_TO_HEAD * (pixels[14] - shoulders));
    joints[HEAD_TOP] = Some(pixels[14]);
    told(joints)
}

/// COCO's joints as a detector told them: the neck is set anew, the head's top is not known.
pub fn of_coco(pixels: &[DVec2; COCO_JOINTS]) -> Observation {
    let mut joints = [None; EVIDENCE_JOINTS];
    for (own, theirs) in OF_COCO {
        joints[own] = Some(pixels[theirs]);
    }
    let shoulders = pixels[5].midpoint(pixels[6]);
    let hips = pixels[11].midpoint(pixels[12]);
    joints[NECK] = Some(shoulders + NECK_FROM_HIPS * (shoulders - hips));
    told(joints)
}

fn told(joints: [Option<DVec2>; EVIDENCE_JOINTS]) -> Observation {
    Observation {
        score: SURE,
        joints2d: joints.map(|p| p.map_or([0.0; 3], |p| [p.x as f32, p.y as f32, CONFIDENCE])),
        ..Observation::default()
    }
}
