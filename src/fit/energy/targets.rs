//! In: what was seen of a person, what motion predicts, and a pose. Out: the energy of the pose, its gradient and its
//! Gauss–Newton matrix. XNect §5.2.
//!
//! Everything is in the space of a person of canonical stature. Each term is a sum of squared residuals divided by the
//! variance its residual is expected to have, so that energies of different units add up and weights are plain factors:
//! E3D in metres relative to the pelvis; E2D in metres at the person's distance (pixel error · depth / focal length);
//! Etemp in metres and radians away from the predicted motion; the contact term in metres between an ankle and the
//! place where it stands, those along the ray from the camera counting less than those across it.

use glam::{DVec2, DVec3};

use super::quadratic::{Quadratic, constrain};
use crate::body::BodyModel;
use crate::body::skeleton::{Pose, Posed, Skeleton};
use crate::joints::{BODY_JOINTS, DOF, EVIDENCE_JOINTS, PELVIS};
use crate::solve::NormalEquations;

/// Joints nearer to the camera than this (metres) have no useful projection.
const MIN_DEPTH: f64 = 0.2;
/// Residuals beyond this many standard deviations lose their pull (Cauchy's loss).
const ROBUST_SIGMAS: f64 = 2.5;

/// A point where a joint is known to stand, e.g. a foot on the floor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    /// The standing joint.
    pub joint: usize,
    /// Where it stands, camera space, metres at canonical stature.
    pub place: DVec3,
    /// Inverse variance across the ray from the camera to the place, 1/m².
    pub weight: f64,
    /// Share of `weight` along that ray, 0–1.
    pub along: f64,
}

impl Contact {
    /// Direction from the camera to the place.
    fn ray(&self) -> DVec3 {
        self.place.normalize_or_zero()
    }

    /// How far a joint lies from the place: squared, in standard deviations.
    fn deviation(&self, joint: DVec3) -> f64 {
        let r = joint - self.place;
        let along = r.dot(self.ray());
        self.weight * (r.length_squared() - (1.0 - self.along) * along * along)
    }

    /// Adds what the place says of a joint.
    fn add_to(&self, joint: DVec3, space: &mut Quadratic) {
        let (r, ray) = (joint - self.place, self.ray());
        let weight = self.weight * robust_weight(self.deviation(joint));
        space.add_point(weight, r);
        // The whole holds all directions alike: what is too much along the ray is taken off.
        space.add_row(-weight * (1.0 - self.along), ray, r.dot(ray));
    }
}

/// What one person's pose is fitted to.
#[derive(Debug, Clone)]
pub struct Targets {
    /// Joints relative to the pelvis, metres.
    pub points3d: [DVec3; BODY_JOINTS],
    /// Inverse variance of `points3d`, 1/m²; 0: unknown.
    pub weights3d: [f64; BODY_JOINTS],
    /// Evidence joints on the plane z = 1: ((u − cx)/fx, (v − cy)/fy).
    pub points2d: [DVec2; EVIDENCE_JOINTS],
    /// Inverse variance of `points2d` after scaling by `depth`, 1/m²; 0: not seen.
    pub weights2d: [f64; EVIDENCE_JOINTS],
    /// Distance that turns errors on the plane z = 1 into metres.
    pub depth: f64,
    /// The pose that motion alone predicts.
    pub predicted: Pose,
    /// Inverse variance of the difference to `predicted`; 0: no prediction.
    pub weights_motion: [f64; DOF],
    /// Inverse variance of an angle's distance from rest, 1/rad²: holds what nothing else determines.
    pub weight_rest: f64,
    /// Standing feet.
    pub contacts: [Option<Contact>; 2],
}

/// Energy of a residual, squared and in standard deviations.
pub fn robust_cost(squared: f64) -> f64 {
    const C: f64 = ROBUST_SIGMAS * ROBUST_SIGMAS;
    C * (squared / C).ln_1p()
}

/// Its weight in reweighted least squares.
pub fn robust_weight(squared: f64) -> f64 {
    const C: f64 = ROBUST_SIGMAS * ROBUST_SIGMAS;
    C / (C + squared)
}

impl Targets {
    /// Residual of a 3D point, metres.
    fn residual3d(&self, posed: &Posed, joint: usize) -> DVec3 {
        posed.joints[joint] - posed.joints[PELVIS] - self.points3d[joint]
    }

    /// Residual of a 2D point in metres at the person's distance; `None` where there is no projection.
    fn residual2d(&self, posed: &Posed, joint: usize) -> Option<DVec2> {
        let p = posed.joints[joint];
        (p.z > MIN_DEPTH).then(|| (p.truncate() / p.z - self.points2d[joint]) * self.depth)
    }

    /// How far an evidence joint's observation lies from the pose: squared, in standard deviations; 0 where not seen,
    /// `None` where the pose has no projection of it.
    pub fn deviation2d(&self, posed: &Posed, joint: usize) -> Option<f64> {
        let residual = self.residual2d(posed, joint)?;
        Some(residual.length_squared() * self.weights2d[joint])
    }

