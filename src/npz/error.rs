//! Why an archive cannot be read, in one line: what was expected, what was found.

/// Most characters of a file's own words in an error.
const SHOWN: usize = 80;

/// Why an archive, or an array of it, cannot be read.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("expected {expected}, found {found}")]
pub struct NpzError {
    /// What was expected.
    pub expected: String,
    /// What was found, and what to do.
    pub found: String,
}

impl NpzError {
    pub(super) fn new(expected: impl Into<String>, found: impl Into<String>) -> Self {
        Self {
            expected: expected.into(),
            found: found.into(),
        }
    }

    pub(super) fn damaged(what: &str, why: impl std::fmt::Display) -> Self {
        Self::new(
            format!("{what} in one piece"),
            format!("{why}; the file is damaged or cut short, write or download it again"),
        )
    }
}

/// The beginning of `text`, in one line.
pub(super) fn excerpt(text: &str) -> String {
    let line = |c: char| if c.is_control() { ' ' } else { c };
    let mut shown: String = text.trim().chars().take(SHOWN).map(line).collect();
    if shown.len() < text.trim().len() {
        shown.push('…');
    }
    shown
}
