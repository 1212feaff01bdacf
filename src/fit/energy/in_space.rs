//! In: a pose, and where Stage II has its joints relative to the pelvis. Out: how far they are apart. The term E3D of
//! XNect §5.2.

use glam::DVec3;

use super::quadratic::Quadratic;
use super::robust::{robust_cost, robust_weight};
use crate::body::skeleton::Posed;
use crate::joints::{BODY_JOINTS, PELVIS};

/// Where joints are relative to the pelvis, in the axes that the pose is in.
#[derive(Debug, Clone)]
pub struct InSpace {
    /// The joints, metres.
    pub points: [DVec3; BODY_JOINTS],
    /// Their inverse variance, 1/m²; 0: unknown.
    pub weights: [f64; BODY_JOINTS],
}

impl InSpace {
    /// Where nothing is known of any joint.
    pub fn unknown() -> Self {
        Self {
            points: [DVec3::ZERO; BODY_JOINTS],
            weights: [0.0; BODY_JOINTS],
        }
    }

    /// Energy of a joint; 0 of one that is not known.
    pub fn cost(&self, posed: &Posed, joint: usize) -> f64 {
        let weight = self.weights[joint];
        if weight > 0.0 {
            robust_cost(weight * self.residual(posed, joint).length_squared())
        } else {
            0.0
        }
    }

    /// Adds what is known of a joint's place relative to the pelvis.
    pub fn add_to(&self, posed: &Posed, joint: usize, relative: &mut Quadratic) {
        let weight = self.weights[joint];
        if weight > 0.0 && joint != PELVIS {
            let r = self.residual(posed, joint);
            relative.add_point(weight * robust_weight(weight * r.length_squared()), r);
        }
    }

    fn residual(&self, posed: &Posed, joint: usize) -> DVec3 {
        posed.joints[joint] - posed.joints[PELVIS] - self.points[joint]
    }
}