    /// Energy of what was seen of one joint.
    pub fn joint_cost(&self, posed: &Posed, joint: usize) -> f64 {
        let mut cost = 0.0;
        if self.weights3d[joint] > 0.0 {
            cost +=
                robust_cost(self.weights3d[joint] * self.residual3d(posed, joint).length_squared());
        }
        if joint < EVIDENCE_JOINTS
            && self.weights2d[joint] > 0.0
            && let Some(deviation) = self.deviation2d(posed, joint)
        {
            cost += robust_cost(deviation);
        }
        cost
    }

    /// Energy of a pose; `posed` is its forward kinematics.
    pub fn cost(&self, pose: &Pose, posed: &Posed) -> f64 {
        let mut cost = 0.0;
        for joint in 0..BODY_JOINTS {
            cost += self.joint_cost(posed, joint);
        }
        for contact in self.contacts.iter().flatten() {
            cost += robust_cost(contact.deviation(posed.joints[contact.joint]));
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

    /// Adds gradient and Gauss–Newton matrix at a pose; `posed` is its forward kinematics.
    pub fn linearise(
        &self,
        skeleton: &Skeleton,
        pose: &Pose,
        posed: &Posed,
        out: &mut NormalEquations,
    ) {
        let rows = skeleton.elimination().rows();
        for joint in 0..BODY_JOINTS {
            self.add_joint(skeleton, posed, joint, out);
        }
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
        if self.weights3d[joint] > 0.0 && joint != PELVIS {
            let r = self.residual3d(posed, joint);
            let w = self.weights3d[joint];
            let w = w * robust_weight(w * r.length_squared());
            relative.add_point(w, r);
        }
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

/// Targets without any observation or prediction, at a pose.
pub fn no_targets(predicted: Pose) -> Targets {
    Targets {
        points3d: [DVec3::ZERO; BODY_JOINTS],
        weights3d: [0.0; BODY_JOINTS],
        points2d: [DVec2::ZERO; EVIDENCE_JOINTS],
        weights2d: [0.0; EVIDENCE_JOINTS],
        depth: predicted.position.z.max(MIN_DEPTH),
        predicted,
        weights_motion: [0.0; DOF],
        weight_rest: 0.0,
        contacts: [None; 2],
    }
}

/// Targets that a person in `truth` would yield without noise: for tests of the energy and the solver.
#[cfg(test)]
pub fn exact_targets(
    skeleton: &Skeleton,
    truth: &Pose,
    lengths: &crate::body::skeleton::BoneLengths,
) -> Targets {
    let mut posed = Posed::default();
    skeleton.pose(truth, lengths, &mut posed);
    let mut targets = no_targets(*truth);
    for j in 0..BODY_JOINTS {
        targets.points3d[j] = posed.joints[j] - posed.joints[PELVIS];
        targets.weights3d[j] = 400.0;
    }
    for j in 0..EVIDENCE_JOINTS {
        targets.points2d[j] = posed.joints[j].truncate() / posed.joints[j].z;
        targets.weights2d[j] = 400.0;
    }
    targets
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gradient_matches_finite_differences() {
        let s = Skeleton::builtin();
        let mut truth = Pose::facing_camera(3.0);
        for (k, angle) in truth.angles.iter_mut().enumerate() {
            *angle = 0.3 * ((k * 7 % 5) as f64 - 2.0);
        }
        let mut targets = exact_targets(s, &truth, s.lengths());
        targets.weights_motion = [3.0; DOF];
        targets.weight_rest = 2.0;
        targets.contacts[0] = Some(Contact {
            joint: 10,
            place: DVec3::new(0.3, 0.8, 3.0),
            weight: 50.0,
            along: 0.2,
        });
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
            // The prediction term treats the rotation vector as flat: exact only to second order.
            let tolerance = 1e-3 * (1.0 + numeric.abs());
            assert!(
                (numeric - analytic).abs() < tolerance,
                "{d}: {numeric} {analytic}"
            );
        }
    }

    #[test]
    fn a_place_holds_less_along_its_ray() {
        let place = DVec3::new(1.0, 1.5, 5.0);
        let contact = Contact {
            joint: 10,
            place,
            weight: 400.0,
            along: 0.2,
        };
        let ray = place.normalize();
        let across = ray.any_orthonormal_vector();
        for (direction, deviation) in [(ray, 0.8), (across, 4.0), (ray.cross(across), 4.0)] {
            let found = contact.deviation(place + 0.1 * direction);
            assert!((found - deviation).abs() < 1e-9, "{direction}: {found}");
        }
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

    #[test]
    fn one_outlier_moves_little() {
        assert!(robust_cost(1.0) > 0.9 && robust_cost(1e4) < 100.0);
        assert!(robust_weight(0.0) == 1.0 && robust_weight(1e4) < 1e-3);
    }
}
