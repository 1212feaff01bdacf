//! What a run's results depend on, a line each: where two runs have the same lines, one goes on with the other's work.

use std::fmt::Write as _;
use std::fs::{self, Metadata};
use std::os::unix::fs::MetadataExt;
use std::path::Path;

use clap::ValueEnum as _;

use super::{BACKGROUND, MultiviewArgs};
use crate::commands::views::told;

/// Folders in folders that are looked at: masks lie in one folder a camera.
const DEEPEST: usize = 2;

/// The lines: this program with its weights, options, files. Files are told by place, size and when they were changed.
pub fn inputs(args: &MultiviewArgs) -> String {
    let MultiviewArgs {
        calibration,
        view,
        body,
        no_dct,
        masks,
        film,
        hold_out,
        fps,
        sync,
        // What is written of the bodies, and where to; how fast.
        obj: _,
        export: _,
        out: _,
        threads: _,
    } = args;
    let mut text = program();
    let _ = writeln!(text, "--no-dct {no_dct}");
    if let Some(fps) = fps {
        let _ = writeln!(text, "--fps {fps}");
    }
    if let Some(sync) = sync.to_possible_value() {
        let _ = writeln!(text, "--sync {}", sync.get_name());
    }
    for camera in hold_out {
        let _ = writeln!(text, "--hold-out {camera}");
    }
    let mut file = |option: &str, given: &str, path: &Path| {
        let _ = writeln!(text, "{option} {given} {}", facts(path));
    };
    for (option, path) in [("--calibration", calibration), ("--body", body)] {
        if let Some(path) = path {
            file(option, &path.display().to_string(), path);
        }
    }
    for (option, each) in [("--view", view), ("--film", film)] {
        for given in each {
            let path = told(given).map_or(given.as_str(), |(_, path)| path);
            file(option, given, Path::new(path));
        }
    }
    match masks {
        Some(path) if path.as_os_str() == BACKGROUND => text.push_str("--masks background\n"),
        Some(path) => file("--masks", &path.display().to_string(), path),
        None => {}
    }
    text
}

/// What the observations of a film depend on; `fov` is the lens's field of view, degrees.
pub fn film(path: &Path, fov: Option<f64>) -> String {
    format!("{}film {}\nlens {fov:?}\n", program(), facts(path))
}

/// The first line that one run has and another has not, shortened to what the user typed.
pub fn difference<'a>(now: &'a str, before: &'a str) -> &'a str {
    let lacks = |all: &str, line: &str| !all.lines().any(|l| l == line);
    let new = now.lines().find(|l| lacks(before, l));
    let line = new.or_else(|| before.lines().find(|l| lacks(now, l)));
    let line = line.unwrap_or("their order");
    line.find(" bytes ").map_or(line, |_| {
        line.split_once(" at ").map_or(line, |(typed, _)| typed)
    })
}

fn program() -> String {
    format!("edgecap {}\n", crate::BUILD)
}

/// Place, size and time of a file, or of all in a folder.
fn facts(path: &Path) -> String {
    let place = path.canonicalize().unwrap_or_else(|_| path.to_owned());
    let Ok(known) = fs::metadata(path) else {
        return format!("at {} 0 bytes none", place.display());
    };
    let facts = match known.is_dir() {
        true => {
            let mut hash = blake3::Hasher::new();
            folder(path, DEEPEST, &mut hash);
            format!("0 bytes {}", &hash.finalize().to_hex()[..16])
        }
        false => of_file(&known),
    };
    format!("at {} {facts}", place.display())
}

fn of_file(known: &Metadata) -> String {
    format!(
        "{} bytes {}.{:09}",
        known.len(),
        known.mtime(),
        known.mtime_nsec()
    )
}

fn folder(path: &Path, deep: usize, hash: &mut blake3::Hasher) {
    let entries = fs::read_dir(path).into_iter().flatten().flatten();
    let mut entries: Vec<_> = entries.map(|e| (e.file_name(), e.path())).collect();
    entries.sort();
    for (name, path) in entries {
        hash.update(name.as_encoded_bytes());
        match fs::metadata(&path) {
            Ok(known) if known.is_dir() && deep > 0 => folder(&path, deep - 1, hash),
            Ok(known) => _ = hash.update(of_file(&known).as_bytes()),
            Err(_) => {}
        }
        hash.update(b"\n");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_known_again_and_told_from_changed_ones() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a b");
        fs::write(&file, "one").unwrap();
        let (first, all) = (facts(&file), facts(folder.path()));
        assert_eq!(
            (facts(&file), facts(folder.path())),
            (first.clone(), all.clone())
        );
        fs::write(&file, "other").unwrap();
        assert_ne!(facts(&file), first);
        assert_ne!(facts(folder.path()), all);
        assert!(facts(&folder.path().join("nowhere")).contains("none"));
    }

    #[test]
    fn what_differs_is_named_as_it_was_typed() {
        let now = "edgecap 1\n--no-dct true\n--view cam01=a b at /x/a b 3 bytes 1.0\n";
        let before = now.replace("3 bytes", "4 bytes");
        assert_eq!(difference(now, &before), "--view cam01=a b");
        assert_eq!(
            difference(now, &now.replace("true", "false")),
            "--no-dct true"
        );
        assert_eq!(difference("x\n", "x\n--fps 3\n"), "--fps 3");
    }

    #[test]
    fn options_are_written_as_they_are_typed() {
        #[derive(clap::Parser)]
        struct Verb {
            #[command(flatten)]
            args: MultiviewArgs,
        }
        let given = |more: &[&str]| {
            let all = [&["multiview", "--view", "a.jsonl", "--out", "run"], more].concat();
            inputs(&<Verb as clap::Parser>::parse_from(all).args)
        };
        let plain = given(&[]);
        for typed in [["--fps", "29.97"], ["--sync", "motion"]] {
            assert_eq!(difference(&given(&typed), &plain), typed.join(" "));
        }
        assert_eq!(difference(&plain, &given(&["--fps", "30"])), "--fps 30");
    }
}
