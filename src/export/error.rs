//! Why a record cannot be exported.

use std::path::PathBuf;

use crate::counted::counted;
use crate::record::{RecordError, no_whole_frame};

/// Why a record cannot be exported.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// No format has this extension.
    #[error("{}: expected a name that ends in .bvh, .glb, .trc, .csv, .npz or .svg", .0.display())]
    Extension(PathBuf),
    /// There is nobody in the record.
    #[error(
        "{name}: expected recorded bodies, found nobody in {}; record while people are in view",
        counted(*.frames, "frame", "frames")
    )]
    Empty {
        /// The record.
        name: String,
        /// Its frames.
        frames: u64,
    },
    /// The record ends inside its first frame.
    #[error("{}", no_whole_frame(.name, "bodies"))]
    Cut {
        /// The record.
        name: String,
    },
    /// The one who was asked for is not in the record.
    #[error("{name}: nobody in it has the id {id}; there are {there}")]
    NoPerson {
        /// The record.
        name: String,
        /// Who was asked for.
        id: u32,
        /// Who is there.
        there: String,
    },
    /// Who was asked for is only in frames that are left out.
    #[error(
        "{name}: the id {id} is only in frames that are no later than those before them, which are left out; \
         export somebody else"
    )]
    NoTime {
        /// The record.
        name: String,
        /// Who was asked for.
        id: u32,
    },
    /// The record cannot be read.
    #[error(transparent)]
    Record(#[from] RecordError),
    /// The format cannot hold it.
    #[error(
        "the record does not fit the format: {0}; export one person with --person, or record shorter takes"
    )]
    Format(String),
}
