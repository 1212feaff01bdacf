//! What was written and cannot have its name: it is kept beside, and the error says where.

use std::fmt;
use std::fs::{File, Permissions};
use std::io;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use tempfile::{NamedTempFile, PersistError};

use super::suffix::first_free;

/// Why a result has not the name that it was to have, and where it lies instead.
#[derive(Debug)]
struct Kept {
    why: io::Error,
    at: PathBuf,
}

impl fmt::Display for Kept {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{}; what was made lies in {}",
            self.why,
            self.at.display()
        )
    }
}

impl std::error::Error for Kept {}

/// The same error of a result that lies at `at`.
pub(super) fn error(why: io::Error, at: PathBuf) -> io::Error {
    io::Error::new(why.kind(), Kept { why, at })
}

/// Where a result lies that could not have its name, and why it could not, where that is what an error tells.
pub fn kept_at(error: &io::Error) -> Option<(&Path, &io::Error)> {
    let kept: &Kept = error.get_ref()?.downcast_ref()?;
    Some((&kept.at, &kept.why))
}

/// As `refused`, of what is not whole: `why` that is. Where the result lies nowhere, `why` alone.
pub(super) fn because(why: io::Error, refused: &io::Error) -> io::Error {
    match kept_at(refused) {
        Some((at, _)) => error(why, at.to_owned()),
        None => why,
    }
}

/// Gives a file its name. One that cannot have it gets the first free one of `NAME-new`, `NAME-new-2` and so on.
///
/// # Errors
/// Where it has another name than its own, which the error tells.
pub(super) fn named(file: NamedTempFile, path: &Path) -> io::Result<File> {
    let refused = match file.persist(path) {
        Ok(named) => return Ok(named),
        Err(refused) => refused,
    };
    let beside = first_free(path, "-new");
    let PersistError { error: why, file } = refused;
    let at = match file.persist(&beside) {
        Ok(_) => beside,
        // Nothing can be renamed there: it stays under the name that it has.
        Err(again) => {
            mark_finished(again.file.as_file());
            again.file.keep().map_err(|e| e.error)?.1
        }
    };
    Err(error(why, at))
}

/// Marks a file as finished, whatever its name says: nobody may write to it any more, and `sweep` leaves such ones.
fn mark_finished(file: &File) {
    // Where modes are not kept, nothing is lost but the mark.
    let _ = file.metadata().and_then(|meta| {
        let mode = meta.permissions().mode() & 0o444;
        file.set_permissions(Permissions::from_mode(mode))
    });
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::io::Write;
    use std::time::UNIX_EPOCH;

    use super::super::unfinished::builder;
    use super::super::{AtomicFile, sweep, write, write_passing};
    use super::*;

    /// The error with which a file ended, where a folder came into its place meanwhile. The folder is gone by then.
    fn obstructed(path: &Path, end: fn(AtomicFile) -> io::Result<()>) -> io::Error {
        let mut file = AtomicFile::create(path).unwrap();
        file.write_all(b"hours of work").unwrap();
        file.mark_whole();
        fs::create_dir(path).unwrap();
        fs::write(path.join("other"), "").unwrap();
        let failed = end(file).unwrap_err();
        fs::remove_dir_all(path).unwrap();
        failed
    }

    #[test]
    fn a_result_that_cannot_have_its_name_lies_beside_it_and_the_error_says_where() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let whole: fn(AtomicFile) -> io::Result<()> = AtomicFile::finish;
        let broken: fn(AtomicFile) -> io::Result<()> = |mut file| {
            file.break_off();
            file.finish()
        };
        for (name, end) in [("a-new.jsonl", whole), ("a-new-2.jsonl", broken)] {
            let failed = obstructed(&at("a.jsonl"), end);
            let words = format!("; what was made lies in {}", at(name).display());
            assert!(failed.to_string().ends_with(&words), "{failed}");
            assert_eq!(kept_at(&failed).unwrap().0, at(name));
            assert_eq!(fs::read_to_string(at(name)).unwrap(), "hours of work");
        }
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
    }

    #[test]
    fn a_result_under_its_temporary_name_is_not_swept() {
        let folder = tempfile::tempdir().unwrap();
        let temporary = || {
            let file = builder().tempfile_in(folder.path()).unwrap();
            file.as_file().set_modified(UNIX_EPOCH).unwrap();
            file
        };
        // Neither of the names can be had there.
        let failed = named(temporary(), &folder.path().join("away/a.jsonl")).unwrap_err();
        let (at, _) = kept_at(&failed).unwrap();
        let (_, left) = temporary().keep().unwrap();
        sweep(&folder.path().join("b.jsonl"));
        assert!(at.exists() && !left.exists());
    }

    #[test]
    fn what_is_worth_nothing_and_what_nobody_named_is_not_kept() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("figures.prom");
        let failed = obstructed(&path, AtomicFile::finish);
        assert!(kept_at(&failed).is_some());
        fs::remove_file(folder.path().join("figures-new.prom")).unwrap();
        let failed = obstructed(&path, |mut file| {
            file.is_kept = false;
            file.finish()
        });
        assert!(kept_at(&failed).is_none(), "{failed}");
        assert!(AtomicFile::create(&path).unwrap().is_kept);
        assert!(!AtomicFile::replacing_links(&path).unwrap().is_kept);
        write(&path, b"1").unwrap();
        write_passing(&path, b"2").unwrap();
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    /// What cannot appear yet is not lost: it has a name in the end, or is kept beside.
    #[test]
    fn a_record_that_cannot_appear_goes_on() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("hall.jsonl");
        let mut file = AtomicFile::create(&path).unwrap();
        file.write_all(b"one\n").unwrap();
        fs::create_dir(&path).unwrap();
        assert!(file.appear().is_err());
        file.write_all(b"two\n").unwrap();
        fs::remove_dir(&path).unwrap();
        file.appear().unwrap();
        file.write_all(b"three\n").unwrap();
        file.finish().unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "one\ntwo\nthree\n");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }
}
