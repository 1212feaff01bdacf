//! Joint layouts of every message and stage: names, limbs, parents.

/// Number of evidence joints: what Stage I detects in the picture.
pub const EVIDENCE_JOINTS: usize = 14;
/// Number of body joints: what Stage II predicts and the skeleton carries.
pub const BODY_JOINTS: usize = 21;
/// Number of limbs, each with one part affinity field.
pub const LIMBS: usize = 13;
/// Degrees of freedom of the fitted skeleton: 6 of the root, then 23 joint angles.
pub const DOF: usize = 29;

/// Index of the neck, root of the association tree.
pub const NECK: usize = 1;
/// Index of the pelvis, root of the 3D joints.
pub const PELVIS: usize = 14;

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
    (0, 1),
    (2, 1),
    (3, 2),
    (4, 3),
    (5, 1),
    (6, 5),
    (7, 6),
    (8, 1),
    (9, 8),
    (10, 9),
    (11, 1),
    (12, 11),
    (13, 12),
];

/// Parent of every body joint; the pelvis is its own parent.
pub const PARENTS: [usize; BODY_JOINTS] = [
    16, 15, 1, 2, 3, 1, 5, 6, 14, 8, 9, 14, 11, 12, 14, 14, 1, 4, 7, 10, 13,
];

/// Body joints ordered so that every parent comes before its children.
pub const ROOT_FIRST: [usize; BODY_JOINTS] = [
    14, 15, 8, 11, 1, 9, 12, 16, 2, 5, 10, 13, 0, 3, 6, 19, 20, 4, 7, 17, 18,
];

/// The evidence joint on the other side of the body (itself on the midline).
pub const MIRROR: [usize; EVIDENCE_JOINTS] = [0, 1, 5, 6, 7, 2, 3, 4, 11, 12, 13, 8, 9, 10];

/// The body joint on the other side of the body (itself on the midline).
pub const MIRROR_BODY: [usize; BODY_JOINTS] = [
    0, 1, 5, 6, 7, 2, 3, 4, 11, 12, 13, 8, 9, 10, 14, 15, 16, 18, 17, 20, 19,
];

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
    Some(5),
    Some(2),
    Some(6),
    Some(3),
    Some(7),
    Some(4),
    Some(11),
    Some(8),
    Some(12),
    Some(9),
    Some(13),
    Some(10),
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
    Some(14),
    Some(15),
    None,
    Some(1),
    None,
    Some(5),
    Some(6),
    Some(7),
    Some(18),
    None,
    None,
    None,
    Some(2),
    Some(3),
    Some(4),
    Some(17),
    None,
    None,
    Some(11),
    Some(12),
    Some(13),
    Some(20),
    Some(8),
    Some(9),
    Some(10),
    Some(19),
    Some(16),
    None,
    None,
    None,
    None,
    None,
];

#[cfg(test)]
mod tests {
    use super::*;

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
