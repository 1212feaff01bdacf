//! Whatever was computed is written and complete; then the exit code says what was wrong.

mod films;
mod observations;
mod outputs;
mod photos;
mod signals;
mod streams;

use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use edgecap::capture::demo;

use crate::program::signal;

const SMALL: [&str; 4] = ["--size", "256x160", "--threads", "1"];

fn count(path: &Path) -> usize {
    let text = std::fs::read_to_string(path).unwrap();
    assert!(text.ends_with('\n'));
    let whole = |l: &str| serde_json::from_str::<serde_json::Value>(l).is_ok();
    assert!(text.lines().all(whole), "every line is whole");
    text.lines().count()
}

/// The bundled clip, cut off in the middle.
fn cut_film(folder: &Path) -> PathBuf {
    let path = folder.join("cut.avi");
    std::fs::write(&path, &demo::CLIP[..demo::CLIP.len() / 10]).unwrap();
    path
}

/// A picture of people, as JPEG: the clip's first frame.
fn photo() -> Vec<u8> {
    let at = |needle: &[u8], from: usize| {
        from + demo::CLIP[from..]
            .windows(needle.len())
            .position(|w| w == needle)
            .unwrap()
    };
    let start = at(&[0xFF, 0xD8, 0xFF], 0);
    let end = at(&[0xFF, 0xD9], start) + 2;
    demo::CLIP[start..end].to_vec()
}

/// How a program ended that was stopped when it had written `word`, and all that it wrote.
fn stopped_after(command: &mut Command, word: &str) -> (Output, String) {
    let mut child = command
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut stdout = BufReader::new(child.stdout.take().unwrap());
    let mut seen = String::new();
    while !seen.contains(word) {
        let n = stdout.read_line(&mut seen).unwrap();
        assert!(n > 0, "'{word}' never comes");
    }
    // All that follows does not fit into the pipe: it cannot have ended.
    signal(child.id(), "TERM");
    stdout.read_to_string(&mut seen).unwrap();
    (child.wait_with_output().unwrap(), seen)
}
