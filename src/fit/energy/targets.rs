//! In: what one camera saw of a person, what motion predicts, and a pose. Out: the energy of the pose, its gradient and
//! its Gauss–Newton matrix. XNect §5.2.
//!
//! Everything is in the space of a person of canonical stature. Each term is a sum of squared residuals divided by the
//! variance its residual is expected to have, so that energies of different units add up and weights are plain factors:
//! E3D in metres relative to the pelvis; E2D in metres at the person's distance (pixel error · depth / focal length);
//! Etemp in metres and radians away from the predicted motion; the contact term in metres between an ankle and the
//! place where it stands, those along the ray from the camera counting less than those across it.
//!
//! What several cameras saw `multiview/live/energy.rs` sums up, of the same terms.

use glam::DVec2;

use super::contact::Contact;
use super::in_space::InSpace;
use super::motion_prior::MotionPrior;
use super::pose_solver::PoseEnergy;
use super::quadratic::{Quadratic, constrain};
use super::reprojection::{MIN_DEPTH, residual};
use super::robust::{robust_cost, robust_weight};
use crate::body::skeleton::{Pose, Posed, Skeleton};
use crate::joints::{BODY_JOINTS, EVIDENCE_JOINTS};
use crate::solve::NormalEquations;

/// What one person's pose is fitted to.
#[derive(Debug, Clone)]
pub struct Targets {
    /// Where Stage II has joints, camera axes.
    pub in_space: InSpace,
    /// Evidence joints on the plane z = 1: ((u − cx)/fx, (v − cy)/fy).
    pub points2d: [DVec2; EVIDENCE_JOINTS],
    /// Inverse variance of `points2d` after scaling by `depth`, 1/m²; 0: not seen.
    pub weights2d: [f64; EVIDENCE_JOINTS],
    /// Distance that turns errors on the plane z = 1 into metres.
    pub depth: f64,
    /// What motion predicts.
    pub prior: MotionPrior,
    /// Standing feet.
    pub contacts: [Option<Contact>; 2],
}

impl Targets {
    /// Of somebody of whom nothing was seen and nothing is predicted; `pose` is where a solve starts.
    pub fn unseen(pose: Pose) -> Self {
        Self {
            in_space: InSpace::unknown(),
            points2d: [DVec2::ZERO; EVIDENCE_JOINTS],
            weights2d: [0.0; EVIDENCE_JOINTS],
            depth: pose.position.z.max(MIN_DEPTH),
            prior: MotionPrior::without_prediction(pose),
            contacts: [None; 2],
        }
    }

    /// Residual of a 2D point in metres at the person's distance; `None` where there is no projection.
    fn residual2d(&self, posed: &Posed, joint: usize) -> Option<DVec2> {
        residual(posed.joints[joint], self.points2d[joint], self.depth)
    }

    /// How far an evidence joint's observation lies from the pose: squared, in standard deviations; 0 where not seen,
    /// `None` where the pose has no projection of it.
    pub fn deviation2d(&self, posed: &Posed, joint: usize) -> Option<f64> {
        let residual = self.residual2d(posed, joint)?;
        Some(residual.length_squared() * self.weights2d[joint])
    }

    /// Energy of what was seen of one joint.
    pub fn joint_cost(&self, posed: &Posed, joint: usize) -> f64 {
        let mut cost = self.in_space.cost(posed, joint);
        if joint < EVIDENCE_JOINTS
            && self.weights2d[joint] > 0.0
            && let Some(deviation) = self.deviation2d(posed, joint)
        {
            cost += robust_cost(deviation);
        }
        cost
    }

    /// Adds everything that is known about one joint's place.
    fn add_joint(
        &self,
        skeleton: &Skeleton,
        posed: &Posed,
        joint: usize,
        out: &mut NormalEquations,
    ) {
        let mut space = Quadratic::default();
        let mut relative = Quadratic::default();
        self.in_space.add_to(posed, joint, &mut relative);
        if joint < EVIDENCE_JOINTS
            && self.weights2d[joint] > 0.0
            && let Some(r) = self.residual2d(posed, joint)
        {
            let w = self.weights2d[joint];
            let w = w * robust_weight(w * r.length_squared());
            space.add_projection(w, r, posed.joints[joint], self.depth);
        }
        for contact in self.contacts.iter().flatten().filter(|c| c.joint == joint) {
            contact.add_to(posed.joints[joint], &mut space);
        }
        constrain(skeleton, posed, joint, &space, &relative, out);
    }
}

impl PoseEnergy for Targets {
    fn cost(&self, pose: &Pose, posed: &Posed) -> f64 {
        let mut cost = 0.0;
        for joint in 0..BODY_JOINTS {
            cost += self.joint_cost(posed, joint);
        }
        for contact in self.contacts.iter().flatten() {
            cost += robust_cost(contact.deviation(posed.joints[contact.joint]));
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
            self.add_joint(skeleton, posed, joint, out);
        }
        self.prior.add_to(skeleton, pose, out);
    }
}

/// Targets that a person in `truth` would yield without noise, rest counting for nothing: for tests of the energy and
/// the solver.
#[cfg(test)]
pub fn exact_targets(
    skeleton: &Skeleton,
    truth: &Pose,
    lengths: &crate::body::skeleton::BoneLengths,
) -> Targets {
    let mut posed = Posed::default();
    skeleton.pose(truth, lengths, &mut posed);
    let mut targets = Targets::unseen(*truth);
    targets.prior.rest = 0.0;
    for j in 0..BODY_JOINTS {
        targets.in_space.points[j] = posed.joints[j] - posed.joints[crate::joints::PELVIS];
        targets.in_space.weights[j] = 400.0;
    }
    for j in 0..EVIDENCE_JOINTS {
        targets.points2d[j] = posed.joints[j].truncate() / posed.joints[j].z;
        targets.weights2d[j] = 400.0;
    }
    targets
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::fit::energy::check_gradient;
    use crate::joints::{DOF, R_ANKLE};

    #[test]
    fn gradient_matches_finite_differences() {
        let s = Skeleton::builtin();
        let mut truth = Pose::facing_camera(3.0);
        for (k, angle) in truth.angles.iter_mut().enumerate() {
            *angle = 0.3 * ((k * 7 % 5) as f64 - 2.0);
        }
        let mut targets = exact_targets(s, &truth, s.lengths());
        targets.prior.weights = [3.0; DOF];
        targets.prior.rest = 2.0;
        targets.contacts[0] = Some(Contact {
            joint: R_ANKLE,
            place: DVec3::new(0.3, 0.8, 3.0),
            weight: 50.0,
            along: 0.2,
        });
        check_gradient(&targets, &truth);
    }

    #[test]
    fn what_has_no_projection_is_not_taken_for_a_good_fit() {
        let s = Skeleton::builtin();
        let truth = Pose::facing_camera(3.0);
        let targets = exact_targets(s, &truth, s.lengths());
        let deviation = |z: f64| {
            let mut posed = Posed::default();
            s.pose(&Pose::facing_camera(z), s.lengths(), &mut posed);
            targets.deviation2d(&posed, 1)
        };
        assert!(deviation(3.0).is_some_and(|d| d < 1e-9));
        assert!(deviation(2.0).is_some_and(|d| d > 9.0));
        assert_eq!(deviation(-0.5), None);
    }
}
