//! In: a least-squares problem and where to start. Out: the state of least cost near by.
//!
//! Levenberg–Marquardt. The normal matrix is kept within its envelope: a body's limbs meet only in trunk and root, so
//! most of it is zero, and so is most of its Cholesky factor.

mod levenberg_marquardt;
mod normal;

pub use levenberg_marquardt::{Effort, LeastSquares, Outcome, Solver};
pub use normal::NormalEquations;
