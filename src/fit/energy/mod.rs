//! The energy of a pose: what was seen, what motion predicts, where feet stand. XNect §5.2.

mod contact;
mod motion;
mod pose_solver;
mod quadratic;
mod targets;

pub use contact::{ANKLES, Feet};
pub use motion::{Motion, MotionModel};
pub use pose_solver::{PoseSolver, Problem, Solution};
pub use quadratic::{Quadratic, constrain};
pub use targets::{Contact, Targets, no_targets, robust_cost, robust_weight};
