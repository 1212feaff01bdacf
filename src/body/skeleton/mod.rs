//! In: `models/skeleton.toml` and a [`Pose`]. Out: joint positions and the axes of every degree of freedom, from which
//! the exact derivative of any joint follows. docs/body.md, The skeleton.

mod dof;
mod girdle;
mod humanoid;
mod limb;
mod pose;

pub use dof::Dof;
pub use humanoid::{RIG_BONES, RIG_NAMES, TPose, bone_rotations, rig_rotations};
pub use limb::{LIMBS, Limb};
pub use pose::{Pose, Posed, rotation_vector, rotation_vector_near};

use std::sync::OnceLock;

use glam::{DQuat, DVec3};
use serde::Deserialize;

use self::girdle::Girdle;
use crate::body::{BodyModel, Elimination};
use crate::joints::{
    BODY_JOINTS, DOF, HEAD_TOP, JOINT_NAMES, L_FOOT_TIP, PARENTS, PELVIS, R_FOOT_TIP, ROOT_FIRST,
};

/// Joint angles: all degrees of freedom but the six of the root; [`Dof`] says which are which.
pub const ANGLES: usize = DOF - 6;
/// Length in metres of the bone that ends in each joint, of a person of canonical stature; 0 for the pelvis.
pub type BoneLengths = [f64; BODY_JOINTS];

/// Height of a standing ankle above the floor at canonical stature, metres.
pub const ANKLE_HEIGHT: f64 = 0.085;
/// What the joints leave out of the stature: under the toe joints and above the head joint, metres.
const SOLE_AND_SCALP: f64 = 0.012;

/// A degree of freedom beyond the root.
#[derive(Debug, Clone, PartialEq)]
pub struct JointAngle {
    /// Name, e.g. `l_elbow_flexion`.
    pub name: String,
    /// The joint in which the turned bone ends.
    pub bone: usize,
    /// Axis in the frame of the bone before, rest axes.
    pub axis: DVec3,
    /// Anatomical limits, radians.
    pub limits: [f64; 2],
}

impl JointAngle {
    /// Signed distance beyond the limits, radians; 0 within.
    pub fn beyond(&self, angle: f64) -> f64 {
        (angle - self.limits[1]).max(0.0) + (angle - self.limits[0]).min(0.0)
    }
}

/// The articulated body: bones, degrees of freedom, limits.
#[derive(Debug, Clone)]
pub struct Skeleton {
    angles: Vec<JointAngle>,
    directions: [DVec3; BODY_JOINTS],
    lengths: BoneLengths,
    /// Range of the angles that turn the bone ending in each joint.
    own: [(usize, usize); BODY_JOINTS],
    /// How a raised arm lifts the bone ending in each joint.
    girdles: [Option<Girdle>; BODY_JOINTS],
    /// Angles that move each joint, root first.
    chains: [Vec<usize>; BODY_JOINTS],
    elimination: Elimination,
}

