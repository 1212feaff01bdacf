//! Fuzzing of everything that reads: targets, and the seeds they start from.

pub mod seeds;
pub mod targets;
