//! One file: bytes go in, and it has its name once it is whole, or sooner where it grows without end.

mod appear;
mod finish;
mod place;
mod records;

use std::collections::VecDeque;
use std::fs::{self, File};
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::path::{Path, PathBuf};

use self::place::Place;
use super::unfinished::{builder, unnamed};
use super::{MadeFolders, device, link, mount, parent};

/// How a file comes onto the disk.
type Bring = fn(&File) -> io::Result<()>;

/// A file being written; it takes its name only on [`finish`](Self::finish) and leaves nothing when dropped before,
/// unless it is to [`appear`](Self::appear) sooner.
#[derive(Debug)]
pub struct AtomicFile {
    /// `None` once the file is finished or given up.
    writer: Option<BufWriter<Place>>,
    path: PathBuf,
    /// Made for this file alone.
    made: MadeFolders,
    /// Bytes taken so far.
    taken: u64,
    /// Where the newest records end that may not be on the disk yet.
    whole: VecDeque<u64>,
    /// What was to follow never came.
    is_broken: bool,
    /// Why a write failed since [`go_back`](Self::go_back), if one did: a part of what it was given may be in the file.
    failed: Option<io::Error>,
    /// Before the file has its name.
    bring: Bring,
    /// Somebody wants it: where it cannot have its name, it stays under another.
    pub(super) is_kept: bool,
}

impl AtomicFile {
    /// Starts writing what will become `path`; missing parent folders are made. A device or pipe of that name gets the
    /// bytes at once, as does standard output, whose name is `-`, and any other descriptor that is named.
    ///
    /// # Errors
    /// If the folder cannot be made or written, if a link leads into a folder that is missing, if what is there cannot
    /// be replaced, or if nobody reads from the pipe.
    pub fn create(path: &Path) -> io::Result<Self> {
        if let Some(number) = link::descriptor(path) {
            let same = device::opened_before(number, path)?;
            return Ok(Self::new(Place::Device(same), path));
        }
        let path = &link::behind_links(path)?;
        if fs::metadata(path).is_ok_and(|m| !m.is_file() && !m.is_dir()) {
            return Ok(Self::new(Place::Device(device::open(path)?), path));
        }
        let mut this = Self::replacing_links(path)?;
        this.is_kept = true;
        Ok(this)
    }

    /// As [`create`](Self::create), for a name that nobody has given: a link of this name is replaced, so that what it
    /// leads to stays, and so is a device or pipe. A file that cannot have the name in the end goes.
    ///
    /// # Errors
    /// If the folder cannot be made or written, or what is there cannot be replaced.
    pub fn replacing_links(path: &Path) -> io::Result<Self> {
        let folder = parent(path);
        let made = MadeFolders::make(folder)?;
        if path.is_dir() && !path.is_symlink() {
            return Err(io::Error::new(
                io::ErrorKind::IsADirectory,
                "it is a folder",
            ));
        }
        mount::expect_replaceable(path)?;
        // Temporary files are private by default; results are as readable as any file the user makes, and not by more
        // than what they replace.
        let mode = fs::symlink_metadata(path).map_or(0o666, |there| (there.mode() | 0o600) & 0o666);
        let file = builder()
            .permissions(fs::Permissions::from_mode(mode))
            .tempfile_in(folder)
            .map_err(unnamed)?;
        // Held for as long as somebody writes to it: `sweep` takes only what nobody holds.
        let _ = file.as_file().try_lock();
        let mut this = Self::new(Place::Beside(file), path);
        this.made = made;
        Ok(this)
    }

    fn new(place: Place, path: &Path) -> Self {
        Self {
            writer: Some(BufWriter::new(place)),
            path: path.to_owned(),
            made: MadeFolders::default(),
            taken: 0,
            whole: VecDeque::new(),
            is_broken: false,
            failed: None,
            bring: File::sync_all,
            is_kept: false,
        }
    }

    /// The same without waiting for the disk: after a power cut the file may be empty. For what is worth nothing then,
    /// and for files by the hundred.
    #[must_use]
    pub fn passing(mut self) -> Self {
        self.bring = |_| Ok(());
        self
    }

    /// Whether what was written may be written over: not in a device or pipe, nor behind what was there before.
    pub fn can_seek(&self) -> bool {
        let place = self.writer.as_ref().map(BufWriter::get_ref);
        matches!(place, Some(Place::Beside(_)))
    }

    /// Bytes that have left the buffer.
    fn on_disk(&self, writer: &BufWriter<Place>) -> u64 {
        self.taken - (writer.buffer().len() as u64).min(self.taken)
    }

