//! Joint layouts of every message and stage: names, limbs, parents.

/// Number of evidence joints: what Stage I detects in the picture.
pub const EVIDENCE_JOINTS: usize = 14;
/// Number of body joints: what Stage II predicts and the skeleton carries.
pub const BODY_JOINTS: usize = 21;
/// Number of limbs, each with one part affinity field.
pub const LIMBS: usize = 13;
/// Degrees of freedom of the fitted skeleton: 6 of the root, then 23 joint angles.
pub const DOF: usize = 29;

/// Index of the top of the head.
pub const HEAD_TOP: usize = 0;
/// Index of the neck, root of the association tree.
pub const NECK: usize = 1;
/// Index of the right shoulder.
pub const R_SHOULDER: usize = 2;
/// Index of the right elbow.
pub const R_ELBOW: usize = 3;
/// Index of the right wrist.
pub const R_WRIST: usize = 4;
/// Index of the left shoulder.
pub const L_SHOULDER: usize = 5;
/// Index of the left elbow.
pub const L_ELBOW: usize = 6;
/// Index of the left wrist.
pub const L_WRIST: usize = 7;
/// Index of the right hip.
pub const R_HIP: usize = 8;
/// Index of the right knee.
pub const R_KNEE: usize = 9;
/// Index of the right ankle.
pub const R_ANKLE: usize = 10;
/// Index of the left hip.
pub const L_HIP: usize = 11;
/// Index of the left knee.
pub const L_KNEE: usize = 12;
/// Index of the left ankle, the last evidence joint.
pub const L_ANKLE: usize = 13;
/// Index of the pelvis, root of the 3D joints.
pub const PELVIS: usize = 14;
/// Index of the spine.
pub const SPINE: usize = 15;
/// Index of the middle of the head.
pub const HEAD: usize = 16;
/// Index of the right hand.
pub const R_HAND: usize = 17;
/// Index of the left hand.
pub const L_HAND: usize = 18;
/// Index of the tip of the right foot.
pub const R_FOOT_TIP: usize = 19;
/// Index of the tip of the left foot.
pub const L_FOOT_TIP: usize = 20;

/// Shoulders, right and left, as all pairs here.
pub const SHOULDERS: [usize; 2] = [R_SHOULDER, L_SHOULDER];
/// Elbows.
pub const ELBOWS: [usize; 2] = [R_ELBOW, L_ELBOW];
/// Wrists.
pub const WRISTS: [usize; 2] = [R_WRIST, L_WRIST];
/// Hips.
pub const HIPS: [usize; 2] = [R_HIP, L_HIP];
/// Knees.
pub const KNEES: [usize; 2] = [R_KNEE, L_KNEE];
/// Ankles.
pub const ANKLES: [usize; 2] = [R_ANKLE, L_ANKLE];
/// Hands.
pub const HANDS: [usize; 2] = [R_HAND, L_HAND];
/// Tips of the feet.
pub const FOOT_TIPS: [usize; 2] = [R_FOOT_TIP, L_FOOT_TIP];

/// All joints that have one on the other side: (right, left). The first [`MIRRORED_EVIDENCE`] are evidence joints.
pub const MIRRORED: [[usize; 2]; 8] = [
    SHOULDERS, ELBOWS, WRISTS, HIPS, KNEES, ANKLES, HANDS, FOOT_TIPS,
];
/// How many of [`MIRRORED`] are pairs of evidence joints.
pub const MIRRORED_EVIDENCE: usize = 6;

/// Names of the body joints; the first [`EVIDENCE_JOINTS`] are the evidence joints.
pub const JOINT_NAMES: [&str; BODY_JOINTS] = [
    "head_top",
    "neck",
    "r_shoulder",
    "r_elbow",
    "r_wrist",
    "l_shoulder",
    "l_elbow",
    "l_wrist",
    "r_hip",
    "r_knee",
    "r_ankle",
    "l_hip",
    "l_knee",
    "l_ankle",
    "pelvis",
    "spine",
    "head",
    "r_hand",
    "l_hand",
    "r_foot_tip",
    "l_foot_tip",
];

