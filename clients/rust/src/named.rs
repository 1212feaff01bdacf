//! In: a body and a name. Out: what stands there; `None` where nothing has that name.

use std::fmt;

use crate::joints::{ANGLE_NAMES, HUMANOID_BONES, JOINT_NAMES};
use crate::message::{Body, JointState};

impl Body {
    /// A joint in camera space, metres.
    pub fn joint(&self, name: &str) -> Option<[f32; 3]> {
        Some(self.joints3d[place(&JOINT_NAMES, name)?])
    }

    /// A joint in the original picture, pixels.
    pub fn joint2d(&self, name: &str) -> Option<[f32; 2]> {
        Some(self.joints2d[place(&JOINT_NAMES, name)?])
    }

    /// Where a joint's position comes from.
    pub fn joint_state(&self, name: &str) -> Option<JointState> {
        Some(self.joint_states[place(&JOINT_NAMES, name)?])
    }

    /// Probability that a joint is within 150 mm of the truth, 0–1.
    pub fn joint_confidence(&self, name: &str) -> Option<f32> {
        Some(self.confidence[place(&JOINT_NAMES, name)?])
    }

    /// One of [`ANGLE_NAMES`], radians; metres for the pelvis' place.
    pub fn angle(&self, name: &str) -> Option<f32> {
        Some(self.angles[place(&ANGLE_NAMES, name)?])
    }

    /// Length of the bone that ends in a joint, metres.
    pub fn bone_length(&self, name: &str) -> Option<f32> {
        Some(self.bone_lengths[place(&JOINT_NAMES, name)?])
    }

    /// Local rotation of one of [`HUMANOID_BONES`], xyzw.
    pub fn bone_rotation(&self, name: &str) -> Option<[f32; 4]> {
        Some(self.bone_rotations[place(&HUMANOID_BONES, name)?])
    }
}

/// Who, how sure and where, in a line.
impl fmt::Display for Body {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [x, y, z] = self.position;
        write!(
            f,
            "#{} {:?}, score {:.2}, pelvis at ({x:.2}, {y:.2}, {z:.2}) m, height {:.2} m",
            self.id, self.state, self.score, self.height
        )
    }
}

fn place(names: &[&str], name: &str) -> Option<usize> {
    names.iter().position(|n| *n == name)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::message::BodyState;

    #[test]
    fn names_lead_to_their_fields() {
        let mut body = Body {
            id: 3,
            state: BodyState::TRACKED,
            score: 0.5,
            position: [0.25, -0.5, 3.0],
            height: 1.75,
            ..Body::default()
        };
        body.joints3d[4] = [1.0, 2.0, 3.0];
        body.joints2d[4] = [1.0, 2.0];
        body.joint_states[4] = JointState::OBSERVED;
        body.confidence[4] = 0.5;
        body.bone_lengths[4] = 0.25;
        body.angles[14] = 1.5;
        body.bone_rotations[5] = [0.0, 1.0, 0.0, 0.0];
        assert_eq!(body.joint("r_wrist"), Some([1.0, 2.0, 3.0]));
        assert_eq!(body.joint2d("r_wrist"), Some([1.0, 2.0]));
        assert_eq!(body.joint_state("r_wrist"), Some(JointState::OBSERVED));
        assert_eq!(body.joint_confidence("r_wrist"), Some(0.5));
        assert_eq!(body.bone_length("r_wrist"), Some(0.25));
        assert_eq!(body.angle("r_elbow_flexion"), Some(1.5));
        assert_eq!(
            body.bone_rotation("rightLowerArm"),
            Some([0.0, 1.0, 0.0, 0.0])
        );
        assert_eq!(body.joint("wrist_r"), None);
        assert_eq!(body.angle("r_elbow"), None);
        assert_eq!(
            body.to_string(),
            "#3 tracked, score 0.50, pelvis at (0.25, -0.50, 3.00) m, height 1.75 m"
        );
    }
}
