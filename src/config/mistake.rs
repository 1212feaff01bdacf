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
        let message = error.message();
        let what = match unknown_field(message) {
            Some((key, known)) => unknown_key(key, &known),
            // The reader's first line says it; what follows is for the reader's own author.
            None => wrong_type(message)
                .unwrap_or_else(|| message.lines().collect::<Vec<_>>().join(", ")),
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

/// What serde says of a value of another type, in words for whoever writes settings.
fn wrong_type(message: &str) -> Option<String> {
    let told = ["invalid type: ", "invalid value: ", "invalid length "];
    let told = told.iter().find_map(|begin| message.strip_prefix(begin))?;
    // What was found may be a text that holds any words.
    let (found, expected) = told.rsplit_once(", expected ")?;
    let (words, is_number) = expected_in_words(expected);
    let quoted = found.strip_prefix("string ");
    let found = match (found, quoted) {
        (_, Some(text)) => format!("the text {text}"),
        ("sequence", _) => "a list".to_owned(),
        ("map", _) => "a table".to_owned(),
        (value, _) => match value.split_once('`') {
            Some((_, value)) => value.trim_end_matches('`').to_owned(),
            None => value.to_owned(),
        },
    };
    let is_quoted_number = quoted.is_some_and(|text| text.trim_matches('"').parse::<f64>().is_ok());
    let advice = match is_number && is_quoted_number {
        true => "; leave the quotes out",
        false => "",
    };
    Some(format!("expected {words}, found {found}{advice}"))
}

/// What serde expects in words, and whether that is a number.
fn expected_in_words(expected: &str) -> (String, bool) {
    let whole = |most: u64| (format!("a whole number from 0 to {most}"), true);
    let list = ["an array of length ", "a tuple of size "];
    let list = list.iter().find_map(|of| expected.strip_prefix(of));
    let words = match expected {
        "u8" => return whole(u8::MAX.into()),
        "u16" => return whole(u16::MAX.into()),
        "u32" => return whole(u32::MAX.into()),
        "u64" | "usize" => return ("a whole number from 0 on".to_owned(), true),
        "i8" | "i16" | "i32" | "i64" | "isize" => return ("a whole number".to_owned(), true),
        "f32" | "f64" => return ("a number".to_owned(), true),
        "a boolean" => "true or false",
        "a string" => "text in quotes",
        "a sequence" => "a list in brackets",
        "a map" => "a table",
        _ if expected.starts_with("struct ") => "a table",
        other => other,
    };
    let words = list.map_or_else(|| words.to_owned(), |count| format!("a list of {count}"));
    (words, false)
}

#[cfg(test)]
mod tests {
    use serde::Deserialize;

    use super::*;

    #[derive(Debug, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Settings {
        _threads: Option<u16>,
        _rate: Option<f64>,
        _mirror: Option<bool>,
        _name: Option<String>,
        _controls: Option<Vec<String>>,
        _normal: Option<[f64; 3]>,
        _below: Option<Box<Settings>>,
    }

    #[test]
    fn a_value_of_another_type_is_told_in_words_that_settings_are_written_in() {
        for (text, words) in [
            (
                "_threads = \"3\"",
                "expected a whole number from 0 to 65535, found the text \"3\"; leave the quotes out",
            ),
            (
                "_threads = 3.0",
                "expected a whole number from 0 to 65535, found 3.0",
            ),
            (
                "_threads = -1",
                "expected a whole number from 0 to 65535, found -1",
            ),
            ("_rate = \"x\"", "expected a number, found the text \"x\""),
            ("_rate = true", "expected a number, found true"),
            (
                "_mirror = \"a, expected b\"",
                "expected true or false, found the text \"a, expected b\"",
            ),
            ("_name = 5", "expected text in quotes, found 5"),
            ("_name = [\"a\"]", "expected text in quotes, found a list"),
            ("_controls = 5", "expected a list in brackets, found 5"),
            ("_normal = [0, 1]", "expected a list of 3, found 2"),
            ("_below = 5", "expected a table, found 5"),
            ("_rate = { x = 1 }", "expected a number, found a table"),
        ] {
            let error = toml::from_str::<Settings>(text).unwrap_err();
            let mistake = Mistake::refused("edgecap.toml", text, &error);
            assert_eq!(mistake.what, words, "{text}");
        }
    }
}