/// Limbs as (child, parent) evidence joints; a part affinity field points from the child to the parent. Parents come
/// before children when the tree is walked in this order from the neck.
pub const LIMB_JOINTS: [(usize, usize); LIMBS] = [
    (HEAD_TOP, NECK),
    (R_SHOULDER, NECK),
    (R_ELBOW, R_SHOULDER),
    (R_WRIST, R_ELBOW),
    (L_SHOULDER, NECK),
    (L_ELBOW, L_SHOULDER),
    (L_WRIST, L_ELBOW),
    (R_HIP, NECK),
    (R_KNEE, R_HIP),
    (R_ANKLE, R_KNEE),
    (L_HIP, NECK),
    (L_KNEE, L_HIP),
    (L_ANKLE, L_KNEE),
];

/// Index of the limb that leads to `child`, any evidence joint but the neck.
///
/// # Panics
/// Where no limb does.
pub const fn limb_to(child: usize) -> usize {
    let mut limb = 0;
    while LIMB_JOINTS[limb].0 != child {
        limb += 1;
    }
    limb
}

/// Parent of every body joint; the pelvis is its own parent.
pub const PARENTS: [usize; BODY_JOINTS] = [
    HEAD, SPINE, NECK, R_SHOULDER, R_ELBOW, NECK, L_SHOULDER, L_ELBOW, PELVIS, R_HIP, R_KNEE,
    PELVIS, L_HIP, L_KNEE, PELVIS, PELVIS, NECK, R_WRIST, L_WRIST, R_ANKLE, L_ANKLE,
];

/// Body joints ordered so that every parent comes before its children.
pub const ROOT_FIRST: [usize; BODY_JOINTS] = [
    PELVIS, SPINE, R_HIP, L_HIP, NECK, R_KNEE, L_KNEE, HEAD, R_SHOULDER, L_SHOULDER, R_ANKLE,
    L_ANKLE, HEAD_TOP, R_ELBOW, L_ELBOW, R_FOOT_TIP, L_FOOT_TIP, R_WRIST, L_WRIST, R_HAND, L_HAND,
];

/// The evidence joint on the other side of the body (itself on the midline).
pub const MIRROR: [usize; EVIDENCE_JOINTS] = mirror(MIRRORED_EVIDENCE);

/// The body joint on the other side of the body (itself on the midline).
pub const MIRROR_BODY: [usize; BODY_JOINTS] = mirror(MIRRORED.len());

/// Every joint's other side, by the first `pairs` of [`MIRRORED`].
const fn mirror<const N: usize>(pairs: usize) -> [usize; N] {
    let mut other = [0; N];
    let mut j = 0;
    while j < N {
        other[j] = j;
        j += 1;
    }
    let mut k = 0;
    while k < pairs {
        let [right, left] = MIRRORED[k];
        other[right] = left;
        other[left] = right;
        k += 1;
    }
    other
}

/// Stature, metres, of the person that Stage I and Stage II describe: one view cannot tell size from distance, so the
/// networks speak of a person rescaled to this height and the fit restores the true one.
pub const CANONICAL_STATURE: f32 = 1.70;

/// Names of the degrees of freedom, in the order of [`Body::angles`](crate::message::Body::angles): the pelvis' place
/// (m) and rotation vector (rad), then 23 joint angles (rad).
pub const ANGLE_NAMES: [&str; DOF] = [
    "pelvis_tx",
    "pelvis_ty",
    "pelvis_tz",
    "pelvis_rx",
    "pelvis_ry",
    "pelvis_rz",
    "spine_flexion",
    "spine_lateral",
    "spine_twist",
    "neck_flexion",
    "neck_yaw",
    "r_shoulder_flexion",
    "r_shoulder_abduction",
    "r_shoulder_rotation",
    "r_elbow_flexion",
    "l_shoulder_flexion",
    "l_shoulder_abduction",
    "l_shoulder_rotation",
    "l_elbow_flexion",
    "r_hip_flexion",
    "r_hip_abduction",
    "r_hip_rotation",
    "r_knee_flexion",
    "r_ankle_flexion",
    "l_hip_flexion",
    "l_hip_abduction",
    "l_hip_rotation",
    "l_knee_flexion",
    "l_ankle_flexion",
];

