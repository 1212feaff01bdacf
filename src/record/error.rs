//! What can be wrong with a recorded file.

/// What is wrong with a record of `what` that was cut off inside its first frame.
pub(crate) fn no_whole_frame(name: &str, what: &str) -> String {
    format!(
        "{name}: expected a record of {what}, found it cut off inside its first frame; record again"
    )
}

/// Why a record cannot be read. Frames and lines count from 1.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// The file itself failed.
    #[error(
        "{name}, line {line}: cannot read: {source}; check that the file is complete and readable"
    )]
    Io {
        /// The file.
        name: String,
        /// The line or frame that could not be read.
        line: u64,
        /// The cause.
        source: std::io::Error,
    },
    /// The file is a record of something else, or none.
    #[error("{name}: expected {expected}, found {found}")]
    Other {
        /// The file.
        name: String,
        /// What the record should hold.
        expected: &'static str,
        /// What it is, and what to do.
        found: &'static str,
    },
    /// A line is no frame as this program writes it.
    #[error(
        "{name}, line {line}: expected one frame as written by {by}, found: {found}; repair or remove the line"
    )]
    Line {
        /// The file.
        name: String,
        /// The offending line or frame.
        line: u64,
        /// What writes such files.
        by: &'static str,
        /// What is wrong with it.
        found: String,
    },
    /// A frame of a binary record is none.
    #[error(
        "{name}, frame {frame}: expected a whole frame, found: {found}; the file is damaged there: copy it again, or \
         record again"
    )]
    Frame {
        /// The file.
        name: String,
        /// The offending frame.
        frame: u64,
        /// What is wrong with it.
        found: String,
    },
}
