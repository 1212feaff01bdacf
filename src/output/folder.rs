//! Folders that appear whole or not at all.

use std::ffi::OsString;
use std::fs;
use std::io;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use tempfile::TempDir;

use super::mount::realm;
use super::unfinished::{builder, unnamed};
use super::{MadeFolders, kept, parent};

/// A folder being filled; it takes its name only on [`finish`](Self::finish) and leaves nothing when dropped before.
#[derive(Debug)]
pub struct AtomicFolder {
    beside: TempDir,
    path: PathBuf,
    /// Made for this folder alone. After what lies in them: that goes first.
    made: MadeFolders,
}

impl AtomicFolder {
    /// Starts what will become `path`; missing parent folders are made.
    ///
    /// # Errors
    /// If the parent folder cannot be made or written.
    pub fn create(path: &Path) -> io::Result<Self> {
        let folder = parent(path);
        let made = MadeFolders::make(folder)?;
        // Nothing can be moved from one disk or mount to another.
        let in_itself =
            realm(path).is_ok_and(|its| realm(folder).is_ok_and(|around| around != its));
        let mut this = Self::create_in(if in_itself { path } else { folder }, path)?;
        this.made = made;
        Ok(this)
    }

    /// As [`create`](Self::create), filled in a folder on the same disk.
    ///
    /// # Errors
    /// If that folder cannot be written.
    pub fn create_in(folder: &Path, path: &Path) -> io::Result<Self> {
        let beside = builder()
            .permissions(fs::Permissions::from_mode(0o777))
            .tempdir_in(folder)
            .map_err(unnamed)?;
        Ok(Self {
            beside,
            path: path.to_owned(),
            made: MadeFolders::default(),
        })
    }

    /// Where to put what belongs into the folder.
    pub fn beside(&self) -> &Path {
        self.beside.path()
    }

    /// Gives the folder its name. Where there is a folder of that name, what was made goes into it, one file after the
    /// other, and nothing there is replaced.
    ///
    /// # Errors
    /// If something else of that name, or of a file's, is there. What was made is kept and named: it may have taken
    /// hours.
    pub fn finish(mut self) -> io::Result<()> {
        self.made.keep();
        let made = self.beside.keep();
        let moved = match fs::rename(&made, &self.path) {
            Err(_) if self.path.is_dir() => fill(&made, &self.path),
            moved => moved,
        };
        moved.map_err(|e| kept::error(e, made))
    }
}

/// Moves everything from the one folder into the other, or nothing where a name is taken.
fn fill(made: &Path, folder: &Path) -> io::Result<()> {
    let entries = fs::read_dir(made)?.map(|e| e.map(|e| e.file_name()));
    let names = entries.collect::<io::Result<Vec<_>>>()?;
    let is_taken = |name: &&OsString| fs::symlink_metadata(folder.join(name)).is_ok();
    if let Some(taken) = names.iter().find(is_taken) {
        let found = format!("{} is there already", taken.display());
        return Err(io::Error::new(io::ErrorKind::AlreadyExists, found));
    }
    for name in &names {
        fs::rename(made.join(name), folder.join(name))?;
    }
    fs::remove_dir(made)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_appears_filled_and_only_where_nothing_is() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("new/album");
        let album = AtomicFolder::create(&path).unwrap();
        fs::write(album.beside().join("a"), "a").unwrap();
        assert!(!path.exists());
        album.finish().unwrap();
        assert_eq!(fs::read_to_string(path.join("a")).unwrap(), "a");
        drop(AtomicFolder::create(&path).unwrap());
        assert_eq!(fs::read_dir(path.parent().unwrap()).unwrap().count(), 1);
        drop(AtomicFolder::create(&folder.path().join("other/deeper/album")).unwrap());
        assert!(!folder.path().join("other").exists());
    }

    #[test]
    fn a_folder_in_which_something_is_takes_what_was_made_and_loses_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("album");
        let album = AtomicFolder::create(&path).unwrap();
        fs::write(album.beside().join("a"), "new").unwrap();
        fs::create_dir(&path).unwrap();
        fs::write(path.join("other"), "old").unwrap();
        album.finish().unwrap();
        assert_eq!(fs::read_to_string(path.join("a")).unwrap(), "new");
        assert_eq!(fs::read_to_string(path.join("other")).unwrap(), "old");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);

        // A name that is taken: hours of work must not be thrown away for it.
        let again = AtomicFolder::create(&path).unwrap();
        let made = again.beside().to_owned();
        for name in ["a", "b"] {
            fs::write(made.join(name), "newer").unwrap();
        }
        let e = again.finish().unwrap_err().to_string();
        assert!(e.contains("a is there already"), "{e}");
        assert!(e.contains(&made.display().to_string()), "{e}");
        assert_eq!(fs::read_to_string(path.join("a")).unwrap(), "new");
        assert!(!path.join("b").exists(), "all or nothing");
        assert_eq!(fs::read_to_string(made.join("b")).unwrap(), "newer");
        let file = folder.path().join("file");
        fs::write(&file, "a file").unwrap();
        let third = AtomicFolder::create(&file).unwrap();
        let made = third.beside().to_owned();
        assert!(third.finish().is_err() && made.is_dir(), "it is a file");
    }
}
