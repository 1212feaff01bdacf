//! In: [`Targets`] and a starting pose. Out: the pose of least energy near by. Levenberg–Marquardt, 29 unknowns. SPEC §5.

use super::energy::{Linearised, Targets};
use super::skeleton::{ANGLES, BoneLengths, Pose, Posed, Skeleton};
use crate::joints::DOF;

/// First column that can be non-zero in each row of [`Linearised::matrix`]: limbs only meet in trunk and root.
const FIRST: [usize; DOF] = first_columns();

const fn first_columns() -> [usize; DOF] {
    // Rows count from the last angle down: left leg, right leg, left arm, right arm, neck, spine, root.
    let starts = [
        (5, 0),
        (10, 5),
        (14, 10),
        (18, 14),
        (20, 18),
        (23, 10),
        (29, 0),
    ];
    let mut first = [0; DOF];
    let (mut row, mut group) = (0, 0);
    while row < DOF {
        if row == starts[group].0 {
            group += 1;
        }
        first[row] = starts[group].1;
        row += 1;
    }
    first
}

/// What is to be minimised.
#[derive(Debug, Clone, Copy)]
pub struct Problem<'a> {
    /// The articulated body.
    pub skeleton: &'a Skeleton,
    /// The person's bones.
    pub lengths: &'a BoneLengths,
    /// What was seen and predicted.
    pub targets: &'a Targets,
    /// Farthest an angle may end beyond its limits, radians.
    pub slack: f64,
}

/// When to stop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Effort {
    /// Most linearisations.
    pub iterations: u32,
    /// Stop when a step lowers the energy by less than this fraction.
    pub tolerance: f64,
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
    /// Linearisations used.
    pub iterations: u32,
}

/// Reusable working memory of the solver.
#[derive(Debug, Clone, Default)]
pub struct Solver {
    linearised: Linearised,
    factor: Linearised,
    trial: Posed,
}

impl Solver {
    /// Minimises the energy from `start`. `posed` returns the forward kinematics of the result.
    pub fn solve(
        &mut self,
        problem: &Problem<'_>,
        start: &Pose,
        effort: Effort,
        posed: &mut Posed,
    ) -> Solution {
        let Problem {
            skeleton,
            lengths,
            targets,
            slack,
        } = *problem;
        let mut pose = *start;
        clamp_angles(skeleton, &mut pose.angles, slack);
        skeleton.pose(&pose, lengths, posed);
        let mut cost = targets.cost(skeleton, &pose, posed);
        let mut damping = 1e-3;
        let mut iterations = 0;
        let mut information = [0.0; DOF];
        'outer: while iterations < effort.iterations {
            iterations += 1;
            targets.linearise(skeleton, &pose, posed, &mut self.linearised);
            for (d, info) in information.iter_mut().enumerate() {
                let i = Linearised::row(d);
                *info = self.linearised.matrix[i][i];
            }
            loop {
                self.factor.clone_from(&self.linearised);
                for i in 0..DOF {
                    let diagonal = &mut self.factor.matrix[i][i];
                    *diagonal += damping * *diagonal + 1e-6;
                }
                if factorise(&mut self.factor.matrix) {
                    substitute(&self.factor.matrix, &mut self.factor.gradient);
                    let step = std::array::from_fn(|d| -self.factor.gradient[Linearised::row(d)]);
                    let mut trial = pose.moved(&step);
                    clamp_angles(skeleton, &mut trial.angles, slack);
                    skeleton.pose(&trial, lengths, &mut self.trial);
                    let trial_cost = targets.cost(skeleton, &trial, &self.trial);
                    // False for NaN as well: a bad step is never taken.
                    if trial_cost < cost {
                        let gain = (cost - trial_cost) / cost;
                        pose = trial;
                        std::mem::swap(posed, &mut self.trial);
                        cost = trial_cost;
                        damping = (damping * 0.1).max(1e-7);
                        if gain < effort.tolerance {
                            break 'outer;
                        }
                        break;
                    }
                }
                damping *= 10.0;
                if damping.is_nan() || damping >= 1e5 {
                    break 'outer;
                }
            }
        }
        Solution {
            pose,
            cost,
            information,
            iterations,
        }
    }
}

fn clamp_angles(skeleton: &Skeleton, angles: &mut [f64; ANGLES], slack: f64) {
    for (angle, dof) in angles.iter_mut().zip(skeleton.angles()) {
        *angle = angle.clamp(dof.limits[0] - slack, dof.limits[1] + slack);
    }
}

