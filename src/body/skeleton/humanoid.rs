//! In: the rotations of a posed skeleton. Out: local rotations of VRM / Unity humanoid bones.
//!
//! Game engines start from a T-pose (axes x to the left, y up, z to the front) with arms stretched sideways, our
//! skeleton from hanging arms: arms get the quarter turn in between. The hips turn relative to the camera set upright:
//! x right, y up, z towards the viewer, so that a person who stands and faces the camera has no rotation at all.
//!
//! Messages hold bones without shoulders, so that an avatar that has none points its arms as everybody else does. The
//! rig of files has them: there the shoulders lift as the skeleton's do.

use glam::{DQuat, DVec3};

use super::girdle::Girdle;
use super::{BoneLengths, Posed, Skeleton};
use crate::joints::{
    HEAD, HEAD_TOP, L_ANKLE, L_ELBOW, L_FOOT_TIP, L_HAND, L_KNEE, L_SHOULDER, L_WRIST, NECK,
    PARENTS, PELVIS, R_ANKLE, R_ELBOW, R_FOOT_TIP, R_HAND, R_KNEE, R_SHOULDER, R_WRIST,
};
use crate::message::{HUMANOID_BONE_COUNT, HUMANOID_BONES};

/// For each humanoid bone: the body joint whose bone carries it, its humanoid parent, and the side of an arm (−1
/// right).
const BONES: [(usize, Option<usize>, f64); HUMANOID_BONE_COUNT] = [
    (PELVIS, None, 0.0),
    (NECK, Some(0), 0.0),
    (HEAD, Some(1), 0.0),
    (HEAD_TOP, Some(2), 0.0),
    (R_ELBOW, Some(1), -1.0),
    (R_WRIST, Some(4), -1.0),
    (R_HAND, Some(5), -1.0),
    (L_ELBOW, Some(1), 1.0),
    (L_WRIST, Some(7), 1.0),
    (L_HAND, Some(8), 1.0),
    (R_KNEE, Some(0), 0.0),
    (R_ANKLE, Some(10), 0.0),
    (R_FOOT_TIP, Some(11), 0.0),
    (L_KNEE, Some(0), 0.0),
    (L_ANKLE, Some(13), 0.0),
    (L_FOOT_TIP, Some(14), 0.0),
];

/// Bones of the rig: those of messages and two shoulders.
pub const RIG_BONES: usize = HUMANOID_BONE_COUNT + 2;

/// Names of the rig's bones in VRM, each after the one that carries it.
pub const RIG_NAMES: [&str; RIG_BONES] = {
    let mut names = [""; RIG_BONES];
    let mut b = 0;
    while b < HUMANOID_BONE_COUNT {
        names[IN_RIG[b]] = HUMANOID_BONES[b];
        b += 1;
    }
    names[SHOULDERS[0].bone] = "rightShoulder";
    names[SHOULDERS[1].bone] = "leftShoulder";
    names
};

/// The rig's bone of each bone of a message.
const IN_RIG: [usize; HUMANOID_BONE_COUNT] =
    [0, 1, 2, 3, 5, 6, 7, 9, 10, 11, 12, 13, 14, 15, 16, 17];

/// A shoulder of the rig.
struct Shoulder {
    bone: usize,
    /// The joint in which it ends.
    joint: usize,
    /// The upper arm that it carries, in a message.
    arm: usize,
}

const SHOULDERS: [Shoulder; 2] = [
    Shoulder {
        bone: 4,
        joint: R_SHOULDER,
        arm: 4,
    },
    Shoulder {
        bone: 8,
        joint: L_SHOULDER,
        arm: 7,
    },
];

/// The T-pose of the rig, hips at the origin, x to the person's left, y up, z to the front, metres. [`rig_rotations`]
/// turn from it, and [`bone_rotations`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TPose {
    /// The bone that carries each one; none carries the hips.
    pub parents: [Option<usize>; RIG_BONES],
    /// Where each bone starts, from where its parent starts.
    pub offsets: [DVec3; RIG_BONES],
    /// Where each bone ends, from where it starts; zero of the hips, which several bones leave.
    pub ends: [DVec3; RIG_BONES],
}

impl TPose {
    /// Of somebody with these bones.
    pub fn new(skeleton: &Skeleton, lengths: &BoneLengths) -> Self {
        let mut parents = [None; RIG_BONES];
        let mut ends = [DVec3::ZERO; RIG_BONES];
        let mut joints = [PELVIS; RIG_BONES];
        let vector = |joint: usize| skeleton.directions()[joint] * lengths[joint];
        for (b, (joint, parent, side)) in BONES.into_iter().enumerate() {
            let bone = IN_RIG[b];
            (parents[bone], joints[bone]) = (parent.map(|p| IN_RIG[p]), joint);
            if joint != PELVIS {
                ends[bone] = lower(side).conjugate() * vector(joint);
            }
        }
        for Shoulder { bone, joint, arm } in SHOULDERS {
            (parents[bone], joints[bone]) = (parents[IN_RIG[arm]], joint);
            parents[IN_RIG[arm]] = Some(bone);
            ends[bone] = turned(skeleton, joint, 0.0) * vector(joint);
        }
        let offsets = std::array::from_fn(|bone| {
            let starts = |bone: usize| match joints[bone] {
                PELVIS => PELVIS,
                joint => PARENTS[joint],
            };
            match parents[bone] {
                Some(parent) if starts(bone) == joints[parent] => ends[parent],
                // What the hips carry starts beside the pelvis.
                Some(_) => vector(starts(bone)),
                None => DVec3::ZERO,
            }
        });
        Self {
            parents,
            offsets,
            ends,
        }
    }

