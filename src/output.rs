//! Files that appear whole or not at all: written beside their place, then renamed.

use std::fs;
use std::io::{self, BufWriter, Write};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;

/// A file being written; it takes its name only on [`finish`](Self::finish) and leaves nothing when dropped before.
#[derive(Debug)]
pub struct AtomicFile {
    /// `None` once the file is finished or given up.
    writer: Option<BufWriter<NamedTempFile>>,
    path: PathBuf,
    /// A folder made for this file alone.
    made: Option<PathBuf>,
}

impl AtomicFile {
    /// Starts writing what will become `path`; missing parent folders are made.
    ///
    /// # Errors
    /// If the folder cannot be made or written.
    pub fn create(path: &Path) -> io::Result<Self> {
        let folder = match path.parent() {
            Some(p) if !p.as_os_str().is_empty() => p,
            _ => Path::new("."),
        };
        let made = (!folder.exists()).then(|| folder.to_owned());
        fs::create_dir_all(folder)?;
        if path.is_dir() {
            return Err(io::Error::new(
                io::ErrorKind::IsADirectory,
                "it is a folder",
            ));
        }
        // Temporary files are private by default; results are as readable as any file the user makes.
        let file = tempfile::Builder::new()
            .prefix(".edgecap-")
            .suffix(".part")
            .permissions(fs::Permissions::from_mode(0o666))
            .tempfile_in(folder)?;
        Ok(Self {
            writer: Some(BufWriter::new(file)),
            path: path.to_owned(),
            made,
        })
    }

    /// Gives the file its name, replacing an older one.
    ///
    /// # Errors
    /// If the disk is full or the rename fails.
    pub fn finish(mut self) -> io::Result<()> {
        if let Some(writer) = self.writer.take() {
            let file = writer
                .into_inner()
                .map_err(io::IntoInnerError::into_error)?;
            file.persist(&self.path).map_err(|e| e.error)?;
            self.made = None;
        }
        Ok(())
    }

    fn inner(&mut self) -> io::Result<&mut BufWriter<NamedTempFile>> {
        self.writer
            .as_mut()
            .ok_or_else(|| io::ErrorKind::NotConnected.into())
    }
}

impl Write for AtomicFile {
    fn write(&mut self, buf: &[u8]) -> io::Result<usize> {
        self.inner()?.write(buf)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.inner()?.flush()
    }
}

impl Drop for AtomicFile {
    fn drop(&mut self) {
        self.writer = None;
        if let Some(folder) = &self.made {
            // Fails when somebody else put something there meanwhile; then it stays.
            let _ = fs::remove_dir(folder);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_finished_file_is_whole_and_alone() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("new/result.txt");
        let mut file = AtomicFile::create(&path).unwrap();
        file.write_all(b"whole").unwrap();
        assert!(!path.exists(), "not before it is whole");
        file.finish().unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"whole");
        assert_eq!(fs::read_dir(path.parent().unwrap()).unwrap().count(), 1);
    }

    #[test]
    fn a_dropped_file_leaves_nothing_and_the_old_one_as_it_was() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("new/result.txt");
        drop(AtomicFile::create(&path).unwrap());
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
        let old = folder.path().join("old.txt");
        fs::write(&old, "old").unwrap();
        let mut file = AtomicFile::create(&old).unwrap();
        file.write_all(b"new").unwrap();
        drop(file);
        assert_eq!(fs::read_to_string(&old).unwrap(), "old");
        assert!(
            AtomicFile::create(folder.path()).is_err(),
            "a folder is no file"
        );
    }
}
