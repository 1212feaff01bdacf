//! Files and folders that appear whole or not at all: written beside their place, then renamed. What is no file, such
//! as `/dev/stdout`, `/dev/null` or a named pipe, is written into as it is; a link stays a link.

mod stump;

use std::collections::VecDeque;
use std::fs::{self, File};
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::os::fd::AsFd;
use std::os::unix::fs::{OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use rustix::fs::OFlags;
use rustix::io::Errno;
use tempfile::{NamedTempFile, TempDir};

/// Start of the names of what is not finished.
const PREFIX: &str = ".edgecap-";
const SUFFIX: &str = ".part";
/// The name of standard output.
pub const STDOUT: &str = "-";
/// More records than a buffer holds need not be known: they are on the disk.
const RECORDS_KEPT: usize = 1024;
/// How long the reader of a pipe may take to open it.
const READER_PATIENCE: Duration = Duration::from_secs(2);

/// Writes a whole file, replacing an older one; missing parent folders are made.
///
/// # Errors
/// Those of [`AtomicFile::create`] and [`AtomicFile::finish`], or of writing.
pub fn write(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut file = AtomicFile::create(path)?;
    file.write_all(bytes)?;
    file.finish()
}

/// Where bytes go until the file is finished.
#[derive(Debug)]
enum Place {
    /// Beside the file's place.
    Beside(NamedTempFile),
    /// A device or pipe that was there before and stays.
    Device(File),
}

impl Write for Place {
    fn write(&mut self, buf: &[u8]) -> io::Result<usize> {
        match self {
            // Not through the temporary file, whose errors name it.
            Self::Beside(file) => file.as_file_mut().write(buf),
            Self::Device(file) => file.write(buf),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match self {
            Self::Beside(file) => file.flush(),
            Self::Device(file) => file.flush(),
        }
    }
}

impl Seek for Place {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        match self {
            Self::Beside(file) => file.seek(to),
            Self::Device(file) => file.seek(to),
        }
    }
}

/// A file being written; it takes its name only on [`finish`](Self::finish) and leaves nothing when dropped before.
#[derive(Debug)]
pub struct AtomicFile {
    /// `None` once the file is finished or given up.
    writer: Option<BufWriter<Place>>,
    path: PathBuf,
    /// A folder made for this file alone.
    made: Option<PathBuf>,
    /// Bytes taken so far.
    taken: u64,
    /// Where the newest records end that may not be on the disk yet.
    whole: VecDeque<u64>,
    /// What was to follow never came.
    is_broken: bool,
}

impl AtomicFile {
    /// Starts writing what will become `path`; missing parent folders are made. A device or pipe of that name gets the
    /// bytes at once, as does standard output, whose name is `-`.
    ///
    /// # Errors
    /// If the folder cannot be made or written, or if nobody reads from the pipe.
    pub fn create(path: &Path) -> io::Result<Self> {
        if path.as_os_str() == STDOUT {
            let stdout = io::stdout().as_fd().try_clone_to_owned()?;
            return Ok(Self::new(Place::Device(stdout.into()), path, None));
        }
        // Through links, so that none is replaced by a file.
        let found = path.canonicalize();
        let path = found.as_deref().unwrap_or(path);
        if fs::metadata(path).is_ok_and(|m| !m.is_file() && !m.is_dir()) {
            return Ok(Self::new(Place::Device(open_device(path)?), path, None));
        }
        let folder = parent(path);
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
            .prefix(PREFIX)
            .suffix(SUFFIX)
            .permissions(fs::Permissions::from_mode(0o666))
            .tempfile_in(folder)
            .map_err(unnamed)?;
        Ok(Self::new(Place::Beside(file), path, made))
    }

    fn new(place: Place, path: &Path, made: Option<PathBuf>) -> Self {
        Self {
            writer: Some(BufWriter::new(place)),
            path: path.to_owned(),
            made,
            taken: 0,
            whole: VecDeque::new(),
            is_broken: false,
        }
    }

    /// Says that what was to follow never came: a longer file of the same name then stays, and this one gets another
    /// name beside it.
    pub fn break_off(&mut self) {
        self.is_broken = true;
    }

    /// Whether [`finish`](Self::finish) would leave anything where writing has failed.
    pub fn keeps_anything(&self) -> bool {
        let Some(writer) = &self.writer else {
            return false;
        };
        let on_disk = self.taken - (writer.buffer().len() as u64).min(self.taken);
        let is_whole = |end: &u64| (1..=on_disk).contains(end);
        matches!(writer.get_ref(), Place::Device(_)) || self.whole.iter().any(is_whole)
    }

    /// Says that all bytes so far make whole records: if writing fails later, these are kept. Who reads a pipe has them
    /// now.
    pub fn mark_whole(&mut self) {
        if self.whole.len() == RECORDS_KEPT {
            self.whole.pop_front();
        }
        self.whole.push_back(self.taken);
        if let Some(writer) = &mut self.writer
            && matches!(writer.get_ref(), Place::Device(_))
        {
            // A failure shows at the next write, or at the end.
            let _ = writer.flush();
        }
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
            Place::Device(_) => Ok(()),
        }
    }

    /// Gives the file its name, replacing an older one. Where [`mark_whole`](Self::mark_whole) was called, the file of
    /// a full disk has its name, too, and holds the whole records that found room.
    ///
    /// # Errors
    /// If the disk is full or the rename fails.
    pub fn finish(mut self) -> io::Result<()> {
        let Some(mut writer) = self.writer.take() else {
            return Ok(());
        };
        let flushed = writer.flush();
        // The parts, so that nothing is written behind our back.
        let (place, _) = writer.into_parts();
        let Place::Beside(mut file) = place else {
            return flushed;
        };
        if flushed.is_err() {
            let end = file.stream_position()?;
            let Some(whole) = self.whole.iter().rev().find(|w| **w <= end && **w > 0) else {
                return flushed;
            };
            file.as_file().set_len(*whole)?;
        }
        let path = match flushed.is_err() || self.is_broken {
            true => stump::place(&self.path, file.as_file().metadata()?.len()),
            false => self.path.clone(),
        };
        file.persist(path).map_err(|e| e.error)?;
        self.made = None;
        flushed
    }

    fn inner(&mut self) -> io::Result<&mut BufWriter<Place>> {
        self.writer
            .as_mut()
            .ok_or_else(|| io::ErrorKind::NotConnected.into())
    }
}

