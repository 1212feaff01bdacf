//! Why a result did not get where it should.

use std::io;
use std::path::{Path, PathBuf};

use edgecap_client::LinkError;

use crate::output::no_room;
use crate::overlay::OverlayError;

/// Why a sink failed.
#[derive(Debug, thiserror::Error)]
pub enum SinkError {
    /// A file or folder cannot be made.
    #[error("cannot write {}: {}", path.display(), refusal(cause))]
    Create {
        /// What was to be made.
        path: PathBuf,
        /// The system's words.
        cause: io::Error,
    },
    /// Writing failed on the way.
    #[error(
        "{}: writing stopped ({}); what was written before is kept",
        name(path),
        reason(cause)
    )]
    Write {
        /// What was being written.
        path: PathBuf,
        /// The system's words.
        cause: io::Error,
    },
    /// Writing failed on the way, and what there is cannot be used.
    #[error(
        "{}: writing stopped ({}); nothing of this file is kept",
        name(path),
        reason(cause)
    )]
    Lost {
        /// What was being written.
        path: PathBuf,
        /// The system's words.
        cause: io::Error,
    },
    /// The name says something else than what is written.
    #[error("{}: expected {expected}; choose such a name", path.display())]
    Kind {
        /// What was to be made.
        path: PathBuf,
        /// What can be.
        expected: &'static str,
    },
    /// A picture cannot be written.
    #[error(transparent)]
    Picture(#[from] OverlayError),
    /// Shared memory failed.
    #[error(transparent)]
    Link(#[from] LinkError),
}

/// What a record is called.
pub(super) fn name(path: &Path) -> String {
    if path.as_os_str() == crate::output::STDOUT {
        return "standard output".to_owned();
    }
    path.display().to_string()
}

fn reason(error: &io::Error) -> String {
    match error.kind() {
        io::ErrorKind::BrokenPipe => "nobody reads it any more".to_owned(),
        _ => no_room(error).map_or_else(|| error.to_string(), str::to_owned),
    }
}

/// Of a full disk the place is not to blame.
fn refusal(error: &io::Error) -> String {
    let elsewhere = || format!("{error}; choose a writable place");
    no_room(error).map_or_else(elsewhere, str::to_owned)
}
