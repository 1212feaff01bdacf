//! The energy of a pose that several views saw: the terms of the fit to one camera, with one E2D a view, in world axes
//! and in metres of the person's own size. XNect §5.2.

use glam::{DMat3, DVec2, DVec3};

use crate::body::skeleton::{Pose, Posed, Skeleton};
use crate::fit::{
    InSpace, MotionPrior, PoseEnergy, Quadratic, constrain, reprojection, robust_cost,
    robust_weight,
};
use crate::joints::{BODY_JOINTS, EVIDENCE_JOINTS};
use crate::solve::NormalEquations;

/// What one view saw of a person.
#[derive(Debug, Clone)]
pub struct ViewTarget {
    /// World axes to camera axes.
    pub rotation: DMat3,
    /// Where the camera stands.
    pub position: DVec3,
    /// Evidence joints on the plane z = 1, the lens undone.
    pub plane: [DVec2; EVIDENCE_JOINTS],
    /// Inverse variance of `plane` after scaling by `depth`, 1/m²; 0: not seen.
    pub weights: [f64; EVIDENCE_JOINTS],
    /// Distance that turns errors on the plane z = 1 into metres.
    pub depth: f64,
}

impl ViewTarget {
    /// Residual in metres at the person's distance, and the joint in camera axes; `None` where there is no projection.
    fn residual(&self, posed: &Posed, joint: usize) -> Option<(DVec2, DVec3)> {
        let p = self.rotation * (posed.joints[joint] - self.position);
        let r = reprojection::residual(p, self.plane[joint], self.depth)?;
        Some((r, p))
    }

    /// How far a joint lies from where it was seen: squared, in standard deviations; 0 where not seen.
    pub fn deviation(&self, posed: &Posed, joint: usize) -> f64 {
        if self.weights[joint] == 0.0 {
            return 0.0;
        }
        self.residual(posed, joint)
            .map_or(0.0, |(r, _)| self.weights[joint] * r.length_squared())
    }

    /// Adds what the view says of a joint's place in the world.
    fn add_to(&self, posed: &Posed, joint: usize, space: &mut Quadratic) {
        let Some((r, p)) = self.residual(posed, joint) else {
            return;
        };
        let w = self.weights[joint];
        let w = w * robust_weight(w * r.length_squared());
        let to_world = self.rotation.transpose();
        let [across, down] = reprojection::rows(p, self.depth).map(|row| to_world * row);
        space.add_row(w, across, r.x);
        space.add_row(w, down, r.y);
    }
}

/// What one person's pose is fitted to.
#[derive(Debug, Clone)]
pub struct Targets {
    /// One entry a view that saw the person.
    pub views: Vec<ViewTarget>,
    /// Where Stage II of all views has joints, world axes.
    pub in_space: InSpace,
    /// What motion predicts.
    pub prior: MotionPrior,
}

impl PoseEnergy for Targets {
    fn cost(&self, pose: &Pose, posed: &Posed) -> f64 {
        let mut cost = 0.0;
        for joint in 0..EVIDENCE_JOINTS {
            for view in &self.views {
                cost += robust_cost(view.deviation(posed, joint));
            }
        }
        for joint in 0..BODY_JOINTS {
            cost += self.in_space.cost(posed, joint);
        }
        self.prior.add_cost(pose, &mut cost);
        cost
    }

    fn linearise(
        &self,
        skeleton: &Skeleton,
        pose: &Pose,
        posed: &Posed,
        out: &mut NormalEquations,
    ) {
        for joint in 0..BODY_JOINTS {
            let (mut space, mut relative) = (Quadratic::default(), Quadratic::default());
            if joint < EVIDENCE_JOINTS {
                for view in self.views.iter().filter(|v| v.weights[joint] > 0.0) {
                    view.add_to(posed, joint, &mut space);
                }
            }
            self.in_space.add_to(posed, joint, &mut relative);
            constrain(skeleton, posed, joint, &space, &relative, out);
        }
        self.prior.add_to(skeleton, pose, out);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::BodyModel;
    use crate::fit::{PoseSolver, Problem, check_gradient};
    use crate::joints::{DOF, PELVIS};
    use crate::solve::Effort;
    use glam::DQuat;

    /// Two views of a standing person, from the front and from the side; the world's y points up.
    fn targets(skeleton: &Skeleton, truth: &Pose) -> Targets {
        let mut posed = Posed::default();
        skeleton.pose(truth, skeleton.lengths(), &mut posed);
        let views = [0.0, 1.4_f64].map(|a| {
            let position = DVec3::new(4.0 * a.sin(), 1.2, 4.0 * a.cos());
            let z = -DVec3::new(a.sin(), 0.0, a.cos());
            let y = -DVec3::Y;
            let rotation = DMat3::from_cols(y.cross(z), y, z).transpose();
            let seen = |j: usize| rotation * (posed.joints[j] - position);
            ViewTarget {
                rotation,
                position,
                plane: std::array::from_fn(|j| seen(j).truncate() / seen(j).z),
                weights: [400.0; EVIDENCE_JOINTS],
                depth: 4.0,
            }
        });
        Targets {
            views: views.to_vec(),
            in_space: InSpace {
                points: posed.joints.map(|p| p - posed.joints[PELVIS]),
                weights: [30.0; BODY_JOINTS],
            },
            prior: MotionPrior {
                rest: 1e-3,
                ..MotionPrior::without_prediction(*truth)
            },
        }
    }

    fn standing() -> Pose {
        let mut pose = Skeleton::builtin().rest_pose();
        pose.position = DVec3::new(0.1, 1.0, -0.2);
        pose.rotation = DQuat::from_rotation_y(0.4);
        for (k, angle) in pose.angles.iter_mut().enumerate() {
            *angle = 0.3 * ((k * 7 % 5) as f64 - 2.0);
        }
        Skeleton::builtin().clamp(&mut pose.angles);
        pose
    }

    #[test]
    fn gradient_matches_finite_differences() {
        let s = Skeleton::builtin();
        let truth = standing();
        let mut targets = targets(s, &truth);
        targets.prior.weights = [3.0; DOF];
        check_gradient(&targets, &truth);
    }

    #[test]
    fn two_exact_views_give_the_exact_pose() {
        let s = Skeleton::builtin();
        let truth = standing();
        let targets = targets(s, &truth);
        let step: [f64; DOF] = std::array::from_fn(|d| 0.1 * ((d * 5 % 7) as f64 - 3.0) / 3.0);
        let effort = Effort {
            iterations: 60,
            tolerance: 1e-12,
        };
        let problem = Problem::new(s, s.lengths(), &targets);
        let found = PoseSolver::default().solve(&problem, &truth.moved(&step), effort);
        let mut wanted = Posed::default();
        s.pose(&truth, s.lengths(), &mut wanted);
        for (j, (a, b)) in found.posed.joints.iter().zip(wanted.joints).enumerate() {
            assert!((*a - b).length() < 2e-3, "joint {j}: {}", (*a - b).length());
        }
    }
}
