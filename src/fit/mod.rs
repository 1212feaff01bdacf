//! Stage III. In: [`ObservationFrame`](crate::message::ObservationFrame)s, noisy and without identity. Out:
//! [`BodyFrame`](crate::message::BodyFrame)s: identified, temporally stable, metric skeletons with joint angles.

pub mod assignment;
pub mod bodies_line;
pub mod config;
pub mod energy;
pub mod offline;
pub mod one_euro;
pub mod skeleton;
pub mod solver;

pub use config::FitConfig;
