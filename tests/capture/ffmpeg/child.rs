//! The end of a child, and of what it has started.

use std::path::Path;
use std::time::{Duration, Instant};

use edgecap::capture::{FfmpegSource, Source};

use super::{PICTURE, stand_ins};

/// Whether a process exists and is not a zombie of ours.
fn is_alive(pid: u32) -> bool {
    std::fs::read_to_string(format!("/proc/{pid}/stat")).is_ok()
}

#[test]
fn no_child_is_left_behind() {
    let folder = tempfile::tempdir().unwrap();
    // Writes for ever.
    let programs = stand_ins(
        folder.path(),
        &format!("while :; do {PICTURE}; done"),
        "printf 'stream,2/1,N/A\\n'",
    );
    let mut source = FfmpegSource::open(Path::new("film.mp4"), &programs).unwrap();
    let pid = source.child_id();
    assert!(source.next().unwrap().is_some());
    assert!(is_alive(pid));
    drop(source);
    assert!(!is_alive(pid));
}

/// Some installations call a script `ffmpeg` that starts the real one, which has our pipes, too.
#[test]
fn what_the_child_has_started_ends_with_it() {
    let folder = tempfile::tempdir().unwrap();
    let pid_file = folder.path().join("pid");
    let programs = stand_ins(
        folder.path(),
        &format!(
            "{PICTURE}; sleep 600 & echo $! > {}; wait",
            pid_file.display()
        ),
        "printf 'stream,2/1,N/A\\n'",
    );
    let mut source = FfmpegSource::open(Path::new("film.mp4"), &programs).unwrap();
    assert!(source.next().unwrap().is_some());
    let begun = Instant::now();
    let pid = loop {
        let text = std::fs::read_to_string(&pid_file).unwrap_or_default();
        match text.trim().parse::<u32>() {
            Ok(pid) => break pid,
            Err(_) => assert!(begun.elapsed() < Duration::from_secs(60)),
        }
        std::thread::sleep(Duration::from_millis(5));
    };
    let begun = Instant::now();
    drop(source);
    assert!(
        begun.elapsed() < Duration::from_secs(60),
        "it was waited for"
    );
    // It is not ours to reap, and may be a zombie until its new parent does.
    let is_there = || {
        let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
        let state = stat.rsplit(") ").next().unwrap().chars().next();
        !matches!(state, None | Some('Z' | 'X'))
    };
    while is_there() {
        assert!(begun.elapsed() < Duration::from_secs(60), "it is alive");
        std::thread::sleep(Duration::from_millis(5));
    }
}
