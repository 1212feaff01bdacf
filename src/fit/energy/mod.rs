//! The energy of a pose: what was seen, what motion predicts, where feet stand. XNect §5.2.

mod contact;
mod feet;
mod in_space;
mod motion;
mod motion_prior;
mod pose_solver;
mod quadratic;
pub mod reprojection;
mod robust;
mod targets;

pub use feet::Feet;
pub use in_space::InSpace;
pub use motion::{Motion, MotionModel};
pub use motion_prior::MotionPrior;
#[cfg(test)]
pub use pose_solver::check_gradient;
pub use pose_solver::{PoseEnergy, PoseSolver, Posture, Problem, Solution};
pub use quadratic::{Quadratic, constrain};
pub use robust::{robust_cost, robust_weight};
pub use targets::Targets;
