//! The right to publish a stream: one process has it, until it lets go or dies.

use std::fs::{self, File, OpenOptions};
use std::io;
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::thread::sleep;
use std::time::Duration;

use rustix::fs::{FlockOperation, OFlags};

/// Others hold a claim for a moment while they look whether somebody does: tries of who wants to publish.
pub(crate) const PATIENT: u32 = 20;
const PAUSE: Duration = Duration::from_millis(5);

/// A stream that this process may publish.
#[derive(Debug)]
pub(crate) struct Claim {
    folder: PathBuf,
    stem: String,
    path: PathBuf,
    file: File,
}

impl Claim {
    /// Takes the stream; `None` where another process has it at every one of `tries`.
    pub(crate) fn take(folder: &Path, stem: &str, tries: u32) -> io::Result<Option<Self>> {
        let path = folder.join(format!("{stem}.lock"));
        for _ in 0..tries {
            let file = OpenOptions::new()
                .read(true)
                .write(true)
                .create(true)
                .truncate(false)
                .mode(0o600)
                .custom_flags(OFlags::NOFOLLOW.bits().cast_signed())
                .open(&path)?;
            match rustix::fs::flock(&file, FlockOperation::NonBlockingLockExclusive) {
                Ok(()) => {}
                Err(rustix::io::Errno::WOULDBLOCK) => {
                    sleep(PAUSE);
                    continue;
                }
                Err(e) => return Err(e.into()),
            }
            // Whoever had it may have removed the file in between.
            if !is_at(&file, &path) {
                continue;
            }
            // A file that was cleaned away is a new file to us; its holder still publishes. Or lets go this moment:
            // whoever only looked removes the file before closing it.
            if holds_removed(&path) {
                fs::remove_file(&path)?;
                sleep(PAUSE);
                continue;
            }
            return Ok(Some(Self {
                folder: folder.to_owned(),
                stem: stem.to_owned(),
                path,
                file,
            }));
        }
        Ok(None)
    }

    /// Whether others still find this claim where they look.
    pub(crate) fn stands(&self) -> bool {
        is_at(&self.file, &self.path)
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

impl Drop for Claim {
    fn drop(&mut self) {
        if self.stands() {
            let _ = fs::remove_file(&self.path);
        }
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
