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
