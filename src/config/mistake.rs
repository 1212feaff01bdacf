//! What is wrong with a file, and where.

use std::fmt;
use std::ops::Range;

/// A mistake in a settings file. One line: file, line, column, what was expected and found.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub struct Mistake {
    /// The file, as the user knows it.
    pub file: String,
    /// Line and column, from 1; `None` where it is nowhere in particular.
    pub place: Option<(usize, usize)>,
    /// What was expected, found, and what to do.
    pub what: String,
}

impl fmt::Display for Mistake {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.place {
            Some((line, column)) => write!(f, "{}:{line}:{column}: {}", self.file, self.what),
            None => write!(f, "{}: {}", self.file, self.what),
        }
    }
}

impl Mistake {
    /// At these bytes of `text`.
    pub fn at(file: &str, text: &str, span: Option<Range<usize>>, what: impl Into<String>) -> Self {
        Self {
            file: file.to_owned(),
            place: span.map(|span| line_and_column(text, span.start)),
            what: what.into(),
        }
    }

    /// What the TOML reader or a type of ours refuses.
    pub fn refused(file: &str, text: &str, error: &toml::de::Error) -> Self {
        let what = match unknown_field(error.message()) {
            Some((key, known)) => unknown_key(key, &known),
            // The reader's first line says it; what follows is for the reader's own author.
            None => error.message().lines().collect::<Vec<_>>().join(", "),
        };
        Self::at(file, text, error.span(), what)
    }
}

/// Line and column, from 1 and in characters, of a byte of `text`.
pub fn line_and_column(text: &str, at: usize) -> (usize, usize) {
    let before = text.get(..at).unwrap_or(text);
    let line_start = before.rfind('\n').map_or(0, |n| n + 1);
    (
        1 + before.matches('\n').count(),
        1 + before[line_start..].chars().count(),
    )
}

/// Names the key that was probably meant, else all of them.
pub fn unknown_key<K: AsRef<str>>(key: &str, known: &[K]) -> String {
    /// As clap has it for flags.
    const ALIKE: f64 = 0.7;
    let alike = |k: &K| strsim::jaro(key, k.as_ref());
    let nearest = known.iter().max_by(|a, b| alike(a).total_cmp(&alike(b)));
    match nearest.filter(|k| alike(k) > ALIKE) {
        Some(nearest) => format!("unknown key '{key}'; did you mean '{}'?", nearest.as_ref()),
        None if known.is_empty() => format!("unknown key '{key}'; expected none here"),
        None => {
            let all: Vec<&str> = known.iter().map(K::as_ref).collect();
            format!(
                "unknown key '{key}'; expected one of {}: correct or remove it",
                all.join(", ")
            )
        }
    }
}

/// The key and the known ones in serde's words about an unknown field.
fn unknown_field(message: &str) -> Option<(&str, Vec<&str>)> {
    let mut quoted = message
        .strip_prefix("unknown field ")?
        .split('`')
        .skip(1)
        .step_by(2);
    Some((quoted.next()?, quoted.collect()))
}
