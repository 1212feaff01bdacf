//! Stage III. In: [`ObservationFrame`](crate::message::ObservationFrame)s, noisy and without identity. Out:
//! [`BodyFrame`](crate::message::BodyFrame)s: identified, temporally stable, metric skeletons with joint angles.

#![allow(
    clippy::needless_range_loop,
    reason = "a joint's index runs over several arrays at once"
)]

mod appearance;
pub mod config;
mod energy;
mod evidence;
mod fitter;
mod identity;
mod publish;
mod scene;
mod track;

pub use config::{FitConfig, GroundConfig};
pub use fitter::{FitCounters, Fitter};
pub use publish::confidence;

// The parts of the energy, and of who is who, that do not ask how many cameras there are.
pub(crate) use appearance::Appearance;
#[cfg(test)]
pub(crate) use energy::check_gradient;
pub(crate) use energy::{
    InSpace, Motion, MotionModel, MotionPrior, PoseEnergy, PoseSolver, Posture, Problem, Quadratic,
    Solution, constrain, reprojection, robust_cost, robust_weight,
};
pub(crate) use identity::{
    Bounds, Look, VETO, by_former_place, by_looks_or_place, confirmed, overlap,
};
pub(crate) use publish::flat_angles;
pub(crate) use track::{
    RunningMean, SEEN_THROUGH, WEIGHTS_3D, best_branch, first_pose, look_of_its_own,
};
