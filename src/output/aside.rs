//! Older files that make room for a new one of their name.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use rustix::fs::{CWD, RenameFlags};
use rustix::io::Errno;

use super::suffixed;

/// Gives a file that holds anything the first free name of `name-1`, `name-2` and so on; returns that.
///
/// # Errors
/// Those of the rename.
pub fn set_aside(path: &Path) -> io::Result<Option<PathBuf>> {
    if !fs::metadata(path).is_ok_and(|m| m.is_file() && m.len() > 0) {
        return Ok(None);
    }
    for n in 1.. {
        let aside = suffixed(path, &format!("-{n}"));
        if fs::symlink_metadata(&aside).is_ok() {
            continue;
        }
        match move_to_free(path, &aside) {
            Err(e) if e.kind() == io::ErrorKind::AlreadyExists => continue,
            moved => moved?,
        }
        return Ok(Some(aside));
    }
    Ok(None)
}

/// Gives a file another name, which nothing else has.
///
/// # Errors
/// `AlreadyExists` where something has it; those of the rename.
pub(super) fn move_to_free(from: &Path, to: &Path) -> io::Result<()> {
    match rustix::fs::renameat_with(CWD, from, CWD, to, RenameFlags::NOREPLACE) {
        // A file system that knows no such flag.
        Err(Errno::INVAL | Errno::NOSYS) if fs::symlink_metadata(to).is_err() => {
            fs::rename(from, to)
        }
        Err(Errno::INVAL | Errno::NOSYS) => Err(io::ErrorKind::AlreadyExists.into()),
        renamed => Ok(renamed?),
    }
}