impl Write for AtomicFile {
    fn write(&mut self, buf: &[u8]) -> io::Result<usize> {
        let n = self.inner()?.write(buf)?;
        self.taken += n as u64;
        Ok(n)
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
        if let Some(folder) = &self.made {
            // Fails when somebody else put something there meanwhile; then it stays.
            let _ = fs::remove_dir(folder);
        }
    }
}

/// A folder being filled; it takes its name only on [`finish`](Self::finish) and leaves nothing when dropped before.
#[derive(Debug)]
pub struct AtomicFolder {
    beside: TempDir,
    path: PathBuf,
}

impl AtomicFolder {
    /// Starts what will become `path`; missing parent folders are made.
    ///
    /// # Errors
    /// If the parent folder cannot be made or written.
    pub fn create(path: &Path) -> io::Result<Self> {
        let folder = parent(path);
        fs::create_dir_all(folder)?;
        let beside = tempfile::Builder::new()
            .prefix(PREFIX)
            .suffix(SUFFIX)
            .permissions(fs::Permissions::from_mode(0o777))
            .tempdir_in(folder)?;
        Ok(Self {
            beside,
            path: path.to_owned(),
        })
    }

    /// Where to put what belongs into the folder.
    pub fn beside(&self) -> &Path {
        self.beside.path()
    }

    /// Gives the folder its name; an empty folder of that name is replaced.
    ///
    /// # Errors
    /// If there is something else of that name.
    pub fn finish(self) -> io::Result<()> {
        fs::rename(self.beside.path(), &self.path)?;
        // The folder has its final name: nothing is left to clean up.
        let _ = self.beside.keep();
        Ok(())
    }
}

