//! Stage III. In: [`ObservationFrame`](crate::message::ObservationFrame)s, noisy and without identity. Out:
//! [`BodyFrame`](crate::message::BodyFrame)s: identified, temporally stable, metric skeletons with joint angles.

#![allow(
    clippy::needless_range_loop,
    reason = "a joint's index runs over several arrays at once"
)]

pub mod appearance;
pub mod assignment;
pub mod bodies_line;
mod body;
pub mod bones;
pub mod confidence;
pub mod config;
pub mod contact;
pub mod energy;
pub mod evidence;
pub mod fitter;
pub mod floor;
pub mod ground;
mod header;
pub mod height;
pub mod humanoid;
pub mod identity;
pub mod limbs;
pub mod motion;
pub mod offline;
pub mod one_euro;
pub mod placement;
pub mod skeleton;
pub mod solver;
pub mod start;
pub mod statures;
pub mod swap;
pub mod track;
pub mod trust;
pub mod world;

pub use config::FitConfig;
pub use fitter::{FitCounters, Fitter};
