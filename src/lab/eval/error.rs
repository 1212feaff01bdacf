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
    /// The truth is about a film, and pictures were predicted.
    #[error(
        "expected predictions of {expected}, which the truth is about, found those of a picture, {found}; predict the film, or give the truth of the pictures"
    )]
    Picture {
        /// The film of the truth.
        expected: String,
        /// A picture.
        found: String,
    },
    /// A picture was predicted in another size than the truth has it.
    #[error(
        "expected predictions of {}x{} pixels, as the truth has {picture}, found {}x{}; predict the pictures that the truth is about, neither turned nor scaled", expected[0], expected[1], found[0], found[1]
    )]
    Size {
        /// The picture, or the frame of the film.
        picture: String,
        /// Pixels across and down in the truth.
        expected: [f64; 2],
        /// The same in the predictions.
        found: [f64; 2],
    },
    /// Two predictions are of one frame.
    #[error(
        "expected one prediction of every frame, found two of frame {frame}; give the predictions of one film, once"
    )]
    Twice {
        /// The frame's number.
        frame: u64,
    },
    /// Which picture is which cannot be told.
    #[error(
        "expected one picture that is {one}, found {} and {}; name the folder in the truth and to `infer --input`, or give the predictions of one folder", both[0], both[1]
    )]
    Ambiguous {
        /// The one path.
        one: String,
        /// Two that go with it equally well.
        both: [String; 2],
    },
    /// A picture is listed more than once.
    #[error("expected every picture once, found {picture} twice in the {of}; give it once")]
    Repeated {
        /// The picture.
        picture: String,
        /// Truth or predictions.
        of: &'static str,
    },
    /// There is no picture to measure.
    #[error(
        "expected a picture to measure, found none in the {of}; give other files or another --split"
    )]
    Empty {
        /// Truth or predictions.
        of: &'static str,
    },
    /// Nobody in the truth is labelled.
    #[error(
        "expected somebody labelled in the truth, found nobody in {pictures} pictures; where nobody is in any of them say --no-people"
    )]
    Nobody {
        /// Pictures of the truth.
        pictures: usize,
    },
    /// Observations and bodies are measured differently.
    #[error("{path}: expected {expected}, as before it, found {found}; measure them on their own")]
    Mixed {
        /// The file, with the line where there is one.
        path: String,
        /// What came before.
        expected: &'static str,
        /// What follows.
        found: &'static str,
    },
    /// No frame of a film has a prediction.
    #[error(
        "expected predictions of frames {} to {}, which the truth is about, found those of frames {} to {}; predict \
         the film from its beginning, or give the truth of this part",
        expected[0], expected[1], found[0], found[1]
    )]
    OtherFrames {
        /// First and last number in the truth.
        expected: [u64; 2],
        /// The same in the predictions.
        found: [u64; 2],
    },
    /// No picture of the truth has a prediction.
    #[error(
        "none of the {truth} pictures of the truth is among the {predictions} predicted ones; expected the predictions' \"source\" to end in the truth's file names (with their folders, where several have one name): run `edgecap infer` on the same pictures"
    )]
    Disjoint {
        /// Pictures in the truth.
        truth: usize,
        /// Pictures predicted.
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