/// Bones whose local rotations a [`Body`](crate::message::Body) carries, in the order of [`HUMANOID_BONES`].
pub const HUMANOID_BONE_COUNT: usize = 16;
/// VRM / Unity humanoid names of [`Body::bone_rotations`](crate::message::Body::bone_rotations).
pub const HUMANOID_BONES: [&str; HUMANOID_BONE_COUNT] = [
    "hips",
    "spine",
    "neck",
    "head",
    "rightUpperArm",
    "rightLowerArm",
    "rightHand",
    "leftUpperArm",
    "leftLowerArm",
    "leftHand",
    "rightUpperLeg",
    "rightLowerLeg",
    "rightFoot",
    "leftUpperLeg",
    "leftLowerLeg",
    "leftFoot",
];

/// The bone that carries each of [`HUMANOID_BONES`]; the hips carry themselves.
pub const HUMANOID_PARENTS: [usize; HUMANOID_BONE_COUNT] =
    [0, 0, 1, 2, 1, 4, 5, 1, 7, 8, 0, 10, 11, 0, 13, 14];

/// Number of keypoints of a person in COCO.
pub const COCO_KEYPOINT_COUNT: usize = 17;
/// COCO's names of them, in its order; left and right are the person's own, as everywhere here.
pub const COCO_KEYPOINTS: [&str; COCO_KEYPOINT_COUNT] = [
    "nose",
    "left_eye",
    "right_eye",
    "left_ear",
    "right_ear",
    "left_shoulder",
    "right_shoulder",
    "left_elbow",
    "right_elbow",
    "left_wrist",
    "right_wrist",
    "left_hip",
    "right_hip",
    "left_knee",
    "right_knee",
    "left_ankle",
    "right_ankle",
];
/// The body joint for each of [`COCO_KEYPOINTS`]; `None` in the face, of which no body joint is a part.
pub const COCO_JOINTS: [Option<usize>; COCO_KEYPOINT_COUNT] = [
    None,
    None,
    None,
    None,
    None,
    Some(L_SHOULDER),
    Some(R_SHOULDER),
    Some(L_ELBOW),
    Some(R_ELBOW),
    Some(L_WRIST),
    Some(R_WRIST),
    Some(L_HIP),
    Some(R_HIP),
    Some(L_KNEE),
    Some(R_KNEE),
    Some(L_ANKLE),
    Some(R_ANKLE),
];

