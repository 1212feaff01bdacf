//! The energy of one body in one frame: joints in the views (Geman–McClure), joints in space, the priors of pose and
//! shape.
//!
//! Huang et al., Towards Accurate Marker-less Human Shape and Pose Estimation over Time (3DV 2017), section 3.
//! Residuals in a view are metres at the person's depth, so that views near and far count alike.

use glam::{DMat3, DVec2, DVec3};

use super::fitted::Fitted;
use super::moment::{Moment, Seen};
use super::points;
use super::prior::PosePrior;
use super::sight::DATA;
use super::silhouette::Rim;
use super::triangulate::{robust, robust_weight};
use crate::body::BodyModel;
use crate::body::mesh::{FREEDOM, MeshBody, first_turn};
use crate::fit::reprojection;
use crate::joints::{BODY_JOINTS, EVIDENCE_JOINTS};
use crate::solve::{LeastSquares, NormalEquations};

/// Shape coefficients that are fitted.
pub const SHAPES: usize = 10;
/// Expected error of a joint that one view alone places in space, metres, and the distance beyond which it counts
/// little.
const LIFTED: f64 = 0.010;
const LIFTED_SIGMA: f64 = 0.5;
/// Share of the pose prior beside such joints: they come from a fit that had a prior of its own.
const LIFTED_PRIOR: f64 = 0.3;
/// No joint turns further in one step.
const LONGEST_STEP: f64 = 0.6;
/// Nearer to a camera nothing is seen.
const NEAREST: f64 = 0.1;
/// Weight of all rotations' lengths: holds what neither views nor prior see.
const RIGID: f64 = 1e-3;

/// Where joints should be in space: place and weight of a squared metre in units of [`DATA`].
pub type Targets = [Option<(DVec3, f64)>; BODY_JOINTS];

/// What may move.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Free {
    /// Place and direction of the whole body.
    Root,
    /// The pose.
    Pose,
    /// Pose and shape.
    All,
}

impl Free {
    /// What a solver may move of somebody in a frame; without a word on their size the shape stays as it is.
    pub fn of(moment: &Moment) -> Self {
        match moment.tells_size() {
            true => Self::All,
            false => Self::Pose,
        }
    }

    fn size(self, body: &MeshBody) -> usize {
        match self {
            Self::Root => 6,
            Self::Pose => FREEDOM,
            Self::All => FREEDOM + SHAPES.min(body.components()),
        }
    }
}

/// The energy.
#[derive(Debug)]
pub struct Energy<'a> {
    /// The model.
    pub body: &'a MeshBody,
    /// What views saw.
    pub seen: &'a [Seen<'a>],
    /// Distance beyond which a view's joint counts little, metres.
    pub sigma: f64,
    /// Where joints should be.
    pub targets: Option<&'a Targets>,
    /// Distance beyond which a target counts little, metres.
    pub target_sigma: f64,
    /// Where Stage III places the joints of somebody whom one view alone sees.
    pub lifted: Option<&'a [DVec3; BODY_JOINTS]>,
    /// Outlines in views with masks.
    pub rims: &'a [Rim<'a>],
    /// Weight of the pose prior.
    pub prior: f64,
    /// Weight of the shape prior.
    pub shape: f64,
    /// What may move.
    pub free: Free,
}

const DENSE: [usize; FREEDOM + SHAPES] = [0; FREEDOM + SHAPES];

impl Energy<'_> {
    fn shapes(&self) -> usize {
        self.free.size(self.body).saturating_sub(FREEDOM)
    }

    /// A joint's part: cost, and of the point in space gradient and Gauss–Newton matrix.
    fn joint(&self, j: usize, at: DVec3) -> (f64, DVec3, DMat3) {
        let (mut cost, mut pull, mut matrix) = (0.0, DVec3::ZERO, DMat3::ZERO);
        let mut towards = |target: DVec3, weight: f64, sigma: f64| {
            let r = at - target;
            let e2 = r.length_squared();
            cost += weight * robust(e2, sigma);
            let weight = weight * robust_weight(e2, sigma);
            pull += weight * r;
            matrix += weight * DMat3::IDENTITY;
        };
        if let Some((target, weight)) = self.targets.and_then(|t| t[j]) {
            towards(target, DATA * weight, self.target_sigma);
        }
        if let Some(lifted) = self.lifted {
            towards(lifted[j], 1.0 / (LIFTED * LIFTED), LIFTED_SIGMA);
        }
        if j >= EVIDENCE_JOINTS {
            return (cost, pull, matrix);
        }
        for seen in self.seen {
            let Some(ray) = seen.sight.rays[j] else {
                continue;
            };
            let weight = DATA * seen.weight * ray.confidence;
            let p = seen.view.to_camera(at);
            let z = p.z.max(NEAREST);
            let r = (DVec2::new(p.x, p.y) / z - ray.plane) * seen.depth;
            let e2 = r.length_squared();
            cost += weight * robust(e2, self.sigma);
            if p.z < NEAREST {
                continue;
            }
            let weight = weight * robust_weight(e2, self.sigma);
            // Rows of the derivative of r by the point in the world.
            let turn = seen.view.rotation.transpose();
            let [x, y] = reprojection::rows(p, seen.depth).map(|row| turn * row);
            pull += weight * (r.x * x + r.y * y);
            matrix += weight * (outer(x) + outer(y));
        }
        (cost, pull, matrix)
    }

    fn pose_prior(&self) -> f64 {
        match self.lifted {
            Some(_) => LIFTED_PRIOR * self.prior,
            None => self.prior,
        }
    }

    fn counts(&self) -> usize {
        if self.targets.is_some() || self.lifted.is_some() {
            BODY_JOINTS
        } else {
            EVIDENCE_JOINTS
        }
    }
}

