//! One file per verb of the command line; the only place that joins stages, threads and processes.

pub mod eval;
