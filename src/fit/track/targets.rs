//! In: evidence of a person. Out: what their pose is fitted to, each joint by how well it was seen.

use super::{Context, Track};
use crate::body::skeleton::Pose;
use crate::fit::energy::Targets;
use crate::fit::evidence::Evidence;
use crate::joints::{
    BODY_JOINTS, EVIDENCE_JOINTS, HEAD_TOP, L_ANKLE, L_ELBOW, L_HIP, L_KNEE, L_SHOULDER, L_WRIST,
    NECK, R_ANKLE, R_ELBOW, R_HIP, R_KNEE, R_SHOULDER, R_WRIST,
};

/// E3D weight of each joint: trunk and head are seen, ends of limbs are guessed. Falls with the error that Stage II has
/// on rendered clips, 16 mm at the hips, 130 mm at the wrists.
pub const WEIGHTS_3D: [f64; BODY_JOINTS] = [
    1.5, 2.0, 1.5, 0.8, 0.5, 1.5, 0.8, 0.5, 4.0, 1.0, 0.6, 4.0, 1.0, 0.6, 0.0, 3.0, 1.5, 0.3, 0.3,
    0.4, 0.4,
];
/// Share of its E3D weight that a joint keeps when its pixel was not seen.
const UNSEEN_3D: f64 = 0.35;
/// Evidence joints behind each body joint that is not one itself.
pub const SEEN_THROUGH: [usize; BODY_JOINTS] = [
    HEAD_TOP, NECK, R_SHOULDER, R_ELBOW, R_WRIST, L_SHOULDER, L_ELBOW, L_WRIST, R_HIP, R_KNEE,
    R_ANKLE, L_HIP, L_KNEE, L_ANKLE, R_HIP, NECK, HEAD_TOP, R_WRIST, L_WRIST, R_ANKLE, L_ANKLE,
];

impl Track {
    /// Targets by an observation; `predicted`: the pose expected before it, whose weights are left at 0; `depth`: how
    /// far away the person is, metres.
    pub(super) fn targets(
        &self,
        e: &Evidence,
        predicted: Pose,
        depth: f64,
        cx: &Context<'_>,
    ) -> Targets {
        let terms = &cx.config.terms;
        let mut targets = Targets::unseen(predicted);
        targets.depth = depth;
        targets.points2d = e.plane;
        targets.in_space.points = e.points3d;
        for j in 0..EVIDENCE_JOINTS {
            targets.weights2d[j] = terms.reprojection * e.confidence[j] / terms.sigma2d.powi(2);
        }
        if e.known3d {
            for j in 0..BODY_JOINTS {
                let seen = e.confidence[SEEN_THROUGH[j]] > 0.0;
                let held_back = self.filters.holds_back(j);
                let share = if held_back || !e.tells3d[j] {
                    0.0
                } else if seen {
                    1.0
                } else {
                    UNSEEN_3D
                };
                targets.in_space.weights[j] =
                    terms.position * WEIGHTS_3D[j] * share / terms.sigma3d.powi(2);
            }
        }
        targets
    }
}
