//! Calibration files of others go in, [`View`](super::View)s come out: one file a format.

mod qtm;

pub use qtm::read_qtm;
