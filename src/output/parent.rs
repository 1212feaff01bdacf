//! Folders around a path, which need not be there.

use std::fs;
use std::path::Path;

/// Folder in which a path's last part lies.
pub fn parent(path: &Path) -> &Path {
    match path.parent() {
        Some(p) if !p.as_os_str().is_empty() => p,
        _ => Path::new("."),
    }
}

/// The folder in which a path's last part lies, or the first around it that is there.
pub(super) fn nearest_folder(path: &Path) -> &Path {
    let mut folders = parent(path).ancestors();
    let there = folders.find(|f| fs::symlink_metadata(f).is_ok());
    there.unwrap_or(Path::new("."))
}
