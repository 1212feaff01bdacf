//! Files and folders that appear whole or not at all: written beside their place, then renamed. What is no file, such
//! as `/dev/null` or a named pipe, is written into as it is, and so is what this process has open already, such as
//! `/dev/stdout`; a link stays a link, but where the program itself chose the name. Before a single file has its name
//! it is on the disk, so that not even a power cut leaves half of it.

mod device;
mod folder;
mod kept;
mod left;
mod link;
mod made;
mod mount;
mod private;
mod stump;
mod suffix;
mod trial;

use std::collections::VecDeque;
use std::fs::{self, File};
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::path::{Path, PathBuf};

use rustix::fs::{CWD, OFlags, RenameFlags, fcntl_getfl, fcntl_setfl};
use rustix::io::Errno;
use tempfile::NamedTempFile;

pub use folder::AtomicFolder;
pub use kept::kept_at;
pub use left::sweep;
pub use link::{is_stdout, steps as link_steps};
pub use made::MadeFolders;
pub use mount::is_read_only;
pub use private::private_beside;
pub use suffix::suffixed;
pub use trial::try_place;

/// Start of the names of what is not finished.
const PREFIX: &str = ".edgecap-";
const SUFFIX: &str = ".part";
/// The name of standard output.
pub const STDOUT: &str = "-";
/// More records than a buffer holds need not be known: they are on the disk.
const RECORDS_KEPT: usize = 1024;

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

/// Whether a name is that of what is not finished.
pub fn is_unfinished(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    name.starts_with(PREFIX) && name.ends_with(SUFFIX)
}

/// How a file comes onto the disk.
type Bring = fn(&File) -> io::Result<()>;

/// Where bytes go until the file is finished.
#[derive(Debug)]
enum Place {
    /// Beside the file's place.
    Beside(NamedTempFile),
    /// In the file's place already.
    Named(File),
    /// A device or pipe that was there before and stays.
    Device(File),
}

