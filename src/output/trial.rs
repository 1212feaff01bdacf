//! Whether a file could be made, before there is anything to write.

use std::fs;
use std::io;
use std::path::Path;

use super::link::{behind_links, descriptor};
use super::mount::expect_replaceable;
use super::parent::nearest_folder;
use super::unfinished::unnamed;

/// Begins a file where `path`, or the first of its folders that is missing, would be made, and leaves nothing.
///
/// # Errors
/// The system's, or that what is there cannot be replaced.
pub fn try_place(path: &Path) -> io::Result<()> {
    if descriptor(path).is_some() {
        return Ok(());
    }
    let path = &behind_links(path)?;
    match fs::metadata(path) {
        Ok(there) if there.is_dir() => {
            let what = "it is a folder";
            return Err(io::Error::new(io::ErrorKind::IsADirectory, what));
        }
        // A device or a pipe, which whoever reads it may not have opened yet.
        Ok(there) if !there.is_file() => return Ok(()),
        _ => expect_replaceable(path)?,
    }
    tempfile::tempfile_in(nearest_folder(path))
        .map(drop)
        .map_err(unnamed)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_tried_and_left_as_they_were() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        try_place(&at("a.jsonl")).unwrap();
        try_place(&at("new/folder/a.jsonl")).unwrap();
        try_place(Path::new("/dev/null")).unwrap();
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
        fs::write(at("file"), "").unwrap();
        assert!(try_place(&at("file/a.jsonl")).is_err());
        assert!(try_place(folder.path()).is_err());
        assert!(try_place(Path::new("/proc/nowhere/a.jsonl")).is_err());
    }
}
