//! Whether a file that is written for long is still where its name says.

use std::fs::{self, File};
use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::Path;

/// Whether an open file is still the one that was written: nobody has removed it or cut it below `least` bytes, nor,
/// which is looked at only `by_name`, moved it from `path` or put another in its place.
///
/// # Errors
/// Those of the file.
pub fn is_in_place(file: &File, path: &Path, least: u64, by_name: bool) -> io::Result<bool> {
    let ours = file.metadata()?;
    if ours.nlink() == 0 || ours.len() < least {
        return Ok(false);
    }
    if !by_name {
        return Ok(true);
    }
    Ok(match fs::metadata(path) {
        // Some file systems number a file anew now and then.
        Ok(found) => {
            (found.dev(), found.ino()) == (ours.dev(), ours.ino()) || found.len() == ours.len()
        }
        Err(e) => !matches!(
            e.kind(),
            io::ErrorKind::NotFound | io::ErrorKind::NotADirectory
        ),
    })
}