    /// Where the bones of a message start, whose `rotations` are these, each from where the one starts that carries it,
    /// in that one's axes, metres: upper arms where a lifted shoulder holds them.
    pub fn offsets_in_message(
        &self,
        skeleton: &Skeleton,
        rotations: &[DQuat; HUMANOID_BONE_COUNT],
    ) -> [DVec3; HUMANOID_BONE_COUNT] {
        let rig = rig_rotations(skeleton, rotations);
        let mut offsets = IN_RIG.map(|bone| self.offsets[bone]);
        for Shoulder { bone, arm, .. } in SHOULDERS {
            offsets[arm] = self.offsets[bone] + rig[bone] * offsets[arm];
        }
        offsets
    }
}

/// How the bone that ends in a shoulder is turned; `hanging`: cosine of the angle between the upper arm and where it
/// hangs.
fn turned(skeleton: &Skeleton, joint: usize, hanging: f64) -> DQuat {
    let turn = |g: &Girdle| DQuat::from_axis_angle(g.axis, g.turned(hanging));
    skeleton.girdles[joint]
        .as_ref()
        .map_or(DQuat::IDENTITY, turn)
}

/// Local rotations of the rig, from those of a message.
pub fn rig_rotations(
    skeleton: &Skeleton,
    of_message: &[DQuat; HUMANOID_BONE_COUNT],
) -> [DQuat; RIG_BONES] {
    let mut all = [DQuat::IDENTITY; RIG_BONES];
    for (bone, rotation) in IN_RIG.into_iter().zip(of_message) {
        all[bone] = *rotation;
    }
    for Shoulder { bone, joint, arm } in SHOULDERS {
        let along = lower(BONES[arm].2).conjugate() * DVec3::NEG_Y;
        let hanging = -(of_message[arm] * along).y;
        let turn = turned(skeleton, joint, hanging) * turned(skeleton, joint, 0.0).conjugate();
        all[bone] = turn;
        all[IN_RIG[arm]] = turn.conjugate() * of_message[arm];
    }
    all
}

/// From a T-pose to hanging arms.
fn lower(side: f64) -> DQuat {
    DQuat::from_axis_angle(DVec3::Z, -side * std::f64::consts::FRAC_PI_2)
}

