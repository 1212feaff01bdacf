//! One publisher's life in iceoryx2: a folder of its own, that ends with its last user.
//!
//! A publisher never opens what another left: it makes a domain, and tells the readers its name when it is complete. So
//! what the dead left damaged or half made is never read, and cameras cannot reach each other's. Everybody who uses a
//! domain holds its lock; where nobody does, whoever comes next removes it.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Read};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use iceoryx2::prelude::{Config, FileName, Path as RootPath, SemanticString};
use rustix::fs::{FallocateFlags, FlockOperation, Mode, OFlags};

use crate::claim::is_at;
use crate::error::LinkError;
use crate::place::private_folder;

/// A domain without a lock for so long belongs to somebody who died over it.
const UNFINISHED_AFTER: Duration = Duration::from_secs(10);
/// Extension of a domain that is being removed.
const REMOVED: &str = "removed";
/// What the path of a Unix socket leaves for the folder, bytes: iceoryx2's own part of the name takes the rest of 107.
const LONGEST_FOLDER: usize = 107 - 1 - 17 - 1 - LONGEST_SOCKET;
/// `e_`, 39 digits, `.event`.
const LONGEST_SOCKET: usize = 47;

/// The folder of one publisher's services, in use by this process.
#[derive(Debug)]
pub(crate) struct Domain {
    path: PathBuf,
    id: u64,
    lock: File,
}

impl Domain {
    /// Makes a new one.
    ///
    /// # Errors
    /// The system's; paths too long for a socket.
    pub(crate) fn create(folder: &Path) -> Result<Self, LinkError> {
        let length = folder.as_os_str().len();
        if length > LONGEST_FOLDER {
            return Err(LinkError::place(
                folder,
                format!("expected a path of at most {LONGEST_FOLDER} characters, found {length}"),
            ));
        }
        let made = || -> io::Result<Self> {
            loop {
                let mut random = [0; 8];
                File::open("/dev/urandom")?.read_exact(&mut random)?;
                let id = u64::from_ne_bytes(random);
                let path = folder.join(name(id));
                private_folder(&path)?;
                let lock = OpenOptions::new()
                    .read(true)
                    .write(true)
                    .create_new(true)
                    .mode(0o600)
                    .open(path.join("lock"))?;
                if let Some(domain) = Self::enter(path, id, lock)? {
                    return Ok(domain);
                }
            }
        };
        made().map_err(|e| LinkError::place(folder, format!("making a folder in it: {e}")))
    }

    /// Joins the one that a publisher named; `None` where it has gone, is another user's (what root left in it that
    /// user could not open, nor remove), or has a path too long for a socket. Links on the way there may be as long as
    /// they like.
    pub(crate) fn join(folder: &Path, id: u64) -> io::Result<Option<Self>> {
        let folder = match folder.canonicalize() {
            Ok(folder) if folder.as_os_str().len() <= LONGEST_FOLDER => folder,
            Ok(_) => return Ok(None),
            Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(None),
            Err(e) => return Err(e),
        };
        let path = folder.join(name(id));
        let lock = match open_lock(&path) {
            Ok(lock) => lock,
            Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(None),
            Err(e) => return Err(e),
        };
        if lock.metadata()?.uid() != rustix::process::geteuid().as_raw() {
            return Ok(None);
        }
        Self::enter(path, id, lock)
    }

    fn enter(path: PathBuf, id: u64, lock: File) -> io::Result<Option<Self>> {
        match rustix::fs::flock(&lock, FlockOperation::NonBlockingLockShared) {
            Ok(()) => {}
            // Somebody is removing it.
            Err(rustix::io::Errno::WOULDBLOCK) => return Ok(None),
            Err(e) => return Err(e.into()),
        }
        let stands = is_at(&lock, &path.join("lock"));
        Ok(stands.then_some(Self { path, id, lock }))
    }

    pub(crate) fn id(&self) -> u64 {
        self.id
    }

    fn lock_path(&self) -> PathBuf {
        self.path.join("lock")
    }

    /// iceoryx2's settings for it.
    pub(crate) fn config(&self) -> Result<Config, LinkError> {
        let wrong = |e: &dyn core::fmt::Debug| LinkError::place(&self.path, format!("{e:?}"));
        let mut config = Config::default();
        let root = RootPath::new(self.path.as_os_str().as_encoded_bytes());
        config.global.set_root_path(&root.map_err(|e| wrong(&e))?);
        config.global.prefix = FileName::new(b"e_").map_err(|e| wrong(&e))?;
        // The writer does it, see `Link::clean_up`.
        config.global.node.cleanup_dead_nodes_on_creation = false;
        config.global.node.cleanup_dead_nodes_on_destruction = false;
        config.global.service.cleanup_dead_nodes_on_open = false;
        Ok(config)
    }

    /// Removes what node `id`, which is dead, did not finish: iceoryx2 does not list it, and its folder would stay.
    pub(crate) fn remove_unfinished(&self, id: u128) {
        let Ok(entries) = fs::read_dir(self.path.join("nodes").join(id.to_string())) else {
            return;
        };
        for entry in entries.flatten() {
            // What is complete can only be read.
            if entry.metadata().is_ok_and(|m| m.mode() & 0o200 != 0) {
                let _ = fs::remove_file(entry.path());
            }
        }
    }

