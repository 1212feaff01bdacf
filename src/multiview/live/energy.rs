//! The energy of a pose that several views saw: the terms of the fit to one camera, with one E2D a view, in world axes
//! and in metres of the person's own size. XNect §5.2.

use glam::{DMat3, DVec2, DVec3};

use crate::body::BodyModel;
use crate::body::skeleton::{BoneLengths, Pose, Posed, Skeleton};
use crate::fit::{Quadratic, constrain, robust_cost, robust_weight};
use crate::joints::{BODY_JOINTS, DOF, EVIDENCE_JOINTS, PELVIS};
use crate::solve::{Effort, LeastSquares, NormalEquations, Solver};

/// Joints nearer to a camera than this (metres) have no useful projection.
const MIN_DEPTH: f64 = 0.2;

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
        (p.z > MIN_DEPTH).then(|| ((p.truncate() / p.z - self.plane[joint]) * self.depth, p))
    }

    /// How far a joint lies from where it was seen: squared, in standard deviations; 0 where not seen.
    pub fn deviation(&self, posed: &Posed, joint: usize) -> f64 {
        if self.weights[joint] == 0.0 {
            return 0.0;
        }
        self.residual(posed, joint)
            .map_or(0.0, |(r, _)| self.weights[joint] * r.length_squared())
    }
}

/// What one person's pose is fitted to.
#[derive(Debug, Clone)]
pub struct Targets {
    /// One entry a view that saw the person.
    pub views: Vec<ViewTarget>,
    /// Joints relative to the pelvis in world axes, metres, as Stage II of all views tells them.
    pub points3d: [DVec3; BODY_JOINTS],
    /// Inverse variance of `points3d`, 1/m²; 0: unknown.
    pub weights3d: [f64; BODY_JOINTS],
    /// The pose that motion alone predicts.
    pub predicted: Pose,
    /// Inverse variance of the difference to `predicted`; 0: no prediction.
    pub weights_motion: [f64; DOF],
    /// Inverse variance of an angle's distance from rest, 1/rad².
    pub weight_rest: f64,
}

impl Targets {
    fn residual3d(&self, posed: &Posed, joint: usize) -> DVec3 {
        posed.joints[joint] - posed.joints[PELVIS] - self.points3d[joint]
    }

    fn cost(&self, pose: &Pose, posed: &Posed) -> f64 {
        let mut cost = 0.0;
        for joint in 0..EVIDENCE_JOINTS {
            for view in &self.views {
                cost += robust_cost(view.deviation(posed, joint));
            }
        }
        for joint in 0..BODY_JOINTS {
            let w = self.weights3d[joint];
            if w > 0.0 {
                cost += robust_cost(w * self.residual3d(posed, joint).length_squared());
            }
        }
        for angle in pose.angles {
            cost += self.weight_rest * angle * angle;
        }
        let step = pose.step_from(&self.predicted);
        for (w, d) in self.weights_motion.iter().zip(step) {
            cost += w * d * d;
        }
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
                    let Some((r, p)) = view.residual(posed, joint) else {
                        continue;
                    };
                    let w = view.weights[joint];
                    let w = w * robust_weight(w * r.length_squared());
                    let s = view.depth / p.z;
                    let to_world = view.rotation.transpose();
                    let across = to_world * DVec3::new(s, 0.0, -s * p.x / p.z);
                    let down = to_world * DVec3::new(0.0, s, -s * p.y / p.z);
                    space.add_row(w, across, r.x);
                    space.add_row(w, down, r.y);
                }
            }
            let w = self.weights3d[joint];
            if w > 0.0 && joint != PELVIS {
                let r = self.residual3d(posed, joint);
                relative.add_point(w * robust_weight(w * r.length_squared()), r);
            }
            constrain(skeleton, posed, joint, &space, &relative, out);
        }
        let rows = skeleton.elimination().rows();
        let step = pose.step_from(&self.predicted);
        for d in 0..DOF {
            let (mut weight, mut pull) = (self.weights_motion[d], self.weights_motion[d] * step[d]);
            if d >= 6 {
                weight += self.weight_rest;
                pull += self.weight_rest * pose.angles[d - 6];
            }
            out.add(rows[d], rows[d], weight);
            out.pull(rows[d], pull);
        }
    }
}

