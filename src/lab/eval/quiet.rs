//! Pictures without people: how often nobody is reported.

use serde::Serialize;

use super::{EvalError, Predictions};

/// What was reported where there is nobody.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Quiet {
    /// Pictures.
    pub pictures: usize,
    /// Those in which nobody was reported.
    pub quiet: usize,
    /// People reported in the others.
    pub people: usize,
}

impl Quiet {
    /// Share of pictures in which nobody was reported.
    pub fn share(&self) -> f64 {
        self.quiet as f64 / self.pictures.max(1) as f64
    }
}

/// Counts what was reported in pictures that hold nobody.
///
/// # Errors
/// When there is no picture.
pub fn quiet(predictions: &Predictions) -> Result<Quiet, EvalError> {
    let frames = &predictions.frames;
    if frames.is_empty() {
        return Err(EvalError::Empty { of: "predictions" });
    }
    Ok(Quiet {
        pictures: frames.len(),
        quiet: frames.iter().filter(|f| f.people.is_empty()).count(),
        people: frames.iter().map(|f| f.people.len()).sum(),
    })
}
