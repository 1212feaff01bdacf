//! Errors in pictures go in, by how much a joint is told elsewhere than it is comes out, in the person's own axes.
//!
//! A picture shows two of the three axes: over many views and directions least squares finds all of them.

use glam::{DMat3, DVec2, DVec3};

use crate::joints::EVIDENCE_JOINTS;

/// What a picture shows of a person's left, up and forward: rows across and down.
pub type Shown = [DVec3; 2];

/// Normal equations of every joint.
#[derive(Debug, Clone)]
pub struct BiasMeter {
    joints: [(DMat3, DVec3); EVIDENCE_JOINTS],
}

impl Default for BiasMeter {
    fn default() -> Self {
        Self {
            joints: [(DMat3::ZERO, DVec3::ZERO); EVIDENCE_JOINTS],
        }
    }
}

impl BiasMeter {
    /// Takes in one error, metres across and down.
    pub fn add(&mut self, joint: usize, shown: Shown, error: [f64; 2]) {
        let (a, b) = &mut self.joints[joint];
        for (row, e) in shown.into_iter().zip(error) {
            *a += DMat3::from_cols(row * row.x, row * row.y, row * row.z);
            *b += row * e;
        }
    }

    /// Left, up, forward of every joint, metres; 0 where nothing was seen.
    pub fn finish(&self) -> [DVec3; EVIDENCE_JOINTS] {
        self.joints.map(|(a, b)| {
            // A pinch of nothing, for people who were seen from one side only.
            let a = a + DMat3::IDENTITY * (1e-3 * a.x_axis.x.max(a.y_axis.y).max(1.0));
            a.inverse() * b
        })
    }
}

/// What of an error is the bias', metres across and down.
pub fn part(shown: Shown, bias: DVec3) -> DVec2 {
    DVec2::new(shown[0].dot(bias), shown[1].dot(bias))
}
