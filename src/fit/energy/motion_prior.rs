//! In: a pose, the one that motion predicts, and rest. Out: how far the pose is from both. The temporal term of XNect
//! §5.2, and what holds that which nothing else determines.

use crate::body::BodyModel;
use crate::body::skeleton::{Dof, Pose, Skeleton};
use crate::joints::DOF;
use crate::solve::NormalEquations;

/// Standard deviation of an angle about rest, radians: only decides what nothing else does.
const REST_SIGMA: f64 = 1.5;

/// What is known of a pose without looking.
#[derive(Debug, Clone)]
pub struct MotionPrior {
    /// The pose that motion alone predicts.
    pub predicted: Pose,
    /// Inverse variance of the difference to `predicted`, 1/m² or 1/rad²; 0: no prediction.
    pub weights: [f64; DOF],
    /// Inverse variance of an angle's distance from rest, 1/rad².
    pub rest: f64,
}

impl MotionPrior {
    /// Near rest, and nothing else: `pose` is where a solve starts.
    pub fn without_prediction(pose: Pose) -> Self {
        Self {
            predicted: pose,
            weights: [0.0; DOF],
            rest: 1.0 / (REST_SIGMA * REST_SIGMA),
        }
    }

    /// Takes this value of angle number `k` for the start, and says no more of what motion predicts of it.
    pub fn free(&mut self, k: usize, angle: f64) {
        self.predicted.angles[k] = angle;
        self.weights[Dof::Angle(k).number()] = 0.0;
    }

    /// Adds a pose's energy to `cost`, term by term.
    pub fn add_cost(&self, pose: &Pose, cost: &mut f64) {
        for angle in pose.angles {
            *cost += self.rest * angle * angle;
        }
        let step = pose.step_from(&self.predicted);
        for (w, d) in self.weights.iter().zip(step) {
            *cost += w * d * d;
        }
    }

    /// Adds gradient and Gauss–Newton matrix at a pose.
    pub fn add_to(&self, skeleton: &Skeleton, pose: &Pose, out: &mut NormalEquations) {
        let rows = skeleton.elimination().rows();
        let step = pose.step_from(&self.predicted);
        for d in 0..DOF {
            let (mut weight, mut pull) = (self.weights[d], self.weights[d] * step[d]);
            if let Dof::Angle(k) = Dof::of(d) {
                weight += self.rest;
                pull += self.rest * pose.angles[k];
            }
            out.add(rows[d], rows[d], weight);
            out.pull(rows[d], pull);
        }
    }
}
