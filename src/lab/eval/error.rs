//! What can be wrong with predictions or truth.

use std::path::PathBuf;

/// A measurement cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum EvalError {
    /// A file cannot be read.
    #[error("cannot read {path}: {source}; check the path")]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A file holds something else than was expected.
    #[error("{path}: expected {expected}, found {found}")]
    Format {
        /// The file, with the line where there is one.
        path: String,
        /// What was expected.
        expected: String,
        /// What was found, and what to do.
        found: String,
    },
    /// The truth is about another film.
    #[error(
        "expected predictions of {expected}, which the truth is about, found those of {found}; give the truth of that film"
    )]
    Unrelated {
        /// The film of the truth.
        expected: String,
        /// The film of the predictions.
        found: String,
    },
    /// No frame of the truth has a prediction.
    #[error(
        "none of the {truth} pictures of the truth is among the {predictions} predicted ones; expected the predictions' \"source\" to end in the truth's file names: run `edgecap infer` on the same pictures"
    )]
    Disjoint {
        /// Frames in the truth.
        truth: usize,
        /// Frames predicted.
        predictions: usize,
    },
}

impl EvalError {
    pub(crate) fn format(
        path: impl std::fmt::Display,
        expected: impl Into<String>,
        found: impl Into<String>,
    ) -> Self {
        Self::Format {
            path: path.to_string(),
            expected: expected.into(),
            found: found.into(),
        }
    }
}
