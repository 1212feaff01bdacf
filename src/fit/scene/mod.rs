//! What people stand on and how tall they are. In: feet that stand. Out: the floor, the world on it, statures.

mod floor_estimate;
mod floor_plane;
mod stature;
mod stature_prior;
mod steady_floor;

pub use floor_estimate::{FloorEstimate, lower};
pub use floor_plane::FloorPlane;
pub use stature::{Stature, assumed};
pub use steady_floor::SteadyFloor;