/// Why a skeleton description is refused.
#[derive(Debug, thiserror::Error)]
pub enum SkeletonError {
    /// The file is no TOML of the expected shape.
    #[error(
        "expected a skeleton description (see models/skeleton.toml), found: {0}; correct the file"
    )]
    Syntax(#[from] toml::de::Error),
    /// The file contradicts the joint layout.
    #[error(
        "expected a skeleton of {BODY_JOINTS} joints and {ANGLES} joint angles, found {0}; correct the file"
    )]
    Layout(String),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    stature: f64,
    bone: Vec<FileBone>,
    dof: Vec<FileDof>,
    girdle: Vec<FileGirdle>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct FileBone {
    joint: String,
    parent: String,
    rest: [f64; 3],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct FileDof {
    name: String,
    bone: String,
    axis: [f64; 3],
    limits: [f64; 2],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct FileGirdle {
    bone: String,
    axis: [f64; 3],
    angles: [String; 2],
    degrees: f64,
}

impl Skeleton {
    /// The skeleton of `models/skeleton.toml`, embedded at build time.
    pub fn builtin() -> &'static Self {
        static SKELETON: OnceLock<Skeleton> = OnceLock::new();
        SKELETON.get_or_init(|| {
            Self::parse(include_str!("../../../models/skeleton.toml"))
                .expect("the embedded skeleton is covered by tests")
        })
    }

    /// Reads a skeleton description.
    ///
    /// # Errors
    /// [`SkeletonError`] if it is no TOML, or bones and joints do not match the layout of the messages.
    pub fn parse(text: &str) -> Result<Self, SkeletonError> {
        let file: File = toml::from_str(text)?;
        let index = |name: &str| {
            JOINT_NAMES
                .iter()
                .position(|n| *n == name)
                .ok_or_else(|| SkeletonError::Layout(format!("the unknown joint {name:?}")))
        };
        let scale = crate::joints::CANONICAL_STATURE as f64 / file.stature;
        let mut directions = [DVec3::ZERO; BODY_JOINTS];
        let mut lengths = [0.0; BODY_JOINTS];
        for bone in &file.bone {
            let (joint, parent) = (index(&bone.joint)?, index(&bone.parent)?);
            if joint == PELVIS || PARENTS[joint] != parent {
                return Err(SkeletonError::Layout(format!(
                    "bone {:?} starting at {:?} instead of {:?}",
                    bone.joint, bone.parent, JOINT_NAMES[PARENTS[joint]]
                )));
            }
            let rest = DVec3::from_array(bone.rest);
            lengths[joint] = rest.length() * scale;
            directions[joint] = rest.normalize_or_zero();
        }
        let has_length = |j: usize| lengths[j] > 1e-3 && lengths[j].is_finite();
        if let Some(j) = (0..BODY_JOINTS).find(|&j| j != PELVIS && !has_length(j)) {
            return Err(SkeletonError::Layout(format!(
                "no length for bone {:?}",
                JOINT_NAMES[j]
            )));
        }
        if file.dof.len() != ANGLES {
            return Err(SkeletonError::Layout(format!(
                "{} joint angles",
                file.dof.len()
            )));
        }
        let mut angles = Vec::with_capacity(ANGLES);
        let mut own = [(0, 0); BODY_JOINTS];
        for (k, dof) in file.dof.into_iter().enumerate() {
            let bone = index(&dof.bone)?;
            let follows = own[bone] == (0, 0) || own[bone].1 == k;
            let axis = DVec3::from_array(dof.axis).normalize_or_zero();
            let [low, high] = dof.limits;
            let is_range = low.is_finite() && high.is_finite() && low < high;
            if bone == PELVIS || !follows || axis == DVec3::ZERO || !is_range {
                return Err(SkeletonError::Layout(format!(
                    "angle {:?} with a bad bone, axis, limits or place in the order",
                    dof.name
                )));
            }
            own[bone] = (if own[bone] == (0, 0) { k } else { own[bone].0 }, k + 1);
            angles.push(JointAngle {
                name: dof.name,
                bone,
                axis,
                limits: dof.limits.map(f64::to_radians),
            });
        }
        let mut girdles = [None; BODY_JOINTS];
        for girdle in file.girdle {
            let lifted = index(&girdle.bone)?;
            let named = |name: &String| {
                let k = angles.iter().position(|a: &JointAngle| a.name == *name);
                k.filter(|&k| PARENTS[angles[k].bone] == lifted)
            };
            let axis = DVec3::from_array(girdle.axis).normalize_or_zero();
            let [Some(first), Some(second)] = [0, 1].map(|n| named(&girdle.angles[n])) else {
                return Err(SkeletonError::Layout(format!(
                    "a girdle of {:?} with angles of other bones than the one that starts there",
                    girdle.bone
                )));
            };
            let is_new = first != second && girdles[lifted].is_none();
            if axis == DVec3::ZERO || !girdle.degrees.is_finite() || !is_new {
                return Err(SkeletonError::Layout(format!(
                    "a girdle of {:?} with a bad axis, degrees or angles, or a second one",
                    girdle.bone
                )));
            }
            girdles[lifted] = Some(Girdle {
                axis,
                reach: girdle.degrees.to_radians(),
                angles: [first, second],
            });
        }
        let mut chains: [Vec<usize>; BODY_JOINTS] = Default::default();
        for j in ROOT_FIRST.into_iter().filter(|&j| j != PELVIS) {
            let lifting = girdles[j].map_or([].into(), |g| g.angles.to_vec());
            let mut chain = chains[PARENTS[j]].clone();
            chain.extend((own[j].0..own[j].1).chain(lifting));
            chain.sort_unstable();
            chain.dedup();
            chains[j] = chain;
        }
        let together: Vec<Vec<usize>> = chains
            .iter()
            .map(|chain| {
                Dof::ROOT
                    .chain(chain.iter().map(|k| Dof::Angle(*k).number()))
                    .collect()
            })
            .collect();
        let elimination = Elimination::from_the_last(DOF, together.iter().map(Vec::as_slice));
        Ok(Self {
            angles,
            directions,
            lengths,
            own,
            girdles,
            chains,
            elimination,
        })
    }

    /// Names, axes and limits of the joint angles.
    pub fn angles(&self) -> &[JointAngle] {
        &self.angles
    }

    /// Bone lengths of the average person of canonical stature.
    pub fn lengths(&self) -> &BoneLengths {
        &self.lengths
    }

    /// Direction of the bone that ends in each joint, in the rest pose.
    pub fn directions(&self) -> &[DVec3; BODY_JOINTS] {
        &self.directions
    }

    /// Angles that move a joint, root first.
    pub fn chain(&self, joint: usize) -> &[usize] {
        &self.chains[joint]
    }

    /// Angles that turn the bone ending in a joint: first and one past the last.
    pub fn own_angles(&self, joint: usize) -> (usize, usize) {
        self.own[joint]
    }

    /// Height in the rest pose of a person with these bones, from the floor under the toes to the crown.
    pub fn stature(&self, lengths: &BoneLengths) -> f64 {
        let height = |mut j: usize| {
            let mut y = 0.0;
            while j != PELVIS {
                y += self.directions[j].y * lengths[j];
                j = PARENTS[j];
            }
            y
        };
        height(HEAD_TOP) - 0.5 * (height(R_FOOT_TIP) + height(L_FOOT_TIP)) + SOLE_AND_SCALP
    }

    /// Brings angles back to their limits.
    pub fn clamp(&self, angles: &mut [f64; ANGLES]) {
        for (angle, dof) in angles.iter_mut().zip(&self.angles) {
            *angle = angle.clamp(dof.limits[0], dof.limits[1]);
        }
    }

    /// Forward kinematics.
    pub fn pose(&self, pose: &Pose, lengths: &BoneLengths, out: &mut Posed) {
        out.joints[PELVIS] = pose.position;
        out.frames[PELVIS] = pose.rotation;
        for &j in &ROOT_FIRST[1..] {
            let parent = PARENTS[j];
            let origin = out.joints[parent];
            let mut frame = out.frames[parent];
            for k in self.own[j].0..self.own[j].1 {
                let angle = &self.angles[k];
                out.axes[k] = frame * angle.axis;
                out.origins[k] = origin;
                let (sin, cos) = (0.5 * pose.angles[k]).sin_cos();
                let v = angle.axis * sin;
                frame *= DQuat::from_xyzw(v.x, v.y, v.z, cos);
            }
            let mut bone = frame * (self.directions[j] * lengths[j]);
            if let Some(girdle) = &self.girdles[j] {
                bone = girdle.lift(frame, bone, &pose.angles, &mut out.carried);
            }
            out.frames[j] = frame;
            out.joints[j] = origin + bone;
        }
    }
}

impl BodyModel for Skeleton {
    type Pose = Pose;
    type Shape = BoneLengths;
    type Posed = Posed;

    /// Not turned out of the rest axes: before a camera, whose y points down, it stands on its head.
    fn rest_pose(&self) -> Pose {
        Pose {
            position: DVec3::ZERO,
            rotation: DQuat::IDENTITY,
            angles: [0.0; ANGLES],
        }
    }

    fn moved(&self, pose: &Pose, step: &[f64]) -> Pose {
        let mut fixed = [0.0; DOF];
        fixed.copy_from_slice(step);
        pose.moved(&fixed)
    }

    fn kinematics(&self, pose: &Pose, shape: &BoneLengths, out: &mut Posed) {
        self.pose(pose, shape, out);
    }

    fn jacobian(&self, posed: &Posed, joint: usize, mut column: impl FnMut(usize, DVec3)) {
        let at = posed.joints[joint];
        let arm = at - posed.joints[PELVIS];
        for (a, axis) in DVec3::AXES.into_iter().enumerate() {
            column(Dof::Position(a).number(), axis);
        }
        for (a, axis) in DVec3::AXES.into_iter().enumerate() {
            column(Dof::Rotation(a).number(), axis.cross(arm));
        }
        for &k in &self.chains[joint] {
            column(Dof::Angle(k).number(), posed.derivative(k, at));
        }
    }

    fn elimination(&self) -> &Elimination {
        &self.elimination
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::joints::{L_SHOULDER, NECK, R_ANKLE, R_SHOULDER};

    fn some_pose(seed: u64) -> Pose {
        let mut state = seed;
        let mut random = move || {
            state = state
                .wrapping_mul(6364136223846793005)
                .wrapping_add(1442695040888963407);
            (state >> 33) as f64 / (1u64 << 31) as f64 * 2.0 - 1.0
        };
        Pose {
            position: DVec3::new(random(), random(), 3.0 + random()),
            rotation: DQuat::from_scaled_axis(DVec3::new(random(), random(), random()) * 2.0),
            angles: std::array::from_fn(|_| random()),
        }
    }

    #[test]
    fn rest_pose_is_a_standing_person_of_canonical_stature() {
        let s = Skeleton::builtin();
        assert!(
            (s.stature(s.lengths()) - 1.70).abs() < 0.01,
            "{}",
            s.stature(s.lengths())
        );
        let mut posed = Posed::default();
        s.pose(&Pose::facing_camera(3.0), s.lengths(), &mut posed);
        // Camera axes: y down, the person's left on the picture's right, the front towards the camera.
        assert!(
            posed.joints[HEAD_TOP].y < posed.joints[NECK].y
                && posed.joints[NECK].y < posed.joints[R_ANKLE].y
        );
        assert!(posed.joints[L_SHOULDER].x > 0.1 && posed.joints[R_SHOULDER].x < -0.1);
        assert!(posed.joints[R_FOOT_TIP].z < posed.joints[R_ANKLE].z - 0.1);
    }

    #[test]
    fn signs_are_anatomical() {
        let s = Skeleton::builtin();
        let bent = |name: &str, degrees: f64| {
            let mut pose = Pose {
                position: DVec3::ZERO,
                rotation: DQuat::IDENTITY,
                angles: [0.0; ANGLES],
            };
            let k = s.angles().iter().position(|a| a.name == name).unwrap();
            pose.angles[k] = degrees.to_radians();
            let mut posed = Posed::default();
            s.pose(&pose, s.lengths(), &mut posed);
            posed.joints
        };
        let rest = bent("neck_yaw", 0.0);
        for (name, joint, axis, sign) in [
            ("spine_flexion", 1, 2, 1.0),
            ("spine_lateral", 1, 0, 1.0),
            ("spine_twist", 2, 2, 1.0),
            ("neck_flexion", 0, 2, 1.0),
            ("r_shoulder_flexion", 3, 2, 1.0),
            ("l_shoulder_flexion", 6, 2, 1.0),
            ("r_shoulder_abduction", 3, 0, -1.0),
            ("l_shoulder_abduction", 6, 0, 1.0),
            ("r_elbow_flexion", 4, 2, 1.0),
            ("l_elbow_flexion", 7, 2, 1.0),
            ("r_hip_flexion", 9, 2, 1.0),
            ("l_hip_abduction", 12, 0, 1.0),
            ("r_hip_abduction", 9, 0, -1.0),
            ("r_knee_flexion", 10, 2, -1.0),
            ("l_knee_flexion", 13, 2, -1.0),
            ("r_ankle_flexion", 19, 1, -1.0),
        ] {
            let moved = bent(name, 30.0)[joint] - rest[joint];
            assert!(moved[axis] * sign > 0.02, "{name}: {moved}");
        }
        // Inward rotation with the elbow bent brings the hand to the midline.
        for (side, wrist) in [("r", 4), ("l", 7)] {
            let mut pose = Pose::facing_camera(3.0);
            pose.rotation = DQuat::IDENTITY;
            for (name, degrees) in [("elbow_flexion", 90.0), ("shoulder_rotation", 40.0)] {
                let name = format!("{side}_{name}");
                let k = s.angles().iter().position(|a| a.name == name).unwrap();
                pose.angles[k] = f64::to_radians(degrees);
            }
            let mut posed = Posed::default();
            s.pose(&pose, s.lengths(), &mut posed);
            assert!(posed.joints[wrist].x.abs() < posed.joints[wrist - 1].x.abs() - 0.1);
        }
    }

    #[test]
    fn derivatives_match_finite_differences() {
        let s = Skeleton::builtin();
        let (mut at, mut plus, mut minus) = (Posed::default(), Posed::default(), Posed::default());
        for seed in 1..20 {
            let pose = some_pose(seed);
            s.pose(&pose, s.lengths(), &mut at);
            for d in 0..DOF {
                let mut step = [0.0; DOF];
                let h = 1e-6;
                step[d] = h;
                s.pose(&pose.moved(&step), s.lengths(), &mut plus);
                step[d] = -h;
                s.pose(&pose.moved(&step), s.lengths(), &mut minus);
                for j in 0..BODY_JOINTS {
                    let numeric = (plus.joints[j] - minus.joints[j]) / (2.0 * h);
                    let unit = DVec3::AXES[d % 3];
                    let analytic = match Dof::of(d) {
                        Dof::Position(_) => unit,
                        Dof::Rotation(_) => unit.cross(at.joints[j] - pose.position),
                        Dof::Angle(k) if s.chain(j).contains(&k) => at.derivative(k, at.joints[j]),
                        _ => DVec3::ZERO,
                    };
                    assert!((numeric - analytic).length() < 1e-7, "dof {d} joint {j}");
                }
            }
        }
    }

    #[test]
    fn steps_invert() {
        for seed in 1..20 {
            let (a, b) = (some_pose(seed), some_pose(seed + 100));
            let c = a.moved(&b.step_from(&a));
            assert!((c.position - b.position).length() < 1e-9);
            assert!(c.rotation.dot(b.rotation).abs() > 1.0 - 1e-12);
        }
    }

    #[test]
    fn bad_descriptions_are_refused() {
        let good = include_str!("../../../models/skeleton.toml");
        for (from, to, expected) in [
            ("stature = 1.70", "stature = \"tall\"", "invalid type"),
            (
                "joint = \"spine\"",
                "joint = \"tail\"",
                "unknown joint \"tail\"",
            ),
            (
                "parent = \"spine\"",
                "parent = \"pelvis\"",
                "instead of \"spine\"",
            ),
            ("name = \"neck_yaw\"", "nom = \"neck_yaw\"", "nom"),
            (
                "limits = [-70.0, 70.0]",
                "limits = [70.0, -70.0]",
                "neck_yaw",
            ),
            ("limits = [-70.0, 70.0]", "limits = [nan, 70.0]", "neck_yaw"),
            (
                "limits = [-70.0, 70.0]",
                "limits = [-70.0, inf]",
                "neck_yaw",
            ),
            ("stature = 1.70", "stature = 0.0", "no length for bone"),
            (
                "angles = [\"r_shoulder_flexion\"",
                "angles = [\"l_shoulder_flexion\"",
                "girdle of \"r_shoulder\" with angles of other bones",
            ),
            (
                "angles = [\"r_shoulder_flexion\"",
                "angles = [\"r_shoulder_abduction\"",
                "girdle of \"r_shoulder\" with a bad",
            ),
            (
                "bone = \"l_shoulder\"\naxis = [0.0, 0.0, 1.0]\nangles = [\"l_shoulder_flexion\", \"l_shoulder_abduction\"]",
                "bone = \"r_shoulder\"\naxis = [0.0, 0.0, 1.0]\nangles = [\"r_shoulder_flexion\", \"r_shoulder_abduction\"]",
                "or a second one",
            ),
            (
                "degrees = 7.0",
                "degrees = nan",
                "girdle of \"r_shoulder\" with a bad",
            ),
        ] {
            let error = Skeleton::parse(&good.replacen(from, to, 1))
                .unwrap_err()
                .to_string();
            assert!(error.contains(expected), "{expected:?} not in {error:?}");
        }
    }
}
