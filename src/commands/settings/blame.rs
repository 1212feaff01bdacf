//! Whose mistake an error about options is: of who typed them, or of the file, and there at which line and column.

use std::fmt::Display;
use std::ops::Range;

use clap::Args;

use super::RunArgs;
use super::effective::{Camera, Effective};
use crate::commands::exit::{self, Failure};
use crate::config::{FILE_NAME, Mistake, Origin, Place};

/// Something that is wrong with options of a camera, or of all of them.
#[derive(Debug)]
pub struct Fault<'a> {
    camera: &'a Camera,
    /// As [`Effective::blame`] takes them.
    keys: &'static [&'static str],
    /// The file or name that every message about it holds; `None` where its words are always the same.
    subject: Option<String>,
    error: anyhow::Error,
}

impl<'a> Fault<'a> {
    /// Of the values of these keys, which [`Effective::blame`] takes; the words of `error` are always the same.
    pub fn new(
        camera: &'a Camera,
        keys: &'static [&'static str],
        error: impl Into<anyhow::Error>,
    ) -> Self {
        Self {
            camera,
            keys,
            subject: None,
            error: error.into(),
        }
    }

    /// The same of this file or name, whatever the words.
    pub fn about(self, subject: impl Display) -> Self {
        Self {
            subject: Some(subject.to_string()),
            ..self
        }
    }

    /// Whether a run ended over it with `error`. Of a process that has told the user itself the code is all there is.
    pub fn is(&self, error: &anyhow::Error) -> bool {
        // Who looks whether a file can be opened need not tell why it cannot.
        let code = |error| match exit::code(error) {
            exit::NO_PERMISSION => exit::NO_INPUT,
            code => code,
        };
        let said = exit::told(error);
        let is_named = |subject: &String| holds(&said, subject);
        code(&self.error) == code(error)
            && (exit::is_silent(error)
                || exit::told(&self.error) == said
                || self.subject.as_ref().is_some_and(is_named))
    }
}

/// Whether a file or name stands in a text, as a whole or as the folder of what stands there.
fn holds(text: &str, subject: &str) -> bool {
    let is_more = |c: char| c.is_alphanumeric() || "-_.".contains(c);
    !subject.is_empty()
        && text.match_indices(subject).any(|(start, found)| {
            let before = text[..start].chars().next_back();
            let after = text[start + found.len()..].chars().next();
            !before.is_some_and(|c| is_more(c) || c == '/') && !after.is_some_and(is_more)
        })
}

impl Effective {
    /// Refuses settings with which something is wrong.
    ///
    /// # Errors
    /// The first fault, as [`blame`](Self::blame) tells it.
    pub(super) fn expect_none(&self, faults: Vec<Fault<'_>>) -> anyhow::Result<()> {
        let first = faults.into_iter().next();
        first.map_or(Ok(()), |fault| Err(self.blame_for(fault)))
    }

    /// A fault as an error, as [`blame`](Self::blame) tells it.
    pub(super) fn blame_for(&self, fault: Fault<'_>) -> anyhow::Error {
        self.blame(fault.camera, fault.keys, fault.error)
    }

    /// An error about options of `camera`, or of all of them, with its place in the file: where the first of these
    /// `keys` stands that the file holds, else the first of those that the error names by their flags. It calls them as
    /// the file does.
    ///
    /// What the user can mend there becomes a [`Mistake`], exit code 78; what is wrong inside a file that is named
    /// keeps its code. Where a key was typed the error stays what it is.
    pub(super) fn blame(
        &self,
        camera: &Camera,
        keys: &[&str],
        error: impl Into<anyhow::Error>,
    ) -> anyhow::Error {
        let error = error.into();
        let text = exit::told(&error);
        let flags = flags(&text);
        let of_camera = flags
            .iter()
            .filter(|flag| !self.is_of_another(camera, &text[..flag.at.start]));
        let named = of_camera.map(|flag| &*flag.key);
        let all: Vec<&str> = keys.iter().copied().chain(named).collect();
        let origin = |key: &str| self.origin(camera, key);
        let is_typed = |key: &str| match origin(key) {
            Some(origin) => origin == Origin::Flag,
            // No settings have it. Those themselves may have been found.
            None => key != "config",
        };
        if all.iter().any(|key| is_typed(key)) {
            return error;
        }
        let stands = all.iter().find_map(|key| match origin(key) {
            Some(Origin::File(place)) => Some((*key, place)),
            _ => None,
        });
        // A key that is left out is wrong where the camera begins.
        let Some((key, place)) = stands.or(keys.first().copied().zip(camera.head)) else {
            return error;
        };
        let at = |what: String| mistake(camera, place, what);
        if !is_of_who_asks(&error) {
            return error.context(at(key.to_owned()).to_string());
        }
        let mut what = String::new();
        let mut done = 0;
        for Flag { at, key } in flags.iter().filter(|flag| origin(&flag.key).is_some()) {
            what += &text[done..at.start];
            what += &format!("'{key}'");
            done = at.end;
        }
        what += &text[done..];
        match flags.iter().any(|flag| flag.key == key) {
            true => at(what).into(),
            false => at(format!("{key}: {what}")).into(),
        }
    }

