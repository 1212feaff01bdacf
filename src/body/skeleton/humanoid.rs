//! In: the rotations of a posed skeleton. Out: local rotations of VRM / Unity humanoid bones.
//!
//! Game engines start from a T-pose (axes x to the left, y up, z to the front) with arms stretched sideways, our
//! skeleton from hanging arms: arms get the quarter turn in between. The hips turn relative to the camera set upright:
//! x right, y up, z towards the viewer, so that a person who stands and faces the camera has no rotation at all.

use glam::{DQuat, DVec3};

use super::{BoneLengths, Posed, Skeleton};
use crate::joints::{PARENTS, PELVIS};
use crate::message::HUMANOID_BONE_COUNT;

/// For each humanoid bone: the body joint whose bone carries it, its humanoid parent, and the side of an arm (−1
/// right).
const BONES: [(usize, Option<usize>, f64); HUMANOID_BONE_COUNT] = [
    (PELVIS, None, 0.0),
    (1, Some(0), 0.0),
    (16, Some(1), 0.0),
    (0, Some(2), 0.0),
    (3, Some(1), -1.0),
    (4, Some(4), -1.0),
    (17, Some(5), -1.0),
    (6, Some(1), 1.0),
    (7, Some(7), 1.0),
    (18, Some(8), 1.0),
    (9, Some(0), 0.0),
    (10, Some(10), 0.0),
    (19, Some(11), 0.0),
    (12, Some(0), 0.0),
    (13, Some(13), 0.0),
    (20, Some(14), 0.0),
];

/// The T-pose from which [`bone_rotations`] turn, hips at the origin, x to the person's left, y up, z to the front,
/// metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TPose {
    /// The bone that carries each one; none carries the hips.
    pub parents: [Option<usize>; HUMANOID_BONE_COUNT],
    /// Where each bone starts, from where its parent starts.
    pub offsets: [DVec3; HUMANOID_BONE_COUNT],
    /// Where each bone ends, from where it starts; zero of the hips, which several bones leave.
    pub ends: [DVec3; HUMANOID_BONE_COUNT],
    /// The body joint in which each bone starts.
    pub starts: [usize; HUMANOID_BONE_COUNT],
}

impl TPose {
    /// Of somebody with these bones.
    pub fn new(skeleton: &Skeleton, lengths: &BoneLengths) -> Self {
        let starts = BONES.map(|(joint, _, _)| {
            if joint == PELVIS {
                joint
            } else {
                PARENTS[joint]
            }
        });
        let vector = |bone: usize, joint: usize| {
            let unturned = lower(BONES[bone].2).conjugate();
            unturned * (skeleton.directions()[joint] * lengths[joint])
        };
        let offsets = std::array::from_fn(|b| {
            let Some(parent) = BONES[b].1 else {
                return DVec3::ZERO;
            };
            let mut offset = DVec3::ZERO;
            let mut joint = starts[b];
            while joint != starts[parent] {
                offset += vector(parent, joint);
                joint = PARENTS[joint];
            }
            offset
        });
        Self {
            parents: BONES.map(|(_, parent, _)| parent),
            offsets,
            ends: std::array::from_fn(|b| match BONES[b].0 {
                PELVIS => DVec3::ZERO,
                joint => vector(b, joint),
            }),
            starts,
        }
    }
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

    #[test]
    fn rotations_and_the_t_pose_give_every_joint() {
        let s = Skeleton::builtin();
        let mut pose = Pose::facing_camera(3.0);
        pose.rotation = DQuat::from_scaled_axis(DVec3::new(2.8, 0.4, -0.3));
        for (k, angle) in pose.angles.iter_mut().enumerate() {
            let [low, high] = s.angles()[k].limits;
            *angle = low + (high - low) * ((k * 7) % 10) as f64 / 10.0;
        }
        let mut posed = Posed::default();
        s.pose(&pose, s.lengths(), &mut posed);
        let (t, local) = (TPose::new(s, s.lengths()), bone_rotations(&posed));
        let upright = DQuat::from_xyzw(1.0, 0.0, 0.0, 0.0);
        let (mut turn, mut at) = ([DQuat::IDENTITY; 16], [DVec3::ZERO; 16]);
        for b in 0..HUMANOID_BONE_COUNT {
            (turn[b], at[b]) = match t.parents[b] {
                Some(p) => (turn[p] * local[b], at[p] + turn[p] * t.offsets[b]),
                None => (local[b], upright * pose.position),
            };
            let near = |found: DVec3, joint: usize| {
                let off = (upright * posed.joints[joint] - found).length();
                assert!(off < 1e-9, "bone {b}, joint {joint}: {off}");
            };
            near(at[b], t.starts[b]);
            near(at[b] + turn[b] * t.ends[b], BONES[b].0);
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
