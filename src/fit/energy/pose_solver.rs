//! In: an energy of a pose, and a pose to start from. Out: the pose of least energy near by. XNect §5.2; docs/fit.md,
//! Energy.

use crate::body::BodyModel;
use crate::body::skeleton::{BoneLengths, Pose, Posed, Skeleton};
use crate::joints::DOF;
use crate::solve::{Effort, LeastSquares, NormalEquations, Solver};

/// A sum of squared residuals of a pose, each weighed by how exact it is.
pub trait PoseEnergy {
    /// Energy of a pose; `posed` is its forward kinematics.
    fn cost(&self, pose: &Pose, posed: &Posed) -> f64;
    /// Adds half the gradient and the Gauss–Newton matrix at a pose; `posed` is its forward kinematics.
    fn linearise(&self, skeleton: &Skeleton, pose: &Pose, posed: &Posed, out: &mut NormalEquations);
}

/// What is to be minimised.
#[derive(Debug)]
pub struct Problem<'a, E> {
    skeleton: &'a Skeleton,
    lengths: &'a BoneLengths,
    energy: &'a E,
}

impl<'a, E: PoseEnergy> Problem<'a, E> {
    /// The energy of an articulated body with these bones, metres.
    pub fn new(skeleton: &'a Skeleton, lengths: &'a BoneLengths, energy: &'a E) -> Self {
        Self {
            skeleton,
            lengths,
            energy,
        }
    }
}

/// A pose with its forward kinematics.
#[derive(Debug, Clone, Copy)]
pub struct Posture {
    /// The pose.
    pub pose: Pose,
    /// Its forward kinematics.
    pub posed: Posed,
}

impl Default for Posture {
    /// Nowhere yet: the kinematics are not the pose's.
    fn default() -> Self {
        Self {
            pose: Pose::facing_camera(0.0),
            posed: Posed::default(),
        }
    }
}

impl<E: PoseEnergy> LeastSquares for Problem<'_, E> {
    type State = Posture;

    fn envelope(&self) -> &[usize] {
        self.skeleton.elimination().envelope()
    }

    fn cost(&self, at: &Posture) -> f64 {
        self.energy.cost(&at.pose, &at.posed)
    }

    fn linearise(&self, at: &Posture, out: &mut NormalEquations) {
        self.energy
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
    /// Its forward kinematics.
    pub posed: Posed,
    /// Its energy.
    pub cost: f64,
    /// Diagonal of the last Gauss–Newton matrix by degree of freedom: how well each is determined.
    pub information: [f64; DOF],
}

/// A [`Solver`] for poses, with its memory.
#[derive(Debug, Clone, Default)]
pub struct PoseSolver {
    solver: Solver,
    state: Posture,
    spare: Posture,
}

impl PoseSolver {
    /// Minimises the energy from `start`, angles brought within their limits.
    pub fn solve<E: PoseEnergy>(
        &mut self,
        problem: &Problem<'_, E>,
        start: &Pose,
        effort: Effort,
    ) -> Solution {
        let skeleton = problem.skeleton;
        self.state.pose = *start;
        skeleton.clamp(&mut self.state.pose.angles);
        skeleton.pose(&self.state.pose, problem.lengths, &mut self.state.posed);
        let outcome = self
            .solver
            .solve(problem, effort, &mut self.state, &mut self.spare);
        let rows = skeleton.elimination().rows();
        let last = self.solver.last();
        Solution {
            pose: self.state.pose,
            posed: self.state.posed,
            cost: outcome.cost,
            information: std::array::from_fn(|d| last.diagonal(rows[d])),
        }
    }
}

/// Fails where an energy's gradient a little away from `pose` is not that of finite differences.
#[cfg(test)]
pub fn check_gradient(energy: &impl PoseEnergy, pose: &Pose) {
    let s = Skeleton::builtin();
    let step: [f64; DOF] = std::array::from_fn(|d| 0.02 * ((d * 5 % 7) as f64 - 3.0));
    let pose = pose.moved(&step);
    let mut posed = Posed::default();
    s.pose(&pose, s.lengths(), &mut posed);
    let mut l = NormalEquations::default();
    l.reset(s.elimination().envelope());
    energy.linearise(s, &pose, &posed, &mut l);
    for d in 0..DOF {
        let h = 1e-5;
        let at = |by: f64| {
            let mut step = [0.0; DOF];
            step[d] = by;
            let pose = pose.moved(&step);
            let mut posed = Posed::default();
            s.pose(&pose, s.lengths(), &mut posed);
            energy.cost(&pose, &posed)
        };
        let numeric = (at(h) - at(-h)) / (2.0 * h) / 2.0;
        let analytic = l.gradient()[s.elimination().rows()[d]];
        // The prediction term treats the rotation vector as flat: exact only to second order.
        let tolerance = 1e-3 * (1.0 + numeric.abs());
        assert!(
            (numeric - analytic).abs() < tolerance,
            "{d}: {numeric} {analytic}"
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::energy::Targets;
    use crate::fit::energy::targets::exact_targets;
    use crate::joints::{BODY_JOINTS, PELVIS, R_WRIST};

    const EFFORT: Effort = Effort {
        iterations: 60,
        tolerance: 1e-12,
    };

    fn problem(targets: &Targets) -> Problem<'_, Targets> {
        let skeleton = Skeleton::builtin();
        Problem::new(skeleton, skeleton.lengths(), targets)
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
        let posed = PoseSolver::default()
            .solve(&problem(&targets), &start, EFFORT)
            .posed;
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
        let start = Pose::facing_camera(3.0);
        let found = PoseSolver::default().solve(&problem(&targets), &start, EFFORT);
        for (angle, dof) in found.pose.angles.iter().zip(s.angles()) {
            assert!(*angle >= dof.limits[0] && *angle <= dof.limits[1]);
        }
    }

    #[test]
    fn what_nothing_determines_is_left_alone() {
        let s = Skeleton::builtin();
        let start = bent_pose();
        let mut truth = start;
        for &k in s.chain(R_WRIST) {
            truth.angles[k] += 0.2;
        }
        s.clamp(&mut truth.angles);
        // One wrist, relative to the pelvis: no word of where the person is, nor of the other limbs.
        let exact = exact_targets(s, &truth, s.lengths());
        let mut targets = Targets::unseen(start);
        targets.prior.rest = 0.0;
        targets.in_space.points[R_WRIST] = exact.in_space.points[R_WRIST];
        targets.in_space.weights[R_WRIST] = exact.in_space.weights[R_WRIST];
        let found = PoseSolver::default().solve(&problem(&targets), &start, EFFORT);
        let wrist = |p: &Posed| p.joints[R_WRIST] - p.joints[PELVIS];
        let mut before = Posed::default();
        s.pose(&start, s.lengths(), &mut before);
        let [from, left] =
            [&before, &found.posed].map(|p| wrist(p).distance(exact.in_space.points[R_WRIST]));
        assert!(from > 0.1 && left < 1e-3, "{from} m, then {left} m off");
        assert_eq!(found.pose.position, start.position);
        for (k, (now, then)) in found.pose.angles.iter().zip(&start.angles).enumerate() {
            assert!(now == then || s.chain(R_WRIST).contains(&k), "angle {k}");
        }
    }
}