/// What is to be minimised.
struct Problem<'a> {
    skeleton: &'a Skeleton,
    lengths: &'a BoneLengths,
    targets: &'a Targets,
}

impl LeastSquares for Problem<'_> {
    type State = (Pose, Posed);

    fn envelope(&self) -> &[usize] {
        self.skeleton.elimination().envelope()
    }

    fn cost(&self, (pose, posed): &(Pose, Posed)) -> f64 {
        self.targets.cost(pose, posed)
    }

    fn linearise(&self, (pose, posed): &(Pose, Posed), out: &mut NormalEquations) {
        self.targets.linearise(self.skeleton, pose, posed, out);
    }

    fn step(&self, from: &(Pose, Posed), descent: &[f64], to: &mut (Pose, Posed)) {
        let rows = self.skeleton.elimination().rows();
        to.0 = from.0.moved(&std::array::from_fn(|d| -descent[rows[d]]));
        self.skeleton.clamp(&mut to.0.angles);
        self.skeleton.pose(&to.0, self.lengths, &mut to.1);
    }
}

/// What a solve leaves behind.
#[derive(Debug, Clone, Copy)]
pub struct Solution {
    /// The pose found.
    pub pose: Pose,
    /// Its forward kinematics.
    pub posed: Posed,
    /// Diagonal of the last Gauss–Newton matrix by degree of freedom: how well each is determined.
    pub information: [f64; DOF],
}

/// Minimises the energy from `start`.
pub fn solve(
    solver: &mut Solver,
    lengths: &BoneLengths,
    targets: &Targets,
    start: &Pose,
    effort: Effort,
) -> Solution {
    let skeleton = Skeleton::builtin();
    let mut state = (*start, Posed::default());
    skeleton.clamp(&mut state.0.angles);
    skeleton.pose(&state.0, lengths, &mut state.1);
    let mut spare = state;
    let problem = Problem {
        skeleton,
        lengths,
        targets,
    };
    solver.solve(&problem, effort, &mut state, &mut spare);
    let rows = skeleton.elimination().rows();
    Solution {
        pose: state.0,
        posed: state.1,
        information: std::array::from_fn(|d| solver.last().diagonal(rows[d])),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
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
            points3d: posed.joints.map(|p| p - posed.joints[PELVIS]),
            weights3d: [30.0; BODY_JOINTS],
            predicted: *truth,
            weights_motion: [0.0; DOF],
            weight_rest: 1e-3,
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
        targets.weights_motion = [3.0; DOF];
        let step: [f64; DOF] = std::array::from_fn(|d| 0.02 * ((d * 5 % 7) as f64 - 3.0));
        let pose = truth.moved(&step);
        let mut posed = Posed::default();
        s.pose(&pose, s.lengths(), &mut posed);
        let mut l = NormalEquations::default();
        l.reset(s.elimination().envelope());
        targets.linearise(s, &pose, &posed, &mut l);
        for d in 0..DOF {
            let h = 1e-5;
            let at = |by: f64| {
                let mut step = [0.0; DOF];
                step[d] = by;
                let pose = pose.moved(&step);
                let mut posed = Posed::default();
                s.pose(&pose, s.lengths(), &mut posed);
                targets.cost(&pose, &posed)
            };
            let numeric = (at(h) - at(-h)) / (2.0 * h) / 2.0;
            let analytic = l.gradient()[s.elimination().rows()[d]];
            let tolerance = 1e-3 * (1.0 + numeric.abs());
            assert!(
                (numeric - analytic).abs() < tolerance,
                "{d}: {numeric} {analytic}"
            );
        }
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
        let found = solve(
            &mut Solver::default(),
            s.lengths(),
            &targets,
            &truth.moved(&step),
            effort,
        );
        let mut wanted = Posed::default();
        s.pose(&truth, s.lengths(), &mut wanted);
        for (j, (a, b)) in found.posed.joints.iter().zip(wanted.joints).enumerate() {
            assert!((*a - b).length() < 2e-3, "joint {j}: {}", (*a - b).length());
        }
    }
}