/// Local rotations in the order of [`HUMANOID_BONES`](crate::message::HUMANOID_BONES).
pub fn bone_rotations(posed: &Posed) -> [DQuat; HUMANOID_BONE_COUNT] {
    let upright = DQuat::from_xyzw(1.0, 0.0, 0.0, 0.0);
    let global = BONES.map(|(joint, _, side)| upright * posed.frames[joint] * lower(side));
    std::array::from_fn(|b| {
        let local = match BONES[b].1 {
            Some(parent) => global[parent].conjugate() * global[b],
            None => global[b],
        };
        let local = local.normalize();
        // One sign for one rotation, so that recordings compare.
        if local.w < 0.0 { -local } else { local }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::skeleton::{Pose, Skeleton};

    fn rotations(angles: &[(&str, f64)]) -> [DQuat; HUMANOID_BONE_COUNT] {
        let s = Skeleton::builtin();
        let mut pose = Pose::facing_camera(3.0);
        for (name, degrees) in angles {
            let k = s.angles().iter().position(|a| a.name == *name).unwrap();
            pose.angles[k] = degrees.to_radians();
        }
        let mut posed = Posed::default();
        s.pose(&pose, s.lengths(), &mut posed);
        bone_rotations(&posed)
    }

    #[test]
    fn a_t_pose_facing_the_camera_is_all_identity() {
        let t = rotations(&[
            ("r_shoulder_abduction", 90.0),
            ("l_shoulder_abduction", 90.0),
        ]);
        for (b, q) in t.iter().enumerate() {
            assert!(q.w > 1.0 - 1e-9, "bone {b}: {q}");
        }
    }

    /// Joints about the pelvis with these angles, in the T-pose's axes, and the rotations of a message.
    fn about(angles: impl Fn(usize) -> f64) -> ([DVec3; 21], [DQuat; HUMANOID_BONE_COUNT]) {
        let s = Skeleton::builtin();
        let mut pose = Pose::facing_camera(3.0);
        pose.angles = std::array::from_fn(angles);
        let mut posed = Posed::default();
        s.pose(&pose, s.lengths(), &mut posed);
        let upright = DQuat::from_xyzw(1.0, 0.0, 0.0, 0.0);
        let joints = posed.joints.map(|p| upright * (p - pose.position));
        (joints, bone_rotations(&posed))
    }

    #[test]
    fn rotations_and_the_t_pose_give_every_joint() {
        let s = Skeleton::builtin();
        let (joints, of_message) = about(|k| {
            let [low, high] = s.angles()[k].limits;
            low + (high - low) * ((k * 7) % 10) as f64 / 10.0
        });
        let (t, local) = (TPose::new(s, s.lengths()), rig_rotations(s, &of_message));
        let (mut turn, mut at) = ([DQuat::IDENTITY; RIG_BONES], [DVec3::ZERO; RIG_BONES]);
        for b in 0..RIG_BONES {
            (turn[b], at[b]) = match t.parents[b] {
                Some(p) => (turn[p] * local[b], at[p] + turn[p] * t.offsets[b]),
                None => (local[b], DVec3::ZERO),
            };
            let shoulder = SHOULDERS.iter().find(|s| s.bone == b).map(|s| s.joint);
            let in_message = IN_RIG.iter().position(|&bone| bone == b);
            let joint = shoulder.unwrap_or_else(|| BONES[in_message.unwrap()].0);
            let near = |found: DVec3, joint: usize| {
                let off = joints[joint].distance(found);
                assert!(off < 1e-9, "{}, joint {joint}: {off}", RIG_NAMES[b]);
            };
            near(at[b] + turn[b] * t.ends[b], joint);
            if joint != PELVIS {
                near(at[b], PARENTS[joint]);
            }
        }
    }

    #[test]
    fn a_rig_in_a_t_pose_is_all_identity() {
        let s = Skeleton::builtin();
        let (_, of_message) = about(|k| {
            let is_raised = s.angles()[k].name.ends_with("shoulder_abduction");
            f64::from(u8::from(is_raised)) * std::f64::consts::FRAC_PI_2
        });
        for (q, name) in rig_rotations(s, &of_message).iter().zip(RIG_NAMES) {
            assert!(q.w > 1.0 - 1e-9, "{name}: {q}");
        }
    }

    #[test]
    fn bones_of_a_message_start_where_lifted_shoulders_hold_them() {
        let s = Skeleton::builtin();
        let t = TPose::new(s, s.lengths());
        for degrees in [0.0f64, 70.0, 160.0] {
            let (joints, of_message) = about(|k| {
                let is_raised = s.angles()[k].name == "l_shoulder_flexion";
                f64::from(u8::from(is_raised)) * degrees.to_radians()
            });
            let offsets = t.offsets_in_message(s, &of_message);
            for Shoulder { joint, arm, .. } in SHOULDERS {
                // The bone of the spine starts in joint 15.
                let off = offsets[arm].distance(joints[joint] - joints[15]);
                assert!(off < 1e-9, "{}, {degrees}°: {off}", HUMANOID_BONES[arm]);
            }
        }
    }

    #[test]
    fn driving_a_t_pose_character_reproduces_the_directions() {
        let angles = [
            ("spine_twist", 20.0),
            ("spine_flexion", 25.0),
            ("l_shoulder_flexion", 70.0),
            ("l_shoulder_rotation", 30.0),
            ("l_elbow_flexion", 80.0),
            ("r_shoulder_abduction", 40.0),
            ("r_elbow_flexion", 35.0),
            ("r_hip_flexion", 60.0),
            ("r_knee_flexion", 90.0),
        ];
        let local = rotations(&angles);
        let s = Skeleton::builtin();
        let mut pose = Pose::facing_camera(3.0);
        for (name, degrees) in angles {
            let k = s.angles().iter().position(|a| a.name == name).unwrap();
            pose.angles[k] = f64::to_radians(degrees);
        }
        let mut posed = Posed::default();
        s.pose(&pose, s.lengths(), &mut posed);
        let mut global = [DQuat::IDENTITY; HUMANOID_BONE_COUNT];
        for b in 0..HUMANOID_BONE_COUNT {
            global[b] = BONES[b].1.map_or(DQuat::IDENTITY, |p| global[p]) * local[b];
        }
        // T-pose direction of the bone, its joints in our skeleton.
        for (bone, rest, from, to) in [
            (4, DVec3::NEG_X, 2, 3),
            (5, DVec3::NEG_X, 3, 4),
            (7, DVec3::X, 5, 6),
            (8, DVec3::X, 6, 7),
            (10, DVec3::NEG_Y, 8, 9),
            (11, DVec3::NEG_Y, 9, 10),
        ] {
            let seen = (posed.joints[to] - posed.joints[from]).normalize();
            let upright = DVec3::new(seen.x, -seen.y, -seen.z);
            assert!(
                (global[bone] * rest - upright).length() < 1e-9,
                "bone {bone}"
            );
        }
    }
}