/// Number of joints of Azure Kinect's body tracking.
pub const KINECT_JOINT_COUNT: usize = 32;
/// Its names of them without `K4ABT_JOINT_`, in its order; left and right are the person's own.
pub const KINECT_NAMES: [&str; KINECT_JOINT_COUNT] = [
    "PELVIS",
    "SPINE_NAVEL",
    "SPINE_CHEST",
    "NECK",
    "CLAVICLE_LEFT",
    "SHOULDER_LEFT",
    "ELBOW_LEFT",
    "WRIST_LEFT",
    "HAND_LEFT",
    "HANDTIP_LEFT",
    "THUMB_LEFT",
    "CLAVICLE_RIGHT",
    "SHOULDER_RIGHT",
    "ELBOW_RIGHT",
    "WRIST_RIGHT",
    "HAND_RIGHT",
    "HANDTIP_RIGHT",
    "THUMB_RIGHT",
    "HIP_LEFT",
    "KNEE_LEFT",
    "ANKLE_LEFT",
    "FOOT_LEFT",
    "HIP_RIGHT",
    "KNEE_RIGHT",
    "ANKLE_RIGHT",
    "FOOT_RIGHT",
    "HEAD",
    "NOSE",
    "EYE_LEFT",
    "EAR_LEFT",
    "EYE_RIGHT",
    "EAR_RIGHT",
];
/// The body joint for each of [`KINECT_NAMES`]; `None` where there is none.
pub const KINECT_JOINTS: [Option<usize>; KINECT_JOINT_COUNT] = [
    Some(PELVIS),
    Some(SPINE),
    None,
    Some(NECK),
    None,
    Some(L_SHOULDER),
    Some(L_ELBOW),
    Some(L_WRIST),
    Some(L_HAND),
    None,
    None,
    None,
    Some(R_SHOULDER),
    Some(R_ELBOW),
    Some(R_WRIST),
    Some(R_HAND),
    None,
    None,
    Some(L_HIP),
    Some(L_KNEE),
    Some(L_ANKLE),
    Some(L_FOOT_TIP),
    Some(R_HIP),
    Some(R_KNEE),
    Some(R_ANKLE),
    Some(R_FOOT_TIP),
    Some(HEAD),
    None,
    None,
    None,
    None,
    None,
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_named_joint_is_the_one_that_the_table_calls_so() {
        macro_rules! named {
            ($($joint:ident)*) => { [$(($joint, stringify!($joint))),*] };
        }
        let all = named!(
            HEAD_TOP NECK R_SHOULDER R_ELBOW R_WRIST L_SHOULDER L_ELBOW L_WRIST R_HIP R_KNEE R_ANKLE L_HIP L_KNEE
            L_ANKLE PELVIS SPINE HEAD R_HAND L_HAND R_FOOT_TIP L_FOOT_TIP
        );
        assert_eq!(all.map(|(_, name)| name.to_lowercase()), JOINT_NAMES);
        assert_eq!(all.map(|(joint, _)| joint), std::array::from_fn(|j| j));
    }

    #[test]
    fn every_joint_of_a_side_is_in_a_pair_with_that_of_the_other_side() {
        let right = JOINT_NAMES
            .iter()
            .filter_map(|name| name.strip_prefix("r_"));
        let pairs = MIRRORED.map(|pair| pair.map(|j| JOINT_NAMES[j].to_owned()));
        let expected: Vec<_> = right
            .map(|name| [format!("r_{name}"), format!("l_{name}")])
            .collect();
        assert_eq!(Vec::from(pairs), expected);
        let evidence = MIRRORED
            .iter()
            .filter(|pair| pair.iter().all(|j| *j < EVIDENCE_JOINTS));
        assert_eq!(evidence.count(), MIRRORED_EVIDENCE);
        assert_eq!(MIRROR, [0, 1, 5, 6, 7, 2, 3, 4, 11, 12, 13, 8, 9, 10]);
        assert_eq!(MIRROR_BODY[..EVIDENCE_JOINTS], MIRROR);
        assert_eq!(MIRROR_BODY[EVIDENCE_JOINTS..], [14, 15, 16, 18, 17, 20, 19]);
    }

    #[test]
    fn a_limb_is_found_by_where_it_leads() {
        for (limb, (child, _)) in LIMB_JOINTS.iter().enumerate() {
            assert_eq!(limb_to(*child), limb, "{}", JOINT_NAMES[*child]);
        }
    }

    /// What a body joint would be called by name and side.
    fn ours(name: &str) -> String {
        let name = name.to_lowercase();
        let side = |side: &str| {
            let rest = name
                .strip_prefix(&format!("{side}_"))
                .or_else(|| name.strip_suffix(&format!("_{side}")))?;
            let rest = if rest == "foot" { "foot_tip" } else { rest };
            Some(format!("{}_{rest}", &side[..1]))
        };
        let both = side("left").or_else(|| side("right"));
        both.unwrap_or_else(|| name.replace("spine_navel", "spine"))
    }

    #[test]
    fn a_joint_of_another_layout_is_ours_of_that_name_and_side() {
        let coco = COCO_KEYPOINTS.iter().zip(COCO_JOINTS);
        for (name, joint) in coco.chain(KINECT_NAMES.iter().zip(KINECT_JOINTS)) {
            let expected = JOINT_NAMES.iter().position(|n| *n == ours(name));
            assert_eq!(joint, expected, "{name}");
        }
    }
}
