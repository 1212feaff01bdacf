//! In: what a pose is fitted to. Out: the pose, from nothing, or with limbs freed that are stuck in a wrong one.

use super::{Context, Track, best_branch};
use crate::body::skeleton::{BoneLengths, Dof, LIMBS, Pose};
use crate::fit::energy::{Problem, Solution, Targets};
use crate::joints::EVIDENCE_JOINTS;
use crate::solve::Effort;

/// Energy of a limb (two joints) above which another pose for it is tried.
const LIMB_STUCK: f64 = 14.0;

/// XNect's order for a first frame: angles from 3D, then everything.
pub(super) fn cold_solve(
    targets: &mut Targets,
    start: &Pose,
    lengths: &BoneLengths,
    cx: &mut Context<'_>,
) -> Solution {
    let weights2d = std::mem::replace(&mut targets.weights2d, [0.0; EVIDENCE_JOINTS]);
    let problem = Problem::new(cx.skeleton, lengths, targets);
    let first = cx.solver.solve(&problem, start, Effort::COLD);
    targets.weights2d = weights2d;
    let problem = Problem::new(cx.skeleton, lengths, targets);
    cx.solver.solve(&problem, &first.pose, Effort::COLD)
}

impl Track {
    /// Tries the closed form on limbs whose joints lie far from what is seen, and keeps what lowers the energy clearly.
    pub(super) fn free_limbs(
        &mut self,
        targets: &mut Targets,
        solution: &mut Solution,
        lengths: &BoneLengths,
        cx: &mut Context<'_>,
    ) {
        for limb in LIMBS {
            let strain = targets.joint_cost(&solution.posed, limb.middle)
                + targets.joint_cost(&solution.posed, limb.end);
            if strain < LIMB_STUCK {
                continue;
            }
            let Some(angles) = best_branch(
                cx.skeleton,
                limb,
                &solution.posed,
                &targets.in_space.points,
                &solution.pose.angles,
            ) else {
                continue;
            };
            let mut trial = targets.clone();
            let mut start = solution.pose;
            for (k, angle) in limb.angles(cx.skeleton).into_iter().zip(angles) {
                start.angles[k] = angle;
                trial.prior.free(k, angle);
            }
            let problem = Problem::new(cx.skeleton, lengths, &trial);
            let found = cx.solver.solve(&problem, &start, Effort::WARM);
            if found.cost < solution.cost - 0.4 * strain {
                for k in limb.angles(cx.skeleton) {
                    trial.prior.predicted.angles[k] = found.pose.angles[k];
                    self.motion.restart(Dof::Angle(k));
                }
                *targets = trial;
                *solution = found;
            }
        }
    }
}
