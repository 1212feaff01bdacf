//! In: a person as the fit knows them. Out: the [`Body`] that apps read, in metres and pixels.

use glam::DVec3;

use super::confidence;
use super::header::pixel;
use crate::body::skeleton::bone_rotations;
use crate::body::skeleton::{Dof, Pose, Skeleton, rotation_vector_near};
use crate::fit::config::FitConfig;
use crate::fit::energy::MotionModel;
use crate::fit::track::Track;
use crate::joints::{BODY_JOINTS, DOF, PARENTS};
use crate::message::{Body, BodyState, Intrinsics, JointState};

/// Writes somebody as they are expected `ahead` seconds after they were last looked at.
pub fn write_body(
    track: &Track,
    ahead: f64,
    camera: &Intrinsics,
    config: &FitConfig,
    model: &MotionModel,
    body: &mut Body,
) {
    let skeleton = Skeleton::builtin();
    let (mut pose, mut posed) = (track.pose, track.posed);
    if ahead > 0.0 {
        pose = track.motion.ahead(&track.pose, ahead, model);
        skeleton.clamp(&mut pose.angles);
        skeleton.pose(&pose, track.bones.lengths(), &mut posed);
    }
    let scale = track.stature.scale(config);
    let state = if track.unseen > 0.0 {
        BodyState::PREDICTED
    } else {
        BodyState::TRACKED
    };
    body.id = track.id;
    body.state = state;
    body.position = (pose.position * scale).as_vec3().to_array();
    body.orientation = pose.rotation.normalize().as_quat().to_array();
    let velocity = DVec3::from_slice(&track.motion.velocity[Dof::POSITION]) * scale;
    body.velocity = velocity.as_vec3().to_array();
    body.angles = flat_angles(&pose, scale, track.turn);
    let mut sum = 0.0;
    for j in 0..BODY_JOINTS {
        let p = (posed.joints[j] * scale).as_vec3();
        body.joints3d[j] = p.to_array();
        body.joints2d[j] = pixel(camera, p).unwrap_or_default();
        let sure = confidence::of(j, &track.known(j, ahead));
        body.confidence[j] = sure as f32;
        sum += sure;
        // Those that the pose was solved with: the estimate may have moved on since.
        let bone = posed.joints[j] - posed.joints[PARENTS[j]];
        body.bone_lengths[j] = (bone.length() * scale) as f32;
        body.joint_states[j] = if track.unseen > 0.0 {
            JointState::PREDICTED
        } else {
            track.states[j]
        };
    }
    body.reserved = [0; 3];
    body.score = (sum / BODY_JOINTS as f64) as f32;
    body.height = track.stature.metres(config) as f32;
    body.bone_rotations = bone_rotations(&posed).map(|q| q.as_quat().to_array());
}

/// A pose as the message has it, in the order of [`Dof`]: of the root's rotation vectors the one nearer to `turn`;
/// metres by `scale`.
pub fn flat_angles(pose: &Pose, scale: f64, turn: DVec3) -> [f32; DOF] {
    let turn = rotation_vector_near(pose.rotation, turn);
    let place = pose.position * scale;
    std::array::from_fn(|d| match Dof::of(d) {
        Dof::Position(axis) => place[axis] as f32,
        Dof::Rotation(axis) => turn[axis] as f32,
        Dof::Angle(k) => pose.angles[k] as f32,
    })
}
