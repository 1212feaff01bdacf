//! One person's bodies, frame by frame.

use super::fitted::Fitted;
use super::moment::Moment;
#[cfg(test)]
use crate::body::mesh::MeshBody;

/// One frame of one person.
#[derive(Debug, Clone)]
pub struct PersonFrame {
    /// Which frame.
    pub frame: usize,
    /// The body.
    pub body: Fitted,
    /// What views saw, exchanged limbs healed.
    pub moment: Moment,
}

#[cfg(test)]
impl PersonFrame {
    /// A body of the mean shape that no view saw.
    pub(crate) fn unseen(frame: usize, pose: crate::body::mesh::MeshPose) -> Self {
        Self {
            frame,
            body: Fitted::new(MeshBody::shipped(), pose, &[0.0; 10]),
            moment: Moment {
                sights: Vec::new(),
                joints: [None; crate::joints::EVIDENCE_JOINTS],
                healed: 0,
                lifted: None,
                contours: Vec::new(),
            },
        }
    }
}

/// One person over time.
#[derive(Debug, Clone)]
pub struct PersonFit {
    /// Identity, from 1.
    pub id: u32,
    /// Shape coefficients.
    pub betas: Vec<f64>,
    /// Rising frames.
    pub frames: Vec<PersonFrame>,
}
