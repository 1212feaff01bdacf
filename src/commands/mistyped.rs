//! What somebody meant who gave a file where an option was expected.

use std::ffi::OsString;
use std::os::unix::ffi::OsStrExt;
use std::path::Path;

use clap::error::{ContextKind, ContextValue};

/// Options that take the file which a verb is about.
const FILES: [&str; 4] = ["input", "view", "record", "config"];

/// What to do about a command line of `program`, where that can be told from its files.
pub fn advice(error: &clap::Error, program: &clap::Command) -> Option<String> {
    let words = [ContextKind::InvalidArg, ContextKind::InvalidSubcommand];
    let word = words.iter().find_map(|kind| match error.get(*kind) {
        Some(ContextValue::String(word)) => Some(word.as_str()),
        _ => None,
    });
    let given: Vec<OsString> = std::env::args_os().skip(1).collect();
    of_file(word?, option(program, &given)?, &given)
}

/// The option of the verb that `given` names.
fn option(program: &clap::Command, given: &[OsString]) -> Option<&'static str> {
    let verb = given.iter().fold(program, |command, word| {
        command.find_subcommand(word).unwrap_or(command)
    });
    let has = |name: &&str| verb.get_arguments().any(|a| a.get_long() == Some(*name));
    FILES.into_iter().find(has)
}

fn of_file(word: &str, option: &str, given: &[OsString]) -> Option<String> {
    let is_file = Path::new(word).exists() || word.contains("://");
    if !is_file || word.starts_with('-') {
        return None;
    }
    // Names of files need not be UTF-8.
    let is_input = |a: &OsString| a == "--input" || a.as_bytes().starts_with(b"--input=");
    if option == "input" && given.iter().any(is_input) {
        return Some(
            "--input takes one: put photos into a folder and give that, run films one after the other".to_owned(),
        );
    }
    Some(format!("give it as --{option} {word}"))
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;
    use crate::commands::Cli;

    fn words(words: &[&str]) -> Vec<OsString> {
        words.iter().map(OsString::from).collect()
    }

    #[test]
    fn a_file_is_an_input() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let name = file.path().to_str().unwrap();
        assert_eq!(
            of_file(name, "input", &words(&[name])).unwrap(),
            format!("give it as --input {name}")
        );
        let two = words(&["--input", "a.avi", name]);
        assert!(
            of_file(name, "input", &two)
                .unwrap()
                .contains("into a folder")
        );
        assert_eq!(of_file("runn", "input", &words(&["runn"])), None);
    }

    #[test]
    fn every_verb_has_the_option_that_it_is_about() {
        let program = Cli::command();
        for (given, name) in [
            (&["a.avi"][..], Some("input")),
            (&["infer", "a.avi"], Some("input")),
            (&["view", "a.jsonl"], Some("record")),
            (&["multiview", "a.avi"], Some("view")),
            (&["config", "check", "edgecap.toml"], Some("config")),
            (&["watch", "a.avi"], None),
        ] {
            assert_eq!(option(&program, &words(given)), name, "{given:?}");
        }
    }
}
