//! The speed certificate: this machine, its measured peak, and what the networks and the stages after them make of it.
//!
//! Figures are medians over whole runs, input bytes in, maps out. Nothing here knows about printing: [`certify`] fills
//! a [`Certificate`], which serialises to JSON and displays as text.

mod certificate;
mod crowd;
mod measure;
mod peak;
mod people;
mod report;
mod sample;
mod subject;

pub use crate::machine::Machine;
pub use certificate::{
    Certificate, LayerTime, NetworkSpeed, PeakSpeed, PeopleSpeed, Ratio, Timing,
};
pub use measure::{BenchError, BenchOptions, certify};
pub use subject::{Subject, SubjectError};
