//! What somebody meant who gave a file where an option was expected.

use std::ffi::OsString;
use std::os::unix::ffi::OsStrExt;
use std::path::Path;

use clap::error::{ContextKind, ContextValue};

/// What to do about a command line, where that can be told from its files.
pub fn advice(error: &clap::Error) -> Option<String> {
    let words = [ContextKind::InvalidArg, ContextKind::InvalidSubcommand];
    let word = words.iter().find_map(|kind| match error.get(*kind) {
        Some(ContextValue::String(word)) => Some(word.as_str()),
        _ => None,
    });
    // Names of files need not be UTF-8.
    let is_input = |a: OsString| a == "--input" || a.as_bytes().starts_with(b"--input=");
    of_file(word?, std::env::args_os().any(is_input))
}

fn of_file(word: &str, has_input: bool) -> Option<String> {
    let is_input = Path::new(word).exists() || word.contains("://");
    match (is_input && !word.starts_with('-'), has_input) {
        (false, _) => None,
        (true, false) => Some(format!("give it as --input {word}")),
        (true, true) => Some(
            "--input takes one: put photos into a folder and give that, run films one after the other".to_owned(),
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_an_input() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let name = file.path().to_str().unwrap();
        assert_eq!(
            of_file(name, false).unwrap(),
            format!("give it as --input {name}")
        );
        assert!(of_file(name, true).unwrap().contains("into a folder"));
        assert_eq!(of_file("runn", false), None);
    }
}
