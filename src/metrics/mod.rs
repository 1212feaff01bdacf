//! How a run is doing: published bodies and what became of its processes go in, figures for Prometheus and for `edgecap
//! status` come out. No picture and no position of anybody is in them.

mod exposition;
mod histogram;
mod meter;

pub use exposition::exposition;
pub use histogram::Histogram;
pub use meter::{Meter, STAGES, Snapshot};
