//! In: [`Targets`] and a starting pose. Out: the pose of least energy near by. XNect §5.2; docs/fit.md, Energy.

use super::Targets;
use crate::body::BodyModel;
use crate::body::skeleton::{BoneLengths, Pose, Posed, Skeleton};
use crate::joints::DOF;
use crate::solve::{Effort, LeastSquares, NormalEquations, Solver};

/// What is to be minimised.
#[derive(Debug, Clone, Copy)]
pub struct Problem<'a> {
    /// The articulated body.
    pub skeleton: &'a Skeleton,
    /// The person's bones.
    pub lengths: &'a BoneLengths,
    /// What was seen and predicted.
    pub targets: &'a Targets,
}

/// A pose with its forward kinematics.
#[derive(Debug, Clone, Copy)]
pub struct Posture {
    pose: Pose,
    posed: Posed,
}

impl LeastSquares for Problem<'_> {
    type State = Posture;

    fn envelope(&self) -> &[usize] {
        self.skeleton.elimination().envelope()
    }

    fn cost(&self, at: &Posture) -> f64 {
        self.targets.cost(&at.pose, &at.posed)
    }

    fn linearise(&self, at: &Posture, out: &mut NormalEquations) {
        self.targets
            .linearise(self.skeleton, &at.pose, &at.posed, out);
    }

    fn step(&self, from: &Posture, descent: &[f64], to: &mut Posture) {
        let rows = self.skeleton.elimination().rows();
        let step = std::array::from_fn(|d| -descent[rows[d]]);
        to.pose = from.pose.moved(&step);
        self.skeleton.clamp(&mut to.pose.angles);
        self.skeleton.pose(&to.pose, self.lengths, &mut to.posed);
    }
}

/// What a solve leaves behind.
#[derive(Debug, Clone, Copy)]
pub struct Solution {
    /// The pose found.
    pub pose: Pose,
    /// Its energy.
    pub cost: f64,
    /// Diagonal of the last Gauss–Newton matrix by degree of freedom: how well each is determined.
    pub information: [f64; DOF],
}

/// A [`Solver`] for poses, with its memory.
#[derive(Debug, Clone)]
pub struct PoseSolver {
    solver: Solver,
    state: Posture,
    spare: Posture,
}

impl Default for PoseSolver {
    fn default() -> Self {
        let nowhere = Posture {
            pose: Pose::facing_camera(0.0),
            posed: Posed::default(),
        };
        Self {
            solver: Solver::default(),
            state: nowhere,
            spare: nowhere,
        }
    }
}