    /// Where the value of a key came from; `None` where no settings have such a key.
    fn origin(&self, camera: &Camera, key: &str) -> Option<Origin> {
        let sections = [
            &camera.origins,
            &self.network,
            &self.metrics.1,
            &self.bridges.1,
            &self.multiview.1,
        ];
        sections.into_iter().find_map(|s| s.get(key).copied())
    }

    /// Whether what follows `before` is said of another camera: `name: --jsonl`.
    fn is_of_another(&self, camera: &Camera, before: &str) -> bool {
        let Some(before) = before.strip_suffix(": ") else {
            return false;
        };
        let name = before.rsplit(' ').next();
        let others = self.cameras.iter().filter(|c| !std::ptr::eq(*c, camera));
        let mut names = others.map(|c| c.args.input.name.as_deref());
        names.any(|other| other.is_some() && other == name)
    }
}

/// Whether an error is one of what was asked for, and not inside a file or on the way.
pub fn is_of_who_asks(error: &anyhow::Error) -> bool {
    let codes = [
        exit::USAGE,
        exit::NO_INPUT,
        exit::CANNOT_CREATE,
        exit::NO_PERMISSION,
        exit::CONFIG,
    ];
    codes.contains(&exit::code(error))
}

/// An error as a mistake of the settings, with the exit code of those where the user has been told already.
pub fn told_as(error: &anyhow::Error, mistake: Mistake) -> anyhow::Error {
    match exit::is_silent(error) {
        true => Failure::silent(exit::CONFIG).into(),
        false => mistake.into(),
    }
}

fn mistake(camera: &Camera, place: Place, what: String) -> Mistake {
    let file = camera.args.settings.config.as_ref();
    Mistake {
        file: file.map_or_else(|| FILE_NAME.to_owned(), |file| file.display().to_string()),
        place: Some(place),
        what,
    }
}

/// A flag of `run` in a text, and the key of its value.
struct Flag {
    at: Range<usize>,
    key: String,
}

/// The flags of `run` in a text; those of a command that the text tells to type are none.
fn flags(text: &str) -> Vec<Flag> {
    let command = RunArgs::augment_args(clap::Command::new("edgecap"));
    let (said, _) = text.split_once("edgecap ").unwrap_or((text, ""));
    let found = said.match_indices("--").filter_map(|(start, dashes)| {
        let is_word = start == 0 || said[..start].ends_with(' ');
        let name = &said[start + dashes.len()..];
        let is_flags = |c: char| c.is_ascii_alphanumeric() || c == '-';
        let name = &name[..name.find(|c| !is_flags(c)).unwrap_or(name.len())];
        let mut options = command.get_arguments();
        let option = options.find(|option| is_word && option.get_long() == Some(name))?;
        Some(Flag {
            at: start..start + dashes.len() + name.len(),
            key: option.get_id().to_string(),
        })
    });
    found.collect()
}

#[cfg(test)]
mod tests {
    use super::super::{Settings, effective};
    use super::*;

    const TWO: &str = "[[camera]]\nname = \"hall\"\njsonl = \"a\"\n[[camera]]\nname = \"all\"\nmax_fps = 5.0\njsonl = \"b\"\n[bridges]\nvmc = \"127.0.0.1:39539\"\n";