/// Cholesky factor in place of the lower triangle, skipping the known zeros. False unless positive definite.
fn factorise(a: &mut [[f64; DOF]; DOF]) -> bool {
    for i in 0..DOF {
        let (above, rest) = a.split_at_mut(i);
        let row = &mut rest[0];
        for j in FIRST[i]..i {
            let from = FIRST[i].max(FIRST[j]);
            let dot: f64 = (from..j).map(|k| row[k] * above[j][k]).sum();
            row[j] = (row[j] - dot) / above[j][j];
        }
        let square: f64 = row[FIRST[i]..i].iter().map(|v| v * v).sum();
        let pivot = row[i] - square;
        if !(pivot > 0.0 && pivot.is_finite()) {
            return false;
        }
        row[i] = pivot.sqrt();
    }
    true
}

/// Solves with the factor of [`factorise`], in place.
fn substitute(factor: &[[f64; DOF]; DOF], x: &mut [f64; DOF]) {
    for i in 0..DOF {
        let dot: f64 = (FIRST[i]..i).map(|k| factor[i][k] * x[k]).sum();
        x[i] = (x[i] - dot) / factor[i][i];
    }
    for i in (0..DOF).rev() {
        x[i] /= factor[i][i];
        let value = x[i];
        for k in FIRST[i]..i {
            x[k] -= factor[i][k] * value;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::energy::exact_targets;
    use nalgebra::{SMatrix, SVector};

    const EFFORT: Effort = Effort {
        iterations: 60,
        tolerance: 1e-12,
    };

    fn problem(targets: &Targets, slack: f64) -> Problem<'_> {
        let skeleton = Skeleton::builtin();
        Problem {
            skeleton,
            lengths: skeleton.lengths(),
            targets,
            slack,
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
    fn the_skipped_zeros_are_zeros() {
        let s = Skeleton::builtin();
        let pose = bent_pose();
        let targets = exact_targets(s, &pose, s.lengths());
        let mut posed = Posed::default();
        s.pose(&pose, s.lengths(), &mut posed);
        let mut l = Linearised::default();
        targets.linearise(s, &pose, &posed, &mut l);
        for i in 0..DOF {
            for j in 0..FIRST[i] {
                assert_eq!(l.matrix[i][j], 0.0, "row {i} column {j}");
            }
            for j in i + 1..DOF {
                assert_eq!(l.matrix[i][j], 0.0, "upper triangle {i} {j}");
            }
        }
    }

    #[test]
    fn linear_solution_matches_nalgebra() {
        let s = Skeleton::builtin();
        let pose = bent_pose();
        let mut targets = exact_targets(s, &pose, s.lengths());
        targets.weights_motion = [1.0; DOF];
        let mut posed = Posed::default();
        s.pose(&pose, s.lengths(), &mut posed);
        let mut l = Linearised::default();
        targets.linearise(s, &pose, &posed, &mut l);
        let b: [f64; DOF] = std::array::from_fn(|i| (i as f64 * 0.7).sin());
        let full = SMatrix::<f64, DOF, DOF>::from_fn(|i, j| l.matrix[i.max(j)][i.min(j)]);
        let expected = full
            .cholesky()
            .unwrap()
            .solve(&SVector::<f64, DOF>::from(b));
        let mut x = b;
        assert!(factorise(&mut l.matrix));
        substitute(&l.matrix, &mut x);
        for i in 0..DOF {
            assert!((x[i] - expected[i]).abs() < 1e-9 * expected.amax(), "{i}");
        }
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
        let found = Solver::default().solve(&problem(&targets, 0.05), &start, EFFORT, &mut posed);
        let mut wanted = Posed::default();
        s.pose(&truth, s.lengths(), &mut wanted);
        for j in 0..21 {
            let error = (posed.joints[j] - wanted.joints[j]).length();
            assert!(
                error < 1e-3,
                "joint {j}: {error} after {} steps",
                found.iterations
            );
        }
    }

    #[test]
    fn angles_stay_near_their_limits() {
        let s = Skeleton::builtin();
        let mut truth = Pose::facing_camera(3.0);
        let elbow = s
            .angles()
            .iter()
            .position(|a| a.name == "l_elbow_flexion")
            .unwrap();
        truth.angles[elbow] = -0.8;
        let mut targets = exact_targets(s, &truth, s.lengths());
        targets.weight_limit = 0.0;
        let mut posed = Posed::default();
        let start = Pose::facing_camera(3.0);
        let slack = 3f64.to_radians();
        let found = Solver::default().solve(&problem(&targets, slack), &start, EFFORT, &mut posed);
        for (angle, dof) in found.pose.angles.iter().zip(s.angles()) {
            assert!(
                *angle >= dof.limits[0] - slack - 1e-12 && *angle <= dof.limits[1] + slack + 1e-12
            );
        }
    }

    #[test]
    fn nothing_known_leaves_the_pose_alone() {
        let start = bent_pose();
        let targets = crate::fit::energy::no_targets(start);
        let mut posed = Posed::default();
        let found = Solver::default().solve(&problem(&targets, 0.0), &start, EFFORT, &mut posed);
        assert!(found.pose.is_finite());
        assert!((found.pose.position - start.position).length() < 1e-9);
    }
}
