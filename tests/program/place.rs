//! A test with shared memory of its own, so that nothing of other tests is counted.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// The variable that names the runtime folder.
const VARIABLE: &str = "EDGECAP_RUNTIME_DIR";
/// Set where a test runs in its own place already.
const INSIDE: &str = "EDGECAP_TEST_PLACE";

/// Where a stream's file holds the number of its messages (clients/rust/src/ring).
const COUNT_AT: u64 = 32;

/// The runtime folder of this test, or `None` when the test was run again in a process of its own, with a folder of its
/// own, and has passed there.
pub fn own_place(test: &str) -> Option<PathBuf> {
    if let Some(folder) = std::env::var_os(INSIDE) {
        return Some(folder.into());
    }
    let folder = super::short_folder();
    let mut child = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", test, "--ignored", "--nocapture"])
        .env(VARIABLE, folder.path())
        .env(INSIDE, folder.path())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut has_passed = false;
    for line in BufReader::new(child.stdout.take().unwrap()).lines() {
        let line = line.unwrap();
        // Its result is part of this test's, and counted there.
        let indent = if line.starts_with("test result:") {
            "  "
        } else {
            ""
        };
        println!("{indent}{line}");
        has_passed |= line.contains(" 1 passed");
    }
    let status = child.wait().unwrap();
    assert!(status.success(), "{test} failed in its own place");
    assert!(has_passed, "{test}: no test has this name");
    None
}

/// A number from the environment, else the default.
pub fn number(variable: &str, default: u64) -> u64 {
    std::env::var(variable).map_or(default, |text| {
        text.parse()
            .unwrap_or_else(|_| panic!("{variable}: expected a number, found '{text}'"))
    })
}

/// Everything that the installation of this folder has: its shared memory lies there as files.
pub fn objects(folder: &Path) -> Vec<String> {
    let mut found = Vec::new();
    files(folder, &mut found);
    found.sort();
    found
}

fn files(folder: &Path, found: &mut Vec<String>) {
    // What goes away meanwhile is not there.
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        if path.is_dir() {
            files(&path, found);
        } else {
            found.push(path.display().to_string());
        }
    }
}

/// How many messages the publisher of a camera's stream has written into the stream's file.
pub fn messages_written(folder: &Path, camera: &str, stream: &str) -> u64 {
    use std::os::unix::fs::FileExt;
    let start = format!("{camera}.{stream}.v");
    let files = std::fs::read_dir(folder).unwrap().flatten();
    let ours = |f: &std::fs::DirEntry| f.file_name().to_string_lossy().starts_with(&start);
    let file = files
        .filter(ours)
        .map(|f| f.path())
        .next()
        .expect("a stream");
    let mut count = [0; 8];
    let file = std::fs::File::open(file).unwrap();
    file.read_exact_at(&mut count, COUNT_AT).unwrap();
    u64::from_ne_bytes(count)
}

/// Open descriptors of a process.
pub fn descriptors(pid: u32) -> usize {
    std::fs::read_dir(format!("/proc/{pid}/fd")).map_or(0, Iterator::count)
}

/// Memory that a process has of its own and cannot give back, kilobytes.
pub fn memory(pid: u32) -> u64 {
    let text = std::fs::read_to_string(format!("/proc/{pid}/status")).unwrap_or_default();
    let line = text.lines().find_map(|l| l.strip_prefix("RssAnon:"));
    line.and_then(|l| l.split_whitespace().next()?.parse().ok())
        .unwrap_or(0)
}