    /// Brings everything written so far onto the disk, so that not even a power cut leaves half a file under the name.
    ///
    /// # Errors
    /// If the disk is full or fails.
    pub fn sync(&mut self) -> io::Result<()> {
        let writer = self.inner()?;
        writer.flush()?;
        match writer.get_ref() {
            Place::Beside(file) => file.as_file().sync_all(),
            Place::Named(file) => file.sync_all(),
            Place::Device(_) => Ok(()),
        }
    }

    fn inner(&mut self) -> io::Result<&mut BufWriter<Place>> {
        self.writer
            .as_mut()
            .ok_or_else(|| io::ErrorKind::NotConnected.into())
    }
}

impl Write for AtomicFile {
    fn write(&mut self, buf: &[u8]) -> io::Result<usize> {
        let written = self.inner()?.write(buf);
        match &written {
            Ok(n) => self.taken += *n as u64,
            // Whoever hears of this one tries again.
            Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
            Err(e) => self.failed = Some(copy(e)),
        }
        written
    }

    fn flush(&mut self) -> io::Result<()> {
        self.inner()?.flush()
    }
}

impl Seek for AtomicFile {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.inner()?.seek(to)
    }
}

impl Drop for AtomicFile {
    fn drop(&mut self) {
        if let Some(writer) = self.writer.take() {
            let _ = writer.into_parts();
        }
    }
}

#[cfg(test)]
impl AtomicFile {
    /// The file beside its place, while there is one.
    pub(super) fn beside(&self) -> Option<&tempfile::NamedTempFile> {
        match self.writer.as_ref()?.get_ref() {
            Place::Beside(file) => Some(file),
            Place::Named(_) | Place::Device(_) => None,
        }
    }
}

/// The same error, which is not made to be copied.
fn copy(error: &io::Error) -> io::Error {
    match error.raw_os_error() {
        Some(code) => io::Error::from_raw_os_error(code),
        None => error.kind().into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::write;

    #[test]
    fn what_was_written_can_be_gone_back_to() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        let mut file = AtomicFile::create(&path).unwrap();
        file.write_all(b"....tail").unwrap();
        file.seek(SeekFrom::Start(0)).unwrap();
        file.write_all(b"head").unwrap();
        file.sync().unwrap();
        assert!(!path.exists(), "on the disk, but not by its name");
        file.finish().unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"headtail");
        write(&path, b"other").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"other");
    }

    #[test]
    fn a_file_that_others_may_not_read_is_replaced_by_another_such() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        fs::write(&path, "old").unwrap();
        fs::set_permissions(&path, fs::Permissions::from_mode(0o600)).unwrap();
        write(&path, b"new").unwrap();
        assert_eq!(fs::metadata(&path).unwrap().mode() & 0o777, 0o600);
        assert_eq!(fs::read(&path).unwrap(), b"new");
    }

    #[test]
    fn a_link_stays_a_link() {
        let folder = tempfile::tempdir().unwrap();
        let (file, link) = (folder.path().join("file"), folder.path().join("link"));
        fs::write(&file, "old").unwrap();
        std::os::unix::fs::symlink("file", &link).unwrap();
        write(&link, b"new").unwrap();
        assert!(link.is_symlink());
        assert_eq!(fs::read(&file).unwrap(), b"new");
    }

    #[test]
    fn a_link_whose_name_nobody_gave_is_replaced_and_what_it_leads_to_stays() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::write(at("file"), "old").unwrap();
        fs::create_dir(at("folder")).unwrap();
        for leads_to in ["file", "folder", "away/file", "link"] {
            std::os::unix::fs::symlink(leads_to, at("link")).unwrap();
            let mut file = AtomicFile::replacing_links(&at("link")).unwrap();
            file.write_all(b"new").unwrap();
            file.finish().unwrap();
            assert!(!at("link").is_symlink(), "{leads_to}");
            assert_eq!(fs::read(at("link")).unwrap(), b"new");
            fs::remove_file(at("link")).unwrap();
        }
        assert_eq!(fs::read(at("file")).unwrap(), b"old");
        assert_eq!(fs::read_dir(at("folder")).unwrap().count(), 0);
        assert!(AtomicFile::replacing_links(&at("folder")).is_err());
    }

    #[test]
    fn a_dropped_file_leaves_nothing_and_the_old_one_as_it_was() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["new/result.txt", "new/deeper/result.txt"] {
            drop(AtomicFile::create(&folder.path().join(name)).unwrap());
            assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0, "{name}");
        }
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