/// The system's own words, without the name of a temporary file, which says nothing to the user.
fn unnamed(error: io::Error) -> io::Error {
    let words = error.to_string();
    match words.split_once(" at path ") {
        Some((words, _)) => io::Error::new(error.kind(), words.to_owned()),
        None => error,
    }
}

/// Opens a device or pipe to write into. Opening a pipe that nobody reads would wait for ever, whatever signal comes.
fn open_device(path: &Path) -> io::Result<File> {
    let began = Instant::now();
    let mut options = File::options();
    options
        .write(true)
        .custom_flags(OFlags::NONBLOCK.bits().cast_signed());
    loop {
        match options.open(path) {
            Ok(device) => {
                rustix::fs::fcntl_setfl(&device, OFlags::empty())?;
                return Ok(device);
            }
            Err(e) if Errno::from_io_error(&e) != Some(Errno::NXIO) => return Err(e),
            Err(e) if began.elapsed() > READER_PATIENCE => {
                return Err(io::Error::new(
                    e.kind(),
                    "nobody reads from this pipe: start its reader first",
                ));
            }
            Err(_) => std::thread::sleep(Duration::from_millis(20)),
        }
    }
}

/// Folder in which a path's last part lies.
pub fn parent(path: &Path) -> &Path {
    match path.parent() {
        Some(p) if !p.as_os_str().is_empty() => p,
        _ => Path::new("."),
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
    fn errors_do_not_name_what_is_only_on_the_way() {
        let e = AtomicFile::create(Path::new("/proc/nothing.jsonl")).unwrap_err();
        assert!(!e.to_string().contains(SUFFIX), "{e}");
    }

    #[test]
    fn a_full_disk_keeps_whole_records_or_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let mut file = AtomicFile::create(&folder.path().join("file")).unwrap();
        file.write_all(b"a record").unwrap();
        file.mark_whole();
        assert!(!file.keeps_anything(), "it lies in memory");
        file.flush().unwrap();
        assert!(file.keeps_anything());
    }

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
    fn a_pipe_gets_the_bytes_and_stays_a_pipe() {
        use std::os::unix::fs::FileTypeExt;
        let folder = tempfile::tempdir().unwrap();
        let pipe = folder.path().join("pipe");
        rustix::fs::mkfifoat(rustix::fs::CWD, &pipe, 0o600.into()).unwrap();
        let reader = std::thread::spawn({
            let pipe = pipe.clone();
            move || fs::read_to_string(pipe).unwrap()
        });
        let mut file = AtomicFile::create(&pipe).unwrap();
        file.write_all(b"line").unwrap();
        file.sync().unwrap();
        file.finish().unwrap();
        assert_eq!(reader.join().unwrap(), "line");
        assert!(fs::metadata(&pipe).unwrap().file_type().is_fifo());
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_pipe_that_nobody_reads_is_an_error_that_says_so() {
        let folder = tempfile::tempdir().unwrap();
        let pipe = folder.path().join("pipe");
        rustix::fs::mkfifoat(rustix::fs::CWD, &pipe, 0o600.into()).unwrap();
        let e = AtomicFile::create(&pipe).unwrap_err();
        assert!(e.to_string().contains("nobody reads"), "{e}");
        assert!(fs::metadata(&pipe).is_ok(), "the pipe stays");
    }

    #[test]
    fn a_folder_appears_filled_and_only_where_nothing_is() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("new/album");
        let album = AtomicFolder::create(&path).unwrap();
        fs::write(album.beside().join("a"), "a").unwrap();
        assert!(!path.exists());
        album.finish().unwrap();
        assert_eq!(fs::read_to_string(path.join("a")).unwrap(), "a");
        let again = AtomicFolder::create(&path).unwrap();
        assert!(again.finish().is_err(), "it holds a file");
        drop(AtomicFolder::create(&path).unwrap());
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