    /// Reserves the memory behind all that is in it: a write into memory that is not there would end the process.
    ///
    /// # Errors
    /// The system's, when the memory is full.
    pub(crate) fn reserve(&self) -> io::Result<()> {
        for folder in [
            self.path.clone(),
            self.path.join("services"),
            self.path.join("nodes"),
        ] {
            let Ok(entries) = fs::read_dir(folder) else {
                continue;
            };
            for entry in entries.flatten() {
                // Others may be removing theirs.
                let Ok(meta) = entry.metadata() else {
                    continue;
                };
                if !meta.is_file() || meta.len() == 0 {
                    continue;
                }
                if let Ok(file) = OpenOptions::new().write(true).open(entry.path()) {
                    rustix::fs::fallocate(&file, FallocateFlags::empty(), 0, meta.len())?;
                }
            }
        }
        Ok(())
    }
}

impl Drop for Domain {
    fn drop(&mut self) {
        let last = rustix::fs::flock(&self.lock, FlockOperation::NonBlockingLockExclusive);
        if last.is_ok() && is_at(&self.lock, &self.lock_path()) {
            let _ = remove(&self.path);
        }
    }
}

/// Looks whether there is room for so many bytes. They are free again afterwards: who writes then reserves.
///
/// # Errors
/// The system's, when there is not.
pub(crate) fn reserve_for_a_moment(folder: &Path, bytes: u64) -> io::Result<()> {
    let file = tempfile_in(folder)?;
    rustix::fs::fallocate(&file, FallocateFlags::empty(), 0, bytes)?;
    Ok(())
}

/// A file without a name.
fn tempfile_in(folder: &Path) -> io::Result<File> {
    let flags = OFlags::TMPFILE | OFlags::RDWR | OFlags::CLOEXEC;
    Ok(rustix::fs::open(folder, flags, Mode::RUSR | Mode::WUSR)?.into())
}

fn name(id: u64) -> String {
    format!("d{id:016x}")
}

/// Removes a domain that nobody uses, under another name: who finds half of it knows that it is to go.
fn remove(domain: &Path) -> io::Result<()> {
    let removed = domain.with_extension(REMOVED);
    match fs::rename(domain, &removed).and_then(|()| fs::remove_dir_all(&removed)) {
        Err(e) if e.kind() != io::ErrorKind::NotFound => Err(e),
        _ => Ok(()),
    }
}

fn open_lock(domain: &Path) -> io::Result<File> {
    OpenOptions::new()
        .read(true)
        .write(true)
        .custom_flags(OFlags::NOFOLLOW.bits().cast_signed())
        .open(domain.join("lock"))
}

/// Removes what is called `name` in `folder` if it is a domain that nobody alive uses.
pub(crate) fn remove_if_dead(folder: &Path, name: &str) -> io::Result<()> {
    let path = folder.join(name);
    let (id, removed) = match name.split_once('.') {
        Some((id, REMOVED)) => (id, true),
        _ => (name, false),
    };
    let digits = id.strip_prefix('d').filter(|d| d.len() == 16);
    if !digits.is_some_and(|d| d.bytes().all(|b| b.is_ascii_hexdigit())) {
        return Ok(());
    }
    if removed {
        return match fs::remove_dir_all(&path) {
            Err(e) if e.kind() != io::ErrorKind::NotFound => Err(e),
            _ => Ok(()),
        };
    }
    match open_lock(&path) {
        Ok(lock) => match rustix::fs::flock(&lock, FlockOperation::NonBlockingLockExclusive) {
            Ok(()) => remove(&path),
            Err(_) => Ok(()),
        },
        // Killed before there was one, or made this moment.
        Err(e) if e.kind() == io::ErrorKind::NotFound => {
            let made = fs::symlink_metadata(&path).and_then(|m| m.modified());
            let age = made
                .ok()
                .and_then(|t| SystemTime::now().duration_since(t).ok());
            match age {
                Some(age) if age > UNFINISHED_AFTER => remove(&path),
                _ => Ok(()),
            }
        }
        // There is one, and nobody knows whose: a process without descriptors left can open none.
        Err(_) => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_domain_in_a_folder_too_long_for_a_socket_is_not_joined() {
        let parent = tempfile::tempdir().unwrap();
        for (length, is_joined) in [(8, true), (LONGEST_FOLDER, false)] {
            let folder = parent.path().join("x".repeat(length));
            let domain = folder.join(name(1));
            fs::create_dir_all(&domain).unwrap();
            fs::write(domain.join("lock"), "").unwrap();
            let joined = Domain::join(&folder, 1).unwrap();
            assert_eq!(joined.is_some(), is_joined, "{length}");
        }
    }

    #[test]
    fn a_domain_whose_lock_cannot_be_opened_is_not_taken_for_unfinished() {
        let folder = tempfile::tempdir().unwrap();
        let made = |name: &str| {
            let path = folder.path().join(name);
            fs::create_dir(&path).unwrap();
            path
        };
        let (locked, unfinished) = (made("d0000000000000001"), made("d0000000000000002"));
        std::os::unix::fs::symlink("nowhere", locked.join("lock")).unwrap();
        for path in [&locked, &unfinished] {
            let long_ago = SystemTime::now() - 2 * UNFINISHED_AFTER;
            File::open(path).unwrap().set_modified(long_ago).unwrap();
            let name = path.file_name().unwrap().to_str().unwrap();
            remove_if_dead(folder.path(), name).unwrap();
        }
        assert!(locked.exists() && !unfinished.exists());
    }
}
