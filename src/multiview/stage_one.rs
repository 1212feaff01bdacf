//! Stage one: one frame, one body. From joints in space to a coarse pose, from there to the views, left and right of
//! every view tried again against the body on the way.

use glam::{DMat3, DQuat, DVec3};

use super::energy::{Energy, Free, SHAPES, Targets};
use super::exchange;
use super::fitted::Fitted;
use super::moment::Moment;
use super::points;
use super::prior::PosePrior;
use super::refine::refine;
use crate::body::BodyModel;
use crate::body::mesh::{MeshBody, MeshPose};
use crate::camera::View;
use crate::joints::{BODY_JOINTS, EVIDENCE_JOINTS, L_HIP, L_SHOULDER, NECK, R_HIP, R_SHOULDER};
use crate::solve::{Effort, Solver};

const COARSE: f64 = 0.25;
/// Distance beyond which a view's joint counts little in the end, metres: 40 pixels of a person 690 pixels high.
pub const FINE: f64 = 0.1;
/// Weight of the pose prior while little is known, and in the end.
const PRIOR: [f64; 2] = [6.0, 1.0];
/// While little is known, and in the end: distance beyond which a view's joint counts little (metres), weight of the
/// pose prior, and most linearisations.
const ROUGHLY: (f64, f64, u32) = (COARSE, PRIOR[0], 10);
const WELL: (f64, f64, u32) = (FINE, PRIOR[1], 14);
/// Weight of the shape prior, and with outlines, which tell more of the shape than joints do.
const SHAPE: f64 = 3.0;
const OUTLINED: f64 = 1.0;
/// Weight of a joint in space at the start: rays that hardly meet should not bind.
const START: f64 = 0.2;
/// Views and limbs are told apart and fitted again so many times at most.
const ROUNDS: usize = 3;

/// Working memory of the stage.
#[derive(Debug)]
pub struct StageOne {
    solver: Solver,
    hierarchy: bool,
}

impl StageOne {
    /// The stage; without `hierarchy` the fine energy is all there is.
    pub fn new(hierarchy: bool) -> Self {
        Self {
            solver: Solver::default(),
            hierarchy,
        }
    }

    /// Fits one frame from its joints in space, or from `near`, a body of another frame, whichever ends better. `None`
    /// where neither is known. Where no joint is known in space, `near` tells how far away the person is, and how
    /// large.
    pub fn fit(
        &mut self,
        body: &MeshBody,
        views: &[View],
        weights: &[f64],
        moment: &mut Moment,
        near: Option<&Fitted>,
    ) -> Option<(Fitted, f64)> {
        let started = self.start(body, moment);
        let told = moment.joints;
        if let Some(near) = near {
            moment.place_by(near);
        }
        let mut best: Option<(Fitted, f64)> = None;
        for (coarse, start) in [(true, started), (false, near.cloned())] {
            let Some(mut fitted) = start else {
                continue;
            };
            if coarse && self.hierarchy {
                self.solve(body, views, weights, moment, ROUGHLY, &mut fitted);
            }
            let cost = self.solve(body, views, weights, moment, WELL, &mut fitted);
            if best.as_ref().is_none_or(|(_, least)| cost < *least) {
                best = Some((fitted, cost));
            }
        }
        let (mut fitted, mut cost) = best?;
        for _ in 0..ROUNDS {
            let joints = points::evidence(&fitted.posed);
            let mut healed = 0;
            for (view, sight) in views.iter().zip(&mut moment.sights) {
                healed += sight
                    .as_mut()
                    .map_or(0, |s| exchange::follow(view, s, &joints));
            }
            if healed == 0 {
                break;
            }
            moment.healed += healed;
            cost = self.solve(body, views, weights, moment, WELL, &mut fitted);
        }
        moment.joints = told;
        Some((fitted, cost))
    }

    /// Fits a frame again from the body that it has, where views count otherwise than they did.
    pub fn again(
        &mut self,
        body: &MeshBody,
        views: &[View],
        weights: &[f64],
        moment: &Moment,
        fitted: &mut Fitted,
    ) {
        self.solve(body, views, weights, moment, WELL, fitted);
        self.outline(body, views, weights, moment, fitted);
    }

