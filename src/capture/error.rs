//! What can go wrong between a user's `--input` and a [`Frame`](super::Frame).

use std::io;
use std::path::{Path, PathBuf};

use crate::camera::is_nowhere;

/// Why no (further) picture comes. Every message names the input, says what was found, and what to do.
#[derive(Debug, thiserror::Error)]
pub enum CaptureError {
    /// Nothing is there, or can be: a missing file, an empty folder, a file taken for a folder, a socket.
    #[error("{input}: {reason}")]
    NoInput {
        /// What the user pointed at.
        input: String,
        /// What was found instead, and the remedy.
        reason: String,
    },
    /// Something is there, and its bytes cannot be read as a whole input.
    #[error("{input}: {reason}")]
    Data {
        /// What the user pointed at.
        input: String,
        /// What was expected, what was found, and the remedy.
        reason: String,
    },
    /// One picture of many is damaged or cannot be read; the source goes on with the next one.
    #[error("{input}: {reason}")]
    Picture {
        /// The file, or the video and frame number.
        input: String,
        /// What was expected, what was found, and the remedy.
        reason: String,
    },
    /// A device or program that is needed is not there.
    #[error("{what}: {reason}")]
    Unavailable {
        /// The camera or program.
        what: String,
        /// What was found, and the remedy.
        reason: String,
    },
    /// The camera is in use.
    #[error("{device}: {reason}")]
    Busy {
        /// The camera.
        device: String,
        /// Who holds it as far as known, and the remedy.
        reason: String,
    },
    /// A camera has no new picture at the moment; the source goes on. Look at the stop signal and ask again.
    #[error("{device}: {reason}")]
    NoPictureYet {
        /// The camera.
        device: String,
        /// Whether it is slow or gone.
        reason: String,
        /// It is gone, or was never there: a picture from now on means that it has come back. Otherwise its next
        /// picture is not due yet.
        is_away: bool,
    },
    /// The system does not let this user open the input.
    #[error("{input}: permission denied; {remedy}")]
    Permission {
        /// What the user pointed at.
        input: String,
        /// What to do.
        remedy: String,
    },
    /// A setting asks for something that cannot be.
    #[error("{setting}: {reason}")]
    Config {
        /// The setting or file.
        setting: String,
        /// What was expected, what was found, and the remedy.
        reason: String,
    },
    /// Reading or writing failed half-way.
    #[error("{input}: {source}; check the disk or the connection and try again")]
    Io {
        /// What was being read or written.
        input: String,
        /// The system's own words.
        source: io::Error,
    },
}

impl CaptureError {
    /// The code from `sysexits.h` that a command ends with: 65 data, 66 no input, 69 unavailable, 74 input/output,
    /// 75 in use, try later, 77 permission, 78 configuration.
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Data { .. } | Self::Picture { .. } => 65,
            Self::NoInput { .. } => 66,
            Self::Unavailable { .. } | Self::NoPictureYet { .. } => 69,
            Self::Io { .. } => 74,
            Self::Busy { .. } => 75,
            Self::Permission { .. } => 77,
            Self::Config { .. } => 78,
        }
    }

    /// Whether the source goes on with the next picture after this error.
    pub fn is_skippable(&self) -> bool {
        matches!(self, Self::Picture { .. } | Self::NoPictureYet { .. })
    }

    /// Whether opening again later may work: what is missing or in use now.
    pub fn may_pass(&self) -> bool {
        matches!(self, Self::Unavailable { .. } | Self::Busy { .. })
    }

    /// A damaged input.
    pub(crate) fn data(input: impl Into<String>, reason: impl Into<String>) -> Self {
        Self::Data {
            input: input.into(),
            reason: reason.into(),
        }
    }

    /// The error of opening or reading a file at `path`.
    pub(crate) fn from_io(path: &Path, source: io::Error) -> Self {
        Self::from_io_named(&path.display().to_string(), source)
    }

    /// The error of opening or reading an input by its printable name.
    pub(crate) fn from_io_named(input: &str, source: io::Error) -> Self {
        let input = input.to_owned();
        match source.kind() {
            io::ErrorKind::NotFound if input.is_empty() => Self::NoInput {
                input: "an input without a name".into(),
                reason: "expected a path, found none; is a variable of a script empty?".into(),
            },
            io::ErrorKind::NotFound => Self::NoInput {
                input,
                reason: "no such file or folder; check the path".into(),
            },
            _ if is_nowhere(&source) => Self::NoInput {
                input,
                reason: format!("expected a file or folder, found none ({source}); check the path"),
            },
            io::ErrorKind::PermissionDenied => Self::Permission {
                input,
                remedy: "make it readable for this user".into(),
            },
            _ => Self::Io { input, source },
        }
    }

    /// Turns the error of a single file into that of one file among many, which costs nothing but that file.
    pub(crate) fn into_picture(self) -> Self {
        match self {
            Self::Data { input, reason } | Self::NoInput { input, reason } => {
                Self::Picture { input, reason }
            }
            Self::Permission { input, remedy } => Self::Picture {
                input,
                reason: format!("permission denied; {remedy}"),
            },
            Self::Io { input, source } => Self::Picture {
                input,
                reason: format!("{source}; check the disk or the connection and try again"),
            },
            other => other,
        }
    }
}

/// The printable name of a path.
pub(crate) fn name_of(path: &Path) -> String {
    PathBuf::from(path).display().to_string()
}
