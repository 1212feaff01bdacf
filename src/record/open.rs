//! A record's path goes in, its open file comes out. A folder opens as a file does and fails only when it is read: it
//! is refused here.

use std::fs::{File, Metadata};
use std::io::{self, ErrorKind};
use std::path::Path;

/// Opens a record. Of a pipe it waits for whoever writes to it.
///
/// # Errors
/// The system's, and those of [`expect_no_folder`].
pub fn open(path: &Path) -> io::Result<File> {
    let file = File::open(path)?;
    expect_no_folder(&file.metadata()?)?;
    Ok(file)
}

/// Refuses a folder in place of a record, by what is known of it.
///
/// # Errors
/// [`ErrorKind::IsADirectory`] for a folder.
pub fn expect_no_folder(found: &Metadata) -> io::Result<()> {
    match found.is_dir() {
        true => Err(io::Error::new(
            ErrorKind::IsADirectory,
            "expected a record, found a folder",
        )),
        false => Ok(()),
    }
}
