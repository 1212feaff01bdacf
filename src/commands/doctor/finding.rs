//! One line of the report.

use std::fmt;

use crate::commands::exit;

/// How one thing is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum State {
    /// As it should be.
    Fine,
    /// Works, or is not needed by everybody.
    Note,
    /// Works so badly that nobody will be content with it.
    Warning,
    /// Has to be mended; the exit code.
    Broken(u8),
}

/// What was found about one thing.
#[derive(Debug)]
pub struct Finding {
    /// The thing.
    pub what: &'static str,
    /// How it is doing.
    pub state: State,
    /// What that means, and what to do.
    pub text: String,
}

impl Finding {
    /// About `what`.
    pub fn new(what: &'static str, state: State, text: impl Into<String>) -> Self {
        let text = text.into();
        Self { what, state, text }
    }

    /// What went wrong when it was looked at.
    pub fn failed(what: &'static str, error: impl Into<anyhow::Error>) -> Self {
        let error = error.into();
        let state = State::Broken(exit::code(&error));
        Self::new(what, state, format!("{error:#}"))
    }
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let state = match self.state {
            State::Fine => "ok",
            State::Note => "note",
            State::Warning => "WARNING",
            State::Broken(_) => "BROKEN",
        };
        write!(f, "{state:7} {:14} {}", self.what, self.text)
    }
}