impl PoseSolver {
    /// Minimises the energy from `start`. `posed` returns the forward kinematics of the result.
    pub fn solve(
        &mut self,
        problem: &Problem<'_>,
        start: &Pose,
        effort: Effort,
        posed: &mut Posed,
    ) -> Solution {
        let skeleton = problem.skeleton;
        self.state.pose = *start;
        skeleton.clamp(&mut self.state.pose.angles);
        skeleton.pose(&self.state.pose, problem.lengths, &mut self.state.posed);
        let outcome = self
            .solver
            .solve(problem, effort, &mut self.state, &mut self.spare);
        *posed = self.state.posed;
        let rows = skeleton.elimination().rows();
        let last = self.solver.last();
        Solution {
            pose: self.state.pose,
            cost: outcome.cost,
            information: std::array::from_fn(|d| last.diagonal(rows[d])),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::energy::targets::{exact_targets, no_targets};
    use crate::joints::{BODY_JOINTS, PELVIS};

    const EFFORT: Effort = Effort {
        iterations: 60,
        tolerance: 1e-12,
    };

    fn problem(targets: &Targets) -> Problem<'_> {
        let skeleton = Skeleton::builtin();
        Problem {
            skeleton,
            lengths: skeleton.lengths(),
            targets,
        }
    }

    fn bent_pose() -> Pose {
        let mut pose = Pose::facing_camera(3.0);
        for (k, angle) in pose.angles.iter_mut().enumerate() {
            let limits = Skeleton::builtin().angles()[k].limits;
            *angle = limits[0] + (limits[1] - limits[0]) * (0.3 + 0.05 * (k % 7) as f64);
        }
        pose
    }

    #[test]
    fn what_lies_outside_the_envelope_never_meets() {
        // Legs, arms, neck hang on the trunk, which hangs on the root: nothing is added outside, or this would panic.
        let s = Skeleton::builtin();
        let entries: usize = s
            .elimination()
            .envelope()
            .iter()
            .enumerate()
            .map(|(i, f)| i + 1 - f)
            .sum();
        assert!(entries < DOF * (DOF + 1) / 2 * 2 / 3, "{entries}");
        let pose = bent_pose();
        let targets = exact_targets(s, &pose, s.lengths());
        let mut posed = Posed::default();
        s.pose(&pose, s.lengths(), &mut posed);
        let mut equations = NormalEquations::default();
        equations.reset(s.elimination().envelope());
        targets.linearise(s, &pose, &posed, &mut equations);
        assert!(equations.factorise());
    }

    #[test]
    fn exact_observations_give_the_exact_pose() {
        let s = Skeleton::builtin();
        let truth = bent_pose();
        let targets = exact_targets(s, &truth, s.lengths());
        let mut start = truth;
        start.position.z += 0.4;
        start.position.x -= 0.2;
        for (k, angle) in start.angles.iter_mut().enumerate() {
            *angle += 0.2 * ((k % 3) as f64 - 1.0);
        }
        let mut posed = Posed::default();
        PoseSolver::default().solve(&problem(&targets), &start, EFFORT, &mut posed);
        let mut wanted = Posed::default();
        s.pose(&truth, s.lengths(), &mut wanted);
        for j in 0..BODY_JOINTS {
            let error = (posed.joints[j] - wanted.joints[j]).length();
            assert!(error < 1e-3, "joint {j}: {error}");
        }
    }

    #[test]
    fn angles_stay_within_their_limits() {
        let s = Skeleton::builtin();
        let mut truth = Pose::facing_camera(3.0);
        let elbow = s
            .angles()
            .iter()
            .position(|a| a.name == "l_elbow_flexion")
            .unwrap();
        truth.angles[elbow] = -0.8;
        let targets = exact_targets(s, &truth, s.lengths());
        let mut posed = Posed::default();
        let start = Pose::facing_camera(3.0);
        let found = PoseSolver::default().solve(&problem(&targets), &start, EFFORT, &mut posed);
        for (angle, dof) in found.pose.angles.iter().zip(s.angles()) {
            assert!(*angle >= dof.limits[0] && *angle <= dof.limits[1]);
        }
    }

    #[test]
    fn what_nothing_determines_is_left_alone() {
        const WRIST: usize = 4;
        let s = Skeleton::builtin();
        let start = bent_pose();
        let mut truth = start;
        for &k in s.chain(WRIST) {
            truth.angles[k] += 0.2;
        }
        s.clamp(&mut truth.angles);
        // One wrist, relative to the pelvis: no word of where the person is, nor of the other limbs.
        let exact = exact_targets(s, &truth, s.lengths());
        let mut targets = no_targets(start);
        targets.points3d[WRIST] = exact.points3d[WRIST];
        targets.weights3d[WRIST] = exact.weights3d[WRIST];
        let mut posed = Posed::default();
        let found = PoseSolver::default().solve(&problem(&targets), &start, EFFORT, &mut posed);
        let wrist = |p: &Posed| p.joints[WRIST] - p.joints[PELVIS];
        let mut before = Posed::default();
        s.pose(&start, s.lengths(), &mut before);
        let [from, left] = [&before, &posed].map(|p| wrist(p).distance(targets.points3d[WRIST]));
        assert!(from > 0.1 && left < 1e-3, "{from} m, then {left} m off");
        assert_eq!(found.pose.position, start.position);
        for (k, (now, then)) in found.pose.angles.iter().zip(&start.angles).enumerate() {
            assert!(now == then || s.chain(WRIST).contains(&k), "angle {k}");
        }
    }
}
