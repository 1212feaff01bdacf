//! Why a stream could not be opened or used.

use std::io;
use std::path::{Path, PathBuf};

/// Why a stream could not be opened or used.
#[derive(Debug, thiserror::Error)]
pub enum LinkError {
    /// The camera's name cannot be part of a service name.
    #[error(
        "camera name '{0}': expected 1 to 64 of a-z, A-Z, 0-9, '-' and '_'; choose another with --name"
    )]
    Name(String),
    /// The folder of this installation cannot be used.
    #[error(
        "runtime folder {}: {cause}; mend that, or name another folder in EDGECAP_RUNTIME_DIR",
        folder.display()
    )]
    Place {
        /// The folder.
        folder: PathBuf,
        /// What was found.
        cause: String,
    },
    /// What the folder of this installation lies in is not there.
    #[error(
        "runtime folder {}: {cause}; make it, or name another folder in EDGECAP_RUNTIME_DIR",
        folder.display()
    )]
    NoPlace {
        /// The folder.
        folder: PathBuf,
        /// What was found.
        cause: String,
    },
    /// Another process publishes this stream already.
    #[error(
        "another process already publishes {service}; stop it, or give this camera another --name"
    )]
    Busy {
        /// The service.
        service: String,
    },
    /// The stream's messages have another layout than this program reads.
    #[error(
        "{service}: expected messages of version {expected}, found version {found}; use an edgecap and a client of the same version"
    )]
    Version {
        /// The service.
        service: String,
        /// What this program reads.
        expected: u32,
        /// What is published.
        found: u32,
    },
    /// This user may not read what is there.
    #[error(
        "{service} belongs to user {owner}: expected that user or a member of group {group}, found user {user}; add this user to the group"
    )]
    Permission {
        /// The service.
        service: String,
        /// Who publishes.
        owner: u32,
        /// Who may read.
        group: u32,
        /// Who this process runs as.
        user: u32,
    },
    /// There is no room for the messages.
    #[error(
        "{service}: no room in {}: expected {needed} KiB free, found {free} KiB; make room there, or mount it larger",
        folder.display()
    )]
    Full {
        /// The service.
        service: String,
        /// The folder.
        folder: PathBuf,
        /// What is needed, KiB.
        needed: u64,
        /// What there is, KiB.
        free: u64,
    },
    /// Shared memory failed otherwise.
    #[error("shared memory of {service} failed ({cause}); 'edgecap doctor' looks closer")]
    SharedMemory {
        /// The service.
        service: String,
        /// What failed.
        cause: String,
    },
}

impl LinkError {
    pub(crate) fn place(folder: &Path, cause: impl core::fmt::Display) -> Self {
        Self::Place {
            folder: folder.to_owned(),
            cause: cause.to_string(),
        }
    }

    pub(crate) fn failed(service: &str, cause: impl core::fmt::Display) -> Self {
        Self::SharedMemory {
            service: service.to_owned(),
            cause: cause.to_string(),
        }
    }
}

/// Whether the memory behind a folder is used up.
pub(crate) fn is_full(error: &io::Error) -> bool {
    matches!(
        error.kind(),
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded
    )
}
