//! Names beside a file's own.

use std::ffi::OsString;
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
