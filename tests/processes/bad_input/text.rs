//! Arguments of other bytes than text.

use std::ffi::OsStr;
use std::os::unix::ffi::OsStrExt;

use crate::program::{assert_fails, edgecap, stderr};

/// What no text in UTF-8 holds.
fn other_bytes() -> &'static OsStr {
    OsStr::from_bytes(b"x\xff")
}

/// Names of files need not be UTF-8.
#[test]
fn arguments_of_other_bytes_are_answered_as_any_other() {
    let other = other_bytes();
    let out = edgecap()
        .args(["run", "film.avi"])
        .arg(other)
        .output()
        .unwrap();
    let said = stderr(&out);
    assert_eq!(out.status.code(), Some(64), "{said}");
    assert_eq!(said.lines().count(), 1, "{said}");
    let out = edgecap()
        .args(["run", "--input"])
        .arg(other)
        .output()
        .unwrap();
    let said = stderr(&out);
    assert_eq!(out.status.code(), Some(64), "{said}");
    assert!(said.contains("--input: expected a path in UTF-8"), "{said}");
    assert_eq!(said.lines().count(), 1, "{said}");
    // What settings hold, too.
    for option in [
        "--jsonl",
        "--record",
        "--model",
        "--stage2",
        "--flight",
        "--calibration",
    ] {
        let run = edgecap()
            .args(["run", "--input", "demo", option])
            .arg(other)
            .output();
        let run = run.unwrap();
        let said = stderr(&run);
        assert_eq!(run.status.code(), Some(64), "{said}");
        let words = format!("{option}: expected a path in UTF-8");
        assert!(said.contains(&words), "{said}");
        assert_fails(&["run", "--input", "demo", option, ""], 64, &[option]);
    }
}

/// Paths may be of any bytes for the most part: what must be text is named.
#[test]
fn options_that_must_be_text_are_named_where_they_are_of_other_bytes() {
    let other = other_bytes();
    let refused = |args: &[&OsStr], option: &str| {
        let out = edgecap().args(args).output().unwrap();
        let said = stderr(&out);
        assert_eq!(out.status.code(), Some(64), "{said}");
        assert_eq!(said.lines().count(), 1, "{said}");
        let words = format!("{option}: expected text in UTF-8, found x\u{fffd}; name it otherwise");
        assert!(said.contains(&words), "{said}");
    };
    for (verb, option) in [
        ("run", "--name"),
        ("run", "--camera"),
        ("watch", "--name"),
        ("view", "--camera"),
        ("calibrate", "--view"),
        ("multiview", "--view"),
        ("fit", "--fit-config"),
    ] {
        let words = [verb, option].map(OsStr::new);
        refused(&[words[0], words[1], other], option);
        let joined = [format!("{option}=").as_bytes(), other.as_bytes()].concat();
        refused(&[words[0], OsStr::from_bytes(&joined)], option);
    }
    // Not the path before it, which may be so.
    let words = ["multiview", "--out", "--view"].map(OsStr::new);
    refused(&[words[0], words[1], other, words[2], other], "--view");
}