fn outer(v: DVec3) -> DMat3 {
    DMat3::from_cols(v * v.x, v * v.y, v * v.z)
}

impl LeastSquares for Energy<'_> {
    type State = Fitted;

    fn envelope(&self) -> &[usize] {
        &DENSE[..self.free.size(self.body)]
    }

    fn cost(&self, at: &Fitted) -> f64 {
        let joints = at.posed.reported()[..self.counts()].iter().enumerate();
        let mut cost: f64 = joints.map(|(j, point)| self.joint(j, *point).0).sum();
        cost += self.rims.iter().map(|r| r.cost(self.body, at)).sum::<f64>();
        if self.free != Free::Root {
            cost += self.pose_prior() * PosePrior::shipped().cost(&at.pose.rotations);
            cost += RIGID
                * at.pose.rotations[1..]
                    .iter()
                    .map(|q| vector(*q).length_squared())
                    .sum::<f64>();
        }
        cost + self.shape * at.person.betas().iter().map(|b| b * b).sum::<f64>()
    }

    fn linearise(&self, at: &Fitted, out: &mut NormalEquations) {
        let size = self.free.size(self.body);
        let mut columns: Vec<(usize, DVec3)> = Vec::with_capacity(size);
        for j in 0..self.counts() {
            let (cost, pull, matrix) = self.joint(j, at.posed.reported()[j]);
            if cost == 0.0 {
                continue;
            }
            columns.clear();
            points::jacobian(self.body, &at.posed, j, (FREEDOM, self.shapes()), |k, c| {
                if k < size {
                    columns.push((k, c));
                }
            });
            for (a, &(k, ck)) in columns.iter().enumerate() {
                out.pull(k, ck.dot(pull));
                let row = matrix * ck;
                for &(l, cl) in &columns[..=a] {
                    out.add(k, l, row.dot(cl));
                }
            }
        }
        for rim in self.rims {
            rim.add(self.body, at, self.shapes(), out);
        }
        if self.free != Free::Root {
            PosePrior::shipped().add(&at.pose.rotations, self.pose_prior(), out);
            for (j, q) in at.pose.rotations.iter().enumerate().skip(1) {
                let v = vector(*q);
                for k in 0..3 {
                    let row = first_turn(j) + k;
                    out.add(row, row, RIGID);
                    out.pull(row, RIGID * v[k]);
                }
            }
        }
        for (c, beta) in at.person.betas().iter().enumerate().take(self.shapes()) {
            out.add(FREEDOM + c, FREEDOM + c, self.shape);
            out.pull(FREEDOM + c, self.shape * beta);
        }
    }

    fn step(&self, from: &Fitted, descent: &[f64], to: &mut Fitted) {
        let mut step = [0.0; FREEDOM];
        let pose = descent.len().min(FREEDOM);
        for (k, (s, d)) in step.iter_mut().zip(&descent[..pose]).enumerate() {
            *s = if k < 3 {
                -d
            } else {
                (-d).clamp(-LONGEST_STEP, LONGEST_STEP)
            };
        }
        to.pose = self.body.moved(&from.pose, &step);
        if self.free == Free::All {
            let betas: Vec<f64> = from
                .person
                .betas()
                .iter()
                .enumerate()
                .map(|(c, b)| b - descent.get(FREEDOM + c).copied().unwrap_or(0.0))
                .collect();
            to.person = self.body.person(&betas);
        } else {
            to.person.clone_from(&from.person);
        }
        self.body.kinematics(&to.pose, &to.person, &mut to.posed);
    }
}

fn vector(q: glam::DQuat) -> DVec3 {
    let q = if q.w < 0.0 { -q } else { q };
    q.to_scaled_axis()
}
