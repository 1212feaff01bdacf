//! People in the world as the messages that every reader of bodies knows: in the calibration's axes, metres.

use glam::DVec3;

use super::confidence::confidence;
use super::person::Person;
use crate::body::skeleton::{Dof, bone_rotations};
use crate::fit::{MotionModel, flat_angles};
use crate::joints::{BODY_JOINTS, PARENTS};
use crate::message::{Body, BodyState, JointState};

/// Writes somebody as they are expected `ahead` seconds after the newest instant.
pub fn write_body(person: &Person, ahead: f64, model: &MotionModel, body: &mut Body) {
    let (mut pose, mut posed) = (person.pose, person.posed);
    if ahead > 0.0 {
        (pose, posed) = person.ahead(ahead, model);
    }
    let unseen = person.unseen + ahead;
    let is_predicted = person.unseen > 0.0;
    *body = Body {
        id: person.id,
        state: if is_predicted {
            BodyState::PREDICTED
        } else {
            BodyState::TRACKED
        },
        position: pose.position.as_vec3().to_array(),
        orientation: pose.rotation.normalize().as_quat().to_array(),
        velocity: DVec3::from_slice(&person.motion.velocity[Dof::POSITION])
            .as_vec3()
            .to_array(),
        angles: flat_angles(&pose, 1.0, person.turn),
        height: person.build.stature() as f32,
        bone_rotations: bone_rotations(&posed).map(|q| q.as_quat().to_array()),
        ..Body::default()
    };
    let mut sum = 0.0;
    for (j, parent) in PARENTS.into_iter().enumerate() {
        body.joints3d[j] = posed.joints[j].as_vec3().to_array();
        let sure = confidence(j, person.states[j], unseen, person.deviations[j]);
        body.confidence[j] = sure as f32;
        sum += sure;
        body.bone_lengths[j] = posed.joints[j].distance(posed.joints[parent]) as f32;
        body.joint_states[j] = if is_predicted {
            JointState::PREDICTED
        } else {
            person.states[j]
        };
    }
    body.score = (sum / BODY_JOINTS as f64) as f32;
}
