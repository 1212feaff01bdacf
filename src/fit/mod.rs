//! Stage III. In: [`ObservationFrame`](crate::message::ObservationFrame)s, noisy and without identity. Out:
//! [`BodyFrame`](crate::message::BodyFrame)s: identified, temporally stable, metric skeletons with joint angles.

#![allow(
    clippy::needless_range_loop,
    reason = "a joint's index runs over several arrays at once"
)]

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
