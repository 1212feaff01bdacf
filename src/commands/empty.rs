//! Folders for results: new ones, or such as hold nothing.

use std::fs::DirEntry;
use std::io::ErrorKind;
use std::path::Path;

use super::exit::Failure;

/// Refuses a folder that holds anything but what `may_stay`, before any work is done.
///
/// # Errors
/// Exit code 73 where it does, or where there is something else of this name.
pub fn expect_empty(out: &Path, may_stay: impl Fn(&DirEntry) -> bool) -> anyhow::Result<()> {
    let mut entries = match std::fs::read_dir(out) {
        Ok(entries) => entries,
        Err(e) if e.kind() == ErrorKind::NotFound => return Ok(()),
        Err(e) => return Err(Failure::output(out, &e).into()),
    };
    if entries.any(|e| e.is_ok_and(|e| !may_stay(&e))) {
        return Err(Failure::exists(format!(
            "expected a new or empty folder, but {} holds files; choose another --out",
            out.display()
        ))
        .into());
    }
    Ok(())
}
