//! The right to publish a stream, and the turn to clear away what the dead left: one process has it, until it lets go
//! or dies.

use std::fs::{self, File, OpenOptions};
use std::io;
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::thread::sleep;
use std::time::Duration;

use rustix::fs::{FlockOperation, OFlags};

/// For so long who wants to publish waits: whoever clears away what the dead left holds each claim for a moment.
pub(crate) const PATIENCE: Duration = Duration::from_secs(2);
/// A file that was removed and is open still: whoever only looked has closed it by then, a publisher never does.
const LETS_GO_WITHIN: Duration = Duration::from_millis(100);
const PAUSE: Duration = Duration::from_millis(5);

/// So often in a row a lock's file may be removed by whoever had it, between opening and locking it.
const MOVED_AT_MOST: usize = 100;

/// A lock that this process has. Letting go of it removes its file.
#[derive(Debug)]
struct Held {
    path: PathBuf,
    file: File,
}

impl Held {
    /// Takes the lock at `path`; `None` where another process has it.
    fn try_at(path: &Path) -> io::Result<Option<Self>> {
        for _ in 0..MOVED_AT_MOST {
            let file = lock_file(path)?;
            if !try_lock(&file)? {
                return Ok(None);
            }
            // Whoever had it may have removed the file in between.
            if is_at(&file, path) {
                let path = path.to_owned();
                return Ok(Some(Self { path, file }));
            }
        }
        Ok(None)
    }

    /// Whether others still find the lock where they look.
    fn stands(&self) -> bool {
        is_at(&self.file, &self.path)
    }
}

impl Drop for Held {
    fn drop(&mut self) {
        if self.stands() {
            let _ = fs::remove_file(&self.path);
        }
    }
}

/// A stream that this process may publish.
#[derive(Debug)]
pub(crate) struct Claim {
    folder: PathBuf,
    stem: String,
    lock: Held,
}

impl Claim {
    /// Takes the stream; `None` where another process has it for longer than `patience`.
    pub(crate) fn take(folder: &Path, stem: &str, patience: Duration) -> io::Result<Option<Self>> {
        Self::take_pausing(folder, stem, patience, sleep)
    }

    fn take_pausing(
        folder: &Path,
        stem: &str,
        patience: Duration,
        mut pause: impl FnMut(Duration),
    ) -> io::Result<Option<Self>> {
        let path = folder.join(format!("{stem}.lock"));
        let [mut held, mut removed] = [Duration::ZERO; 2];
        loop {
            let (waited, longest) = match Held::try_at(&path)? {
                None => (&mut held, patience),
                // A file that was cleaned away is a new file to us; its holder still publishes. Or lets go this moment:
                // whoever only looked removes the file before closing it.
                Some(lock) if holds_removed(&path) => {
                    drop(lock);
                    (&mut removed, patience.min(LETS_GO_WITHIN))
                }
                Some(lock) => {
                    return Ok(Some(Self {
                        folder: folder.to_owned(),
                        stem: stem.to_owned(),
                        lock,
                    }));
                }
            };
            if *waited >= longest {
                return Ok(None);
            }
            pause(PAUSE);
            *waited += PAUSE;
        }
    }

    /// Whether others still find this claim where they look.
    pub(crate) fn stands(&self) -> bool {
        self.lock.stands()
    }

    /// Removes what earlier publishers left of the stream.
    pub(crate) fn remove_others(&self) -> io::Result<()> {
        for entry in fs::read_dir(&self.folder)?.flatten() {
            let name = entry.file_name();
            let rest = name.to_str().and_then(|n| n.strip_prefix(&self.stem));
            if rest.is_some_and(|r| r.starts_with(".v")) {
                fs::remove_file(entry.path())?;
            }
        }
        Ok(())
    }
}

/// The turn to clear a folder of what the dead left. Many who did it at once would find each other's claims, and take
/// what is dead for alive.
#[derive(Debug)]
pub(crate) struct Turn {
    _lock: Held,
}

impl Turn {
    /// Takes it; `None` where others have it for longer than `patience`.
    pub(crate) fn take(folder: &Path, patience: Duration) -> io::Result<Option<Self>> {
        let path = folder.join("sweep.lock");
        let mut waited = Duration::ZERO;
        loop {
            if let Some(lock) = Held::try_at(&path)? {
                return Ok(Some(Self { _lock: lock }));
            }
            if waited >= patience {
                return Ok(None);
            }
            sleep(PAUSE);
            waited += PAUSE;
        }
    }
}

