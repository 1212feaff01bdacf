//! How a run is doing: published bodies and what became of its processes go in, figures for Prometheus and for `edgecap
//! status` come out. And how one source is doing: its pictures and their absence go in, messages of its health come
//! out. No picture and no position of anybody is in them.

mod exposition;
mod health;
mod histogram;
mod meter;
mod recent;

pub use exposition::exposition;
pub use health::{About, Health, Seen};
pub use histogram::Histogram;
pub use meter::{Meter, STAGES, Snapshot};