    /// Fits a body that joints have placed to its contours as well.
    pub fn outline(
        &mut self,
        body: &MeshBody,
        views: &[View],
        weights: &[f64],
        moment: &Moment,
        fitted: &mut Fitted,
    ) {
        let settings = (FINE, PRIOR[1], OUTLINED);
        let scene = (body, views, weights);
        refine(&mut self.solver, scene, moment, fitted, settings);
    }

    fn solve(
        &mut self,
        body: &MeshBody,
        views: &[View],
        weights: &[f64],
        moment: &Moment,
        (sigma, prior, iterations): (f64, f64, u32),
        fitted: &mut Fitted,
    ) -> f64 {
        let seen = moment.seen(views, weights);
        let energy = Energy {
            body,
            seen: &seen,
            sigma,
            targets: None,
            target_sigma: FINE,
            lifted: moment.lifted.as_ref().map(|l| &l.joints),
            rims: &[],
            prior,
            shape: SHAPE,
            free: Free::of(moment),
        };
        let effort = Effort {
            iterations,
            tolerance: 1e-4,
        };
        let mut spare = fitted.clone();
        self.solver.solve(&energy, effort, fitted, &mut spare).cost
    }

    /// A body whose joints are near those in space: turned as its trunk is, then bent.
    fn start(&mut self, body: &MeshBody, moment: &Moment) -> Option<Fitted> {
        let (pelvis, turn) = trunk(&moment.joints)?;
        let mut rotations = PosePrior::shipped().mean();
        rotations[0] = turn;
        let betas = [0.0; SHAPES];
        let mut fitted = Fitted::new(
            body,
            MeshPose { pelvis, rotations },
            &betas[..SHAPES.min(body.components())],
        );
        if !self.hierarchy {
            return Some(fitted);
        }
        let mut targets: Targets = [None; BODY_JOINTS];
        for (target, joint) in targets.iter_mut().zip(moment.joints) {
            *target = joint.map(|p| (p, START));
        }
        let mut spare = fitted.clone();
        for (free, iterations) in [(Free::Root, 6), (Free::All, 12)] {
            let energy = Energy {
                body,
                seen: &[],
                sigma: COARSE,
                targets: Some(&targets),
                target_sigma: COARSE,
                lifted: None,
                rims: &[],
                prior: PRIOR[1],
                shape: SHAPE,
                free,
            };
            let effort = Effort {
                iterations,
                tolerance: 1e-3,
            };
            self.solver.solve(&energy, effort, &mut fitted, &mut spare);
        }
        Some(fitted)
    }
}

/// Where a trunk is and how it is turned: x to its left, y up, z forward.
fn trunk(joints: &[Option<DVec3>; EVIDENCE_JOINTS]) -> Option<(DVec3, DQuat)> {
    let across = |right: usize, left: usize| Some(joints[left]? - joints[right]?);
    let middle = |a: usize, b: usize| match (joints[a], joints[b]) {
        (Some(p), Some(q)) => Some((p + q) / 2.0),
        (p, q) => p.or(q),
    };
    let pelvis = middle(R_HIP, L_HIP)?;
    let top = joints[NECK].or_else(|| middle(R_SHOULDER, L_SHOULDER))?;
    let up = (top - pelvis).try_normalize()?;
    let left = match (across(R_HIP, L_HIP), across(R_SHOULDER, L_SHOULDER)) {
        (Some(hips), Some(shoulders)) => hips + 0.5 * shoulders,
        (hips, shoulders) => hips.or(shoulders)?,
    };
    let left = (left - up * left.dot(up)).try_normalize()?;
    let turn = DMat3::from_cols(left, up, left.cross(up));
    Some((pelvis, DQuat::from_mat3(&turn)))
}

/// A pose between two, `part` of the way.
pub fn between(body: &MeshBody, a: &Fitted, b: &Fitted, part: f64) -> Fitted {
    let mut pose = a.pose;
    pose.pelvis = a.pose.pelvis.lerp(b.pose.pelvis, part);
    for (q, to) in pose.rotations.iter_mut().zip(b.pose.rotations) {
        *q = q.slerp(to, part);
    }
    let mut out = Fitted {
        pose,
        person: a.person.clone(),
        posed: a.posed.clone(),
    };
    body.kinematics(&out.pose, &out.person, &mut out.posed);
    out
}