/// Whether another process may publish the stream in `folder`, where nothing is made or removed; so it is taken only
/// when that lasts for longer than `patience`.
pub(crate) fn is_taken(folder: &Path, stem: &str, patience: Duration) -> bool {
    let path = folder.join(format!("{stem}.lock"));
    let mut waited = Duration::ZERO;
    while is_locked(&path) {
        if waited >= patience {
            return true;
        }
        sleep(PAUSE);
        waited += PAUSE;
    }
    false
}

fn is_locked(path: &Path) -> bool {
    let flags = OFlags::NOFOLLOW | OFlags::NONBLOCK;
    let opened = OpenOptions::new()
        .read(true)
        .custom_flags(flags.bits().cast_signed())
        .open(path);
    opened.is_ok_and(|file| {
        rustix::fs::flock(&file, FlockOperation::NonBlockingLockShared)
            == Err(rustix::io::Errno::WOULDBLOCK)
    })
}

fn lock_file(path: &Path) -> io::Result<File> {
    OpenOptions::new()
        .read(true)
        .write(true)
        .create(true)
        .truncate(false)
        .mode(0o600)
        .custom_flags(OFlags::NOFOLLOW.bits().cast_signed())
        .open(path)
}

/// Locks the file for this process alone; `false` where another one has it.
fn try_lock(file: &File) -> io::Result<bool> {
    match rustix::fs::flock(file, FlockOperation::NonBlockingLockExclusive) {
        Ok(()) => Ok(true),
        Err(rustix::io::Errno::WOULDBLOCK) => Ok(false),
        Err(e) => Err(e.into()),
    }
}

/// Whether the open file is the one that the path leads to.
pub(crate) fn is_at(file: &File, path: &Path) -> bool {
    match (file.metadata(), fs::symlink_metadata(path)) {
        (Ok(a), Ok(b)) => (a.dev(), a.ino()) == (b.dev(), b.ino()),
        _ => false,
    }
}

/// Whether a process of this user has a file open that was at `path` and is removed.
fn holds_removed(path: &Path) -> bool {
    let mut removed = path.as_os_str().to_owned();
    removed.push(" (deleted)");
    let Ok(processes) = fs::read_dir("/proc") else {
        return false;
    };
    let is_number = |n: &std::ffi::OsStr| n.as_encoded_bytes().iter().all(u8::is_ascii_digit);
    processes
        .flatten()
        .filter(|p| is_number(&p.file_name()))
        // Other users' cannot be read.
        .filter_map(|p| fs::read_dir(p.path().join("fd")).ok())
        .flat_map(|fds| fds.flatten())
        .filter_map(|fd| fs::read_link(fd.path()).ok())
        .any(|target| target.as_os_str() == removed)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Tries to take the stream; how often it waited meanwhile.
    fn take(folder: &Path, patience: Duration) -> (Option<Claim>, u32) {
        let mut pauses = 0;
        let claim = Claim::take_pausing(folder, "camera0.bodies", patience, |_| pauses += 1);
        (claim.unwrap(), pauses)
    }

    #[test]
    fn who_looks_at_a_living_stream_waits_for_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let (held, pauses) = take(folder.path(), PATIENCE);
        assert!(held.is_some() && pauses == 0);
        let (none, pauses) = take(folder.path(), Duration::ZERO);
        assert!(none.is_none() && pauses == 0);
        let (none, pauses) = take(folder.path(), 3 * PAUSE);
        assert!(none.is_none() && pauses == 3);
        // One that was cleaned away under its publisher is its own all the same.
        fs::remove_file(folder.path().join("camera0.bodies.lock")).unwrap();
        let (none, pauses) = take(folder.path(), Duration::ZERO);
        assert!(none.is_none() && pauses == 0);
        let (none, pauses) = take(folder.path(), PATIENCE);
        assert!(none.is_none() && PAUSE * pauses == LETS_GO_WITHIN);
        drop(held);
        assert!(take(folder.path(), Duration::ZERO).0.is_some());
    }

    #[test]
    fn one_at_a_time_clears_away() {
        let folder = tempfile::tempdir().unwrap();
        let turn = Turn::take(folder.path(), Duration::ZERO).unwrap();
        assert!(turn.is_some());
        let second = Turn::take(folder.path(), Duration::ZERO).unwrap();
        assert!(second.is_none());
        drop(turn);
        drop(Turn::take(folder.path(), Duration::ZERO).unwrap().unwrap());
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    #[test]
    fn whether_a_stream_is_taken_is_seen_without_taking_it() {
        let folder = tempfile::tempdir().unwrap();
        let is_taken = || is_taken(folder.path(), "camera0.bodies", Duration::ZERO);
        assert!(!is_taken());
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
        let held = take(folder.path(), PATIENCE).0;
        assert!(is_taken());
        drop(held);
        fs::write(folder.path().join("camera0.bodies.lock"), "").unwrap();
        assert!(!is_taken(), "the dead lock nothing");
    }
}