impl Write for Place {
    fn write(&mut self, buf: &[u8]) -> io::Result<usize> {
        match self {
            // Not through the temporary file, whose errors name it.
            Self::Beside(file) => file.as_file_mut().write(buf),
            Self::Named(file) | Self::Device(file) => file.write(buf),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match self {
            Self::Beside(file) => file.flush(),
            Self::Named(file) | Self::Device(file) => file.flush(),
        }
    }
}

impl Seek for Place {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        match self {
            Self::Beside(file) => file.seek(to),
            Self::Named(file) | Self::Device(file) => file.seek(to),
        }
    }
}

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
    is_kept: bool,
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
        let file = tempfile::Builder::new()
            .prefix(PREFIX)
            .suffix(SUFFIX)
            .permissions(fs::Permissions::from_mode(mode))
            .tempfile_in(folder)
            .map_err(unnamed)?;
        // Held for as long as somebody writes to it: `sweep` takes only what nobody holds.
        let _ = file.as_file().try_lock();
        let mut this = Self::new(Place::Beside(file), path);
        this.made = made;
        Ok(this)
    }

    /// Gives the file its name now and goes on writing to it, for what has no end: whatever ends the process, what was
    /// written is there. An older file of that name that holds anything is set aside, and its new name returned.
    ///
    /// # Errors
    /// If the disk is full, or a rename fails; then it goes on without its name, and the older file keeps its own.
    pub fn appear(&mut self) -> io::Result<Option<PathBuf>> {
        match &mut self.writer {
            Some(writer) if matches!(writer.get_ref(), Place::Beside(_)) => writer.flush()?,
            _ => return Ok(None),
        }
        let older = set_aside(&self.path)?;
        let Some((Place::Beside(file), _)) = self.writer.take().map(BufWriter::into_parts) else {
            return Ok(older);
        };
        let named = match file.persist(&self.path) {
            Ok(named) => named,
            Err(refused) => {
                self.writer = Some(BufWriter::new(Place::Beside(refused.file)));
                if let Some(older) = &older {
                    // Where that is refused, too, it lies under the other name.
                    let _ = move_to_free(older, &self.path);
                }
                return Err(refused.error);
            }
        };
        // Where somebody empties it, what follows begins at its start, and not behind as many zeros as it was long.
        fcntl_setfl(&named, fcntl_getfl(&named)? | OFlags::APPEND)?;
        self.writer = Some(BufWriter::new(Place::Named(named)));
        self.made.keep();
        Ok(older)
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

    /// Says that what was to follow never came: a longer file of the same name then stays, and this one gets another
    /// name beside it.
    pub fn break_off(&mut self) {
        self.is_broken = true;
    }

    /// Whether a file that has [appeared](Self::appear) holds what was written: nobody has removed or cut it, nor,
    /// which is looked at only `by_name`, moved it or put another in its place. Any other file does.
    ///
    /// # Errors
    /// Those of the file.
    pub fn is_intact(&self, by_name: bool) -> io::Result<bool> {
        let Some(writer) = &self.writer else {
            return Ok(true);
        };
        let Place::Named(file) = writer.get_ref() else {
            return Ok(true);
        };
        is_in_place(file, &self.path, self.on_disk(writer), by_name)
    }

    /// Bytes that have left the buffer.
    fn on_disk(&self, writer: &BufWriter<Place>) -> u64 {
        self.taken - (writer.buffer().len() as u64).min(self.taken)
    }

    /// Whether [`finish`](Self::finish) would leave anything where writing has failed.
    pub fn keeps_anything(&self) -> bool {
        let Some(writer) = &self.writer else {
            return false;
        };
        let on_disk = self.on_disk(writer);
        let is_whole = |end: &u64| (1..=on_disk).contains(end);
        matches!(writer.get_ref(), Place::Device(_) | Place::Named(_))
            || self.whole.iter().any(is_whole)
    }

    /// After a failure: goes back to the last whole record, so that writing can be tried again. Whether there is
    /// anything to go on with: not where no record has found room before the file [appeared](Self::appear), nor where
    /// somebody has removed it to make room.
    ///
    /// # Errors
    /// Those of the file.
    pub fn go_back(&mut self) -> io::Result<bool> {
        let Some(writer) = self.writer.take() else {
            return Ok(false);
        };
        self.failed = None;
        // The parts, so that nothing is written behind our back.
        let (place, _) = writer.into_parts();
        let writer = self.writer.insert(BufWriter::new(place));
        let (file, path) = match writer.get_mut() {
            // What went into it is gone.
            Place::Device(_) => return Ok(true),
            Place::Named(file) => (file, None),
            Place::Beside(file) => {
                let path = file.path().to_owned();
                (file.as_file_mut(), Some(path))
            }
        };
        let end = written_to(file)?;
        let whole = self.whole.iter().rev().find(|w| **w <= end).copied();
        let whole = whole.unwrap_or_default();
        file.set_len(whole)?;
        file.seek(SeekFrom::Start(whole))?;
        self.taken = whole;
        self.whole.retain(|w| *w <= whole);
        match path {
            None => Ok(file.metadata()?.nlink() > 0),
            // Its name it can only get from the one that it has.
            Some(path) => Ok(whole > 0 && is_in_place(file, &path, whole, true)?),
        }
    }

    /// Says that all bytes so far make whole records: if writing fails later, these are kept. Who reads a pipe, or a
    /// file that has appeared, has them now.
    pub fn mark_whole(&mut self) {
        if self.whole.len() == RECORDS_KEPT {
            self.whole.pop_front();
        }
        self.whole.push_back(self.taken);
        if let Some(writer) = &mut self.writer
            && matches!(writer.get_ref(), Place::Named(_) | Place::Device(_))
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
            Place::Named(file) => file.sync_all(),
            Place::Device(_) => Ok(()),
        }
    }

    /// Gives the file its name once it is on the disk, replacing an older one. Where [`mark_whole`](Self::mark_whole)
    /// was called, the file of a full disk has its name, too, and holds the whole records that found room.
    ///
    /// # Errors
    /// If the disk is full or fails, or the rename does: [`kept_at`] says where the file lies then.
    pub fn finish(self) -> io::Result<()> {
        self.finish_beside().map(drop)
    }

    /// As [`finish`](Self::finish); the name that the file got in place of its own, where what is there holds more than
    /// what [broke off](Self::break_off).
    ///
    /// # Errors
    /// As there.
    pub fn finish_beside(mut self) -> io::Result<Option<PathBuf>> {
        let Some(mut writer) = self.writer.take() else {
            return Ok(None);
        };
        // What a failed write left of a record is in the file, not in the buffer, which may have nothing to flush.
        let flushed = writer.flush().and(self.failed.take().map_or(Ok(()), Err));
        // The parts, so that nothing is written behind our back.
        let (mut place, _) = writer.into_parts();
        let bring = self.bring;
        // A disk of another machine may say only now that it is full.
        let flushed = flushed.and_then(|()| match &place {
            Place::Beside(file) => bring(file.as_file()),
            Place::Named(_) | Place::Device(_) => Ok(()),
        });
        if flushed.is_err() {
            let file = match &mut place {
                Place::Beside(file) => file.as_file_mut(),
                Place::Named(file) => file,
                Place::Device(_) => return flushed.map(|()| None),
            };
            let end = written_to(file)?;
            let Some(whole) = self.whole.iter().rev().find(|w| **w <= end && **w > 0) else {
                return flushed.map(|()| None);
            };
            file.set_len(*whole)?;
        }
        let mut beside = None;
        if let Place::Beside(mut file) = place {
            let path = match flushed.is_err() || self.is_broken {
                true => stump::place(&self.path, file.as_file_mut()),
                false => self.path.clone(),
            };
            if flushed.is_err() {
                // What is wrong with the disk is said already.
                let _ = bring(file.as_file());
            }
            let named = match self.is_kept {
                true => kept::named(file, &path),
                false => file.persist(&path).map_err(|e| e.error),
            };
            if let Err(refused) = named {
                return Err(match flushed {
                    Ok(()) => refused,
                    // What lies elsewhere is not whole.
                    Err(why) => kept::because(why, &refused),
                });
            }
            self.made.keep();
            beside = Some(path).filter(|p| *p != self.path);
        }
        flushed.map(|()| beside)
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

/// Up to where a file holds what was written to it: somebody may have cut it since, and it is not to be made longer.
fn written_to(file: &mut File) -> io::Result<u64> {
    Ok(file.stream_position()?.min(file.metadata()?.len()))
}

/// The same error, which is not made to be copied.
fn copy(error: &io::Error) -> io::Error {
    match error.raw_os_error() {
        Some(code) => io::Error::from_raw_os_error(code),
        None => error.kind().into(),
    }
}

/// The system's own error, without the name of a temporary file, which says nothing to the user. With that name it does
/// not have its number, which is all that tells of some what they are.
pub(crate) fn unnamed(error: io::Error) -> io::Error {
    let words = error.to_string();
    let Some((words, _)) = words.split_once(" at path ") else {
        return error;
    };
    let number = words
        .rsplit_once("(os error ")
        .and_then(|(_, number)| number.strip_suffix(')')?.parse().ok());
    match number {
        Some(number) => io::Error::from_raw_os_error(number),
        None => io::Error::new(error.kind(), words.to_owned()),
    }
}

/// Gives a file that holds anything the first free name of `name-1`, `name-2` and so on; returns that.
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
fn move_to_free(from: &Path, to: &Path) -> io::Result<()> {
    match rustix::fs::renameat_with(CWD, from, CWD, to, RenameFlags::NOREPLACE) {
        // A file system that knows no such flag.
        Err(Errno::INVAL | Errno::NOSYS) if fs::symlink_metadata(to).is_err() => {
            fs::rename(from, to)
        }
        Err(Errno::INVAL | Errno::NOSYS) => Err(io::ErrorKind::AlreadyExists.into()),
        renamed => Ok(renamed?),
    }
}

/// What is wrong and what to do, where an error says that nothing more finds room.
pub fn no_room(error: &io::Error) -> Option<&'static str> {
    if is_limited(error) {
        return Some(
            "the system lets no file become longer: raise the limit (ulimit -f, LimitFSIZE=)",
        );
    }
    match error.kind() {
        io::ErrorKind::StorageFull => Some("the disk is full: make room"),
        io::ErrorKind::QuotaExceeded => Some("the quota on the disk is used up: make room"),
        _ => None,
    }
}

