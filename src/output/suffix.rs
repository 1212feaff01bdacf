//! Names beside a file's own.

use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};

/// The name with `suffix` before its ending: `hall.jsonl` and `-1` make `hall-1.jsonl`.
pub fn suffixed(path: &Path, suffix: &str) -> PathBuf {
    let mut name = path.file_stem().unwrap_or_default().to_owned();
    name.push(suffix);
    if let Some(extension) = path.extension() {
        name.push(OsString::from("."));
        name.push(extension);
    }
    path.with_file_name(name)
}

/// The first free one of `NAME-cut`, `NAME-cut-2` and so on, for a `word` of `-cut`.
pub(super) fn first_free(path: &Path, word: &str) -> PathBuf {
    let beside = (1..).map(|n: u32| match n {
        1 => suffixed(path, word),
        n => suffixed(path, &format!("{word}-{n}")),
    });
    let mut free = beside.filter(|p| fs::symlink_metadata(p).is_err());
    free.next().unwrap_or_else(|| path.to_owned())
}
