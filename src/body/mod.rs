//! Bodies: what moves how. In: the parameters of a pose and a person's shape. Out: joints, and how each moves with each
//! parameter.
//!
//! [`skeleton`] is the skeleton of 29 degrees of freedom that one camera determines, [`mesh`] a body with a skin, in
//! SMPL's format.

pub mod mesh;
mod model;
pub mod skeleton;

pub use model::{BodyModel, Elimination};