/// Whether a format has no room for more, such as an AVI of 1 GiB, and not the system.
pub fn is_full(error: &io::Error) -> bool {
    error.kind() == io::ErrorKind::FileTooLarge && !is_limited(error)
}

/// Whether the system's limit on the length of files was met.
fn is_limited(error: &io::Error) -> bool {
    error.raw_os_error() == Some(Errno::FBIG.raw_os_error())
}

/// Folder in which a path's last part lies.
pub fn parent(path: &Path) -> &Path {
    match path.parent() {
        Some(p) if !p.as_os_str().is_empty() => p,
        _ => Path::new("."),
    }
}

/// The folder in which a path's last part lies, or the first around it that is there.
fn nearest_folder(path: &Path) -> &Path {
    let mut folders = parent(path).ancestors();
    let there = folders.find(|f| fs::symlink_metadata(f).is_ok());
    there.unwrap_or(Path::new("."))
}

#[cfg(test)]
mod tests {
    use std::cell::RefCell;

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

    thread_local! {
        /// A result; whether it had its name, and how long it was, each time it was brought onto the disk.
        static BROUGHT: RefCell<(PathBuf, Vec<(bool, u64)>)> = RefCell::default();
    }

    fn seen(file: &File) -> io::Result<()> {
        let length = file.metadata()?.len();
        BROUGHT.with_borrow_mut(|(path, brought)| brought.push((path.exists(), length)));
        Ok(())
    }

