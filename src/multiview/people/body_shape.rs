//! Joints in space go in; whether they are a body's comes out.

use super::Joints;
use crate::joints::{
    L_ANKLE, L_ELBOW, L_HIP, L_KNEE, L_SHOULDER, L_WRIST, NECK, R_ANKLE, R_ELBOW, R_HIP, R_KNEE,
    R_SHOULDER, R_WRIST,
};

/// Neck to middle of the hips, metres: no body is outside of this.
const TRUNK: [f64; 2] = [0.25, 0.85];
/// The longest bones that are nobody's, metres: upper arm, forearm, thigh, shank.
const BONES: [(usize, usize, f64); 8] = [
    (R_SHOULDER, R_ELBOW, 0.5),
    (L_SHOULDER, L_ELBOW, 0.5),
    (R_ELBOW, R_WRIST, 0.45),
    (L_ELBOW, L_WRIST, 0.45),
    (R_HIP, R_KNEE, 0.7),
    (L_HIP, L_KNEE, 0.7),
    (R_KNEE, R_ANKLE, 0.7),
    (L_KNEE, L_ANKLE, 0.7),
];

/// Whether joints are as far from each other as a body's.
pub fn is_body(joints: &Joints) -> bool {
    let (Some(neck), Some(r), Some(l)) = (joints[NECK], joints[R_HIP], joints[L_HIP]) else {
        return false;
    };
    let trunk = neck.distance((r + l) / 2.0);
    let lengths = BONES
        .iter()
        .filter_map(|&(a, b, most)| Some((joints[a]?.distance(joints[b]?), most)));
    let (mut known, mut long) = (0, 0);
    for (length, most) in lengths {
        known += 1;
        long += usize::from(length > most);
    }
    (TRUNK[0]..TRUNK[1]).contains(&trunk) && known >= 3 && 2 * long < known
}
