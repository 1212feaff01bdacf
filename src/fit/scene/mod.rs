//! What people stand on and how tall they are. In: feet that stand. Out: the floor, the world on it, statures; by how
//! much everybody before this camera seems to lean.

mod floor_estimate;
mod floor_plane;
mod lean;
mod stature;
mod stature_prior;
mod steady_floor;

pub use floor_estimate::{FloorEstimate, lower};
pub use floor_plane::FloorPlane;
pub use lean::Lean;
pub use stature::{Stature, assumed};
pub use steady_floor::SteadyFloor;