    #[test]
    fn a_file_is_on_the_disk_before_it_has_its_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("result.txt");
        BROUGHT.set((path.clone(), Vec::new()));
        let begun = |bring: Bring| {
            let mut file = AtomicFile::create(&path).unwrap();
            file.bring = bring;
            file.write_all(b"whole").unwrap();
            file
        };
        begun(seen).finish().unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"whole");
        begun(seen).passing().finish().unwrap();
        let (_, brought) = BROUGHT.take();
        assert_eq!(brought, [(false, 5)]);
        fs::write(&path, "older").unwrap();
        let failed = begun(|_| Err(io::Error::other("no disk"))).finish();
        assert_eq!(failed.unwrap_err().to_string(), "no disk");
        assert_eq!(fs::read(&path).unwrap(), b"older");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn errors_do_not_name_what_is_only_on_the_way() {
        let file = AtomicFile::create(Path::new("/proc/nothing.jsonl")).unwrap_err();
        let folder = AtomicFolder::create(Path::new("/proc/nothing")).unwrap_err();
        for e in [file, folder] {
            assert!(!e.to_string().contains(SUFFIX), "{e}");
        }
    }

    #[test]
    fn errors_of_temporary_files_keep_the_system_s_number() {
        let folder = tempfile::tempdir().unwrap();
        let nowhere = folder.path().join("nowhere");
        let refused = tempfile::Builder::new().tempfile_in(nowhere).unwrap_err();
        let e = unnamed(refused);
        assert_eq!(Errno::from_io_error(&e), Some(Errno::NOENT), "{e}");
        for words in ["of no system", "(os error x)", "os error 5)"] {
            let named = format!("{words} at path \"/srv/a\"");
            let e = unnamed(io::Error::other(named));
            assert_eq!((e.raw_os_error(), e.to_string()), (None, words.to_owned()));
        }
    }

    #[test]
    fn what_lies_in_memory_is_not_kept() {
        let folder = tempfile::tempdir().unwrap();
        let mut file = AtomicFile::create(&folder.path().join("file")).unwrap();
        file.write_all(b"a record").unwrap();
        file.mark_whole();
        assert!(!file.keeps_anything());
        file.flush().unwrap();
        assert!(file.keeps_anything());
    }

    /// A file that takes so many bytes and no more, as on a disk that is full then.
    fn full_at(bytes: u64) -> File {
        use rustix::fs::{MemfdFlags, SealFlags, fcntl_add_seals, memfd_create};
        let full = File::from(memfd_create("full", MemfdFlags::ALLOW_SEALING).unwrap());
        full.set_len(bytes).unwrap();
        fcntl_add_seals(&full, SealFlags::GROW).unwrap();
        full
    }

    #[test]
    fn a_full_disk_keeps_whole_records_or_nothing() {
        let record = [b'r'; 20_000];
        for (room, whole) in [(45_000, 40_000), (20_001, 20_000), (19_999, 0)] {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("file");
            let full = full_at(room);
            let kept = full.try_clone().unwrap();
            let beside = NamedTempFile::new_in(folder.path()).unwrap();
            let beside = NamedTempFile::from_parts(full, beside.into_temp_path());
            let mut file = AtomicFile::new(Place::Beside(beside), &path);
            while file.write_all(&record).is_ok() {
                file.mark_whole();
            }
            assert_eq!(file.keeps_anything(), whole > 0, "{room}");
            assert!(file.finish().is_err(), "what broke off is said");
            assert_eq!(path.exists(), whole > 0, "{room}");
            if whole > 0 {
                assert_eq!(kept.metadata().unwrap().len(), whole);
            }
            let left = fs::read_dir(folder.path()).unwrap().count();
            assert_eq!(left, usize::from(whole > 0), "{room}");
        }
    }

    /// What lies under another name in the end is a part: whoever finds it must not take it for the whole.
    #[test]
    fn of_what_broke_off_and_cannot_have_its_name_it_is_said_that_it_broke_off() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        fs::create_dir(&path).unwrap();
        let beside = NamedTempFile::new_in(folder.path()).unwrap();
        let beside = NamedTempFile::from_parts(full_at(45_000), beside.into_temp_path());
        let mut file = AtomicFile::new(Place::Beside(beside), &path);
        file.is_kept = true;
        let why = loop {
            match file.write_all(&[b'r'; 20_000]) {
                Ok(()) => file.mark_whole(),
                Err(why) => break why,
            }
        };
        let told = file.finish().unwrap_err();
        let (at, reason) = kept_at(&told).unwrap();
        assert_eq!(at, folder.path().join("file-new"));
        assert_eq!(reason.kind(), why.kind());
    }

    #[test]
    fn an_older_file_keeps_its_name_where_the_next_cannot_have_it() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("hall.jsonl");
        fs::write(&path, "older").unwrap();
        let mut file = AtomicFile::create(&path).unwrap();
        file.write_all(b"one\n").unwrap();
        let entries = fs::read_dir(folder.path()).unwrap();
        let mut beside = entries.map(|e| e.unwrap().path());
        fs::remove_file(beside.find(|p| is_unfinished(p)).unwrap()).unwrap();
        assert!(file.appear().is_err());
        assert_eq!(fs::read_to_string(&path).unwrap(), "older");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    /// Of a record that is longer than the buffer, and so goes past it, a part finds room.
    #[test]
    fn a_part_of_a_long_record_is_not_kept() {
        let full = full_at(24 << 10);
        let kept = full.try_clone().unwrap();
        let mut file = AtomicFile::new(Place::Named(full), Path::new("full"));
        let record = [b'r'; 20_000];
        file.write_all(&record).unwrap();
        file.mark_whole();
        assert!(file.write_all(&record).is_err());
        assert!(file.finish().is_err(), "what broke off is said");
        assert_eq!(kept.metadata().unwrap().len(), 20_000);
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
    fn a_file_that_appears_early_holds_what_was_written_when_the_process_is_gone() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("hall.jsonl");
        fs::write(&path, "older").unwrap();
        let mut file = AtomicFile::create(&path).unwrap();
        file.write_all(b"one\n").unwrap();
        file.mark_whole();
        assert_eq!(fs::read_to_string(&path).unwrap(), "older");
        let older = file.appear().unwrap().unwrap();
        assert_eq!(older, folder.path().join("hall-1.jsonl"));
        assert_eq!(fs::read_to_string(&older).unwrap(), "older");
        assert_eq!(fs::read_to_string(&path).unwrap(), "one\n");
        assert_eq!(file.appear().unwrap(), None, "once");
        file.write_all(b"two\n").unwrap();
        file.mark_whole();
        // As of a process that is killed: nothing more is written.
        assert_eq!(fs::read_to_string(&path).unwrap(), "one\ntwo\n");
        file.write_all(b"thr").unwrap();
        drop(file);
        assert_eq!(fs::read_to_string(&path).unwrap(), "one\ntwo\n");
        let mut third = AtomicFile::create(&path).unwrap();
        third.write_all(b"three\n").unwrap();
        assert!(third.appear().unwrap().unwrap().ends_with("hall-2.jsonl"));
        third.finish().unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "three\n");
    }

    #[test]
    fn a_file_that_somebody_cut_moved_or_removed_is_no_longer_intact() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("hall.jsonl");
        let begun = || {
            let mut file = AtomicFile::create(&path).unwrap();
            file.write_all(b"one\n").unwrap();
            file.mark_whole();
            assert!(file.is_intact(true).unwrap(), "it has no name yet");
            file.appear().unwrap();
            assert!(file.is_intact(true).unwrap());
            file
        };
        let mut cut = begun();
        File::options()
            .write(true)
            .open(&path)
            .unwrap()
            .set_len(0)
            .unwrap();
        assert!(!cut.is_intact(false).unwrap());
        cut.write_all(b"two\n").unwrap();
        cut.mark_whole();
        assert_eq!(fs::read_to_string(&path).unwrap(), "two\n");
        let moved = begun();
        let elsewhere = folder.path().join("elsewhere");
        fs::rename(&path, &elsewhere).unwrap();
        assert!(moved.is_intact(false).unwrap() && !moved.is_intact(true).unwrap());
        fs::write(&path, "another").unwrap();
        assert!(!moved.is_intact(true).unwrap());
        let removed = begun();
        fs::remove_file(&path).unwrap();
        assert!(!removed.is_intact(false).unwrap());
    }

    #[test]
    fn after_a_failure_what_follows_stands_behind_the_last_whole_record() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("hall.jsonl");
        let mut file = AtomicFile::create(&path).unwrap();
        let record = |file: &mut AtomicFile, text: &str| {
            file.write_all(text.as_bytes()).unwrap();
            file.mark_whole();
        };
        record(&mut file, "one\n");
        assert!(!file.go_back().unwrap(), "nothing is on the disk");
        record(&mut file, "one\n");
        file.appear().unwrap();
        record(&mut file, "two\n");
        // A part of a record, of which some has reached the disk.
        file.write_all(b"thr").unwrap();
        file.flush().unwrap();
        file.write_all(b"ee").unwrap();
        assert!(file.go_back().unwrap());
        record(&mut file, "four\n");
        assert_eq!(fs::read_to_string(&path).unwrap(), "one\ntwo\nfour\n");
        fs::remove_file(&path).unwrap();
        assert!(!file.go_back().unwrap(), "nobody would find it");
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
