//! Whole files at once: a path and bytes go in, the file has its name.

use std::io::{self, Write};
use std::path::Path;

use super::AtomicFile;

/// Writes a whole file, replacing an older one; missing parent folders are made.
///
/// # Errors
/// Those of [`AtomicFile::create`] and [`AtomicFile::finish`], or of writing.
pub fn write(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut file = AtomicFile::create(path)?;
    file.write_all(bytes)?;
    file.finish()
}

/// As [`write`](write()), of what is worth nothing after a power cut: the disk is not waited for.
///
/// # Errors
/// As there.
pub fn write_passing(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut file = AtomicFile::create(path)?.passing();
    file.is_kept = false;
    file.write_all(bytes)?;
    file.finish()
}
