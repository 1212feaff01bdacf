//! What is drawn of a person: joints, bones, colour, label.

use edgecap_client::joints::{LIMB_JOINTS, PARENTS, PELVIS};
use edgecap_client::message::{Body, BodyState, JointState, Observation};

/// What a body's `joints2d` are of a joint behind the camera, and of all joints where there is no one picture.
const NO_PIXEL: [f32; 2] = [0.0; 2];

/// A joint in the picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Joint {
    /// u, v in pixels, centres on integers.
    pub at: [f32; 2],
    /// Seen in this picture, rather than worked out.
    pub seen: bool,
}

/// One person, ready to be drawn.
#[derive(Debug, Clone, PartialEq)]
pub struct Skeleton {
    /// Decides the colour.
    pub identity: u32,
    /// Digits, `#`, `.`, `?` and `-` have shapes; anything else is a gap.
    pub label: String,
    /// `None`: nothing is known about where the joint is.
    pub joints: Vec<Option<Joint>>,
    /// Pairs of `joints`.
    pub bones: Vec<(usize, usize)>,
}

impl Skeleton {
    /// Where the label goes: above the highest joint.
    pub(super) fn label_at(&self) -> Option<[f32; 2]> {
        self.joints
            .iter()
            .flatten()
            .map(|j| j.at)
            .min_by(|a, b| a[1].total_cmp(&b[1]))
    }
}

/// Someone who can be drawn.
pub trait Person {
    /// What to draw; `position`: the person's place in the message, for those without an identity.
    fn skeleton(&self, position: usize) -> Skeleton;
}

/// A pixel that is a number.
fn joint(at: [f32; 2], seen: bool) -> Option<Joint> {
    at.iter()
        .all(|v| v.is_finite())
        .then_some(Joint { at, seen })
}

impl Person for Observation {
    /// The evidence joints that were seen; the label is the score.
    fn skeleton(&self, position: usize) -> Skeleton {
        Skeleton {
            identity: position as u32,
            label: format!("{:.2}", self.score),
            joints: self
                .joints2d
                .iter()
                .map(|&[u, v, confidence]| {
                    (confidence > 0.0).then(|| joint([u, v], true)).flatten()
                })
                .collect(),
            bones: LIMB_JOINTS.to_vec(),
        }
    }
}

impl Person for Body {
    /// All joints of the fitted skeleton; the label is the identity and the score, with `?` while the person is out of
    /// sight.
    fn skeleton(&self, _position: usize) -> Skeleton {
        let lost = if self.state == BodyState::PREDICTED {
            "?"
        } else {
            ""
        };
        Skeleton {
            identity: self.id,
            label: format!("#{}{lost} {:.2}", self.id, self.score),
            joints: (0..self.joints2d.len())
                .map(|j| {
                    // `joints3d` do not tell: with a calibration they are in its axes, not in the camera's.
                    let has_pixel = self.joints2d[j] != NO_PIXEL;
                    let seen = self.joint_states[j] == JointState::OBSERVED;
                    has_pixel.then(|| joint(self.joints2d[j], seen)).flatten()
                })
                .collect(),
            bones: (0..PARENTS.len())
                .filter(|j| *j != PELVIS)
                .map(|j| (j, PARENTS[j]))
                .collect(),
        }
    }
}