    fn blamed(typed: &RunArgs, camera: usize, keys: &[&str], error: Failure) -> (u8, String) {
        let settings = Settings::parse("edgecap.toml", TWO).unwrap();
        let effective = effective(typed, &settings).unwrap();
        let error = effective.blame(&effective.cameras[camera], keys, error);
        (exit::code(&error), exit::told(&error))
    }

    fn of_file(camera: usize, keys: &[&str], said: &str) -> String {
        let (code, told) = blamed(&RunArgs::default(), camera, keys, Failure::usage(said));
        assert_eq!(code, exit::CONFIG, "{told}");
        told
    }

    #[test]
    fn options_of_the_file_are_called_by_their_keys() {
        assert_eq!(
            of_file(0, &[], "--vmc wants one; 'edgecap bridge --vmc' takes it"),
            "edgecap.toml:9:1: 'vmc' wants one; 'edgecap bridge --vmc' takes it"
        );
        assert_eq!(
            of_file(1, &[], "--max-fps is of a camera or --live, not of x--live"),
            "edgecap.toml:6:1: 'max_fps' is of a camera or 'live', not of x--live"
        );
        assert_eq!(
            of_file(1, &["name"], "found another"),
            "edgecap.toml:5:1: name: found another"
        );
    }

    #[test]
    fn a_key_is_blamed_of_the_camera_that_is_spoken_of() {
        let said = "hall: --max-fps and all: --jsonl b are one";
        assert_eq!(
            of_file(1, &[], said),
            "edgecap.toml:7:1: hall: 'max_fps' and all: 'jsonl' b are one"
        );
        assert!(of_file(0, &["input"], "away").starts_with("edgecap.toml:1:1: input: "));
    }

    #[test]
    fn what_is_typed_stays_the_command_lines_and_what_is_in_a_file_keeps_its_code() {
        let said = "--vmc has a port for each person";
        let mut typed = RunArgs::default();
        typed.bridges.vmc = "127.0.0.1:39540".parse().ok();
        let (code, told) = blamed(&typed, 0, &[], Failure::usage(said));
        assert_eq!((code, &*told), (exit::USAGE, said));
        // Of what no settings have, too.
        let said = "--export a and --jsonl a are one";
        let untyped = RunArgs::default();
        let (code, told) = blamed(&untyped, 0, &["input"], Failure::usage(said));
        assert_eq!((code, &*told), (exit::USAGE, said));
        let own = "--jsonl a would replace --config a";
        let told = of_file(0, &[], own);
        assert_eq!(told, "edgecap.toml:3:1: 'jsonl' a would replace --config a");
        let damaged = Failure::data("a: damaged");
        let (code, told) = blamed(&untyped, 0, &["jsonl"], damaged);
        assert_eq!(
            (code, &*told),
            (exit::DATA, "edgecap.toml:3:1: jsonl: a: damaged")
        );
    }

    #[test]
    fn a_fault_is_known_by_its_code_and_its_words_or_its_file() {
        let settings = Settings::parse("edgecap.toml", TWO).unwrap();
        let effective = effective(&RunArgs::default(), &settings).unwrap();
        let fault = |error| Fault::new(&effective.cameras[0], &["jsonl"], error);
        let is = |fault: &Fault<'_>, error: Failure| fault.is(&error.into());
        let usage = fault(Failure::usage("--vmc wants one"));
        assert!(is(&usage, Failure::usage("--vmc wants one")));
        assert!(!is(&usage, Failure::config("--vmc wants one")));
        assert!(!is(&usage, Failure::usage("--max-fps leaves none")));
        let file = fault(Failure::exists("b.bin: a file")).about("a/b.bin");
        for said in ["cannot write a/b.bin: full", "a/b.bin/c", "'a/b.bin'"] {
            assert!(is(&file, Failure::exists(said)), "{said}");
        }
        for said in ["cannot write /a/b.bin", "a/b.bin.1", "xa/b.bin", "c"] {
            assert!(!is(&file, Failure::exists(said)), "{said}");
        }
        // Its process has said which.
        assert!(is(&file, Failure::silent(exit::CANNOT_CREATE)));
        assert!(!is(&file, Failure::silent(exit::NO_INPUT)));
    }
}
