//! Where the shared memory of an installation lies: found by every process without a flag, and no other user's.
//!
//! The first that fits: `$EDGECAP_RUNTIME_DIR`; `/run/edgecap` where it belongs to this user (a service's `RuntimeDirectory`);
//! `$XDG_RUNTIME_DIR/edgecap`; `/tmp/edgecap-<uid>`. The folder holds
//!
//! | file | what |
//! |---|---|
//! | `prefix` | how the names of this installation's objects in `/dev/shm` begin; random, so that nobody can take them first |
//! | `lock` | locked (shared) by every process that uses the folder, so that nobody clears it below them |
//! | `nodes`, `services` | iceoryx2's own |

use std::fs::{self, DirBuilder, File, OpenOptions, Permissions};
use std::io::{self, Read, Write};
use std::os::unix::fs::{DirBuilderExt, MetadataExt, OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use iceoryx2::prelude::{Config, FileName, Path as RootPath, SemanticString};
use rustix::fs::{FallocateFlags, FlockOperation, OFlags};

use crate::link::LinkError;

/// Names the folder instead of the search.
pub const RUNTIME_DIR_VARIABLE: &str = "EDGECAP_RUNTIME_DIR";
/// A service's own folder.
const SERVICE_FOLDER: &str = "/run/edgecap";
/// Where POSIX shared memory lies on Linux.
const SHARED_MEMORY: &str = "/dev/shm";
/// An object that was not opened to others so long after it was made belongs to somebody who died over it.
const UNFINISHED_AFTER: Duration = Duration::from_secs(2);
/// Mode of an object in the making.
const UNFINISHED: u32 = 0o200;

/// The folder of this installation, entered: nobody clears it while this value lives.
#[derive(Debug)]
pub struct Place {
    folder: PathBuf,
    prefix: String,
    _lock: File,
}

/// The folder that processes of this user share; it need not exist yet.
pub fn runtime_dir() -> PathBuf {
    if let Some(named) = std::env::var_os(RUNTIME_DIR_VARIABLE).filter(|v| !v.is_empty()) {
        return named.into();
    }
    let user = rustix::process::geteuid().as_raw();
    let service = Path::new(SERVICE_FOLDER);
    if fs::metadata(service).is_ok_and(|m| m.is_dir() && m.uid() == user) {
        return service.to_owned();
    }
    let own = std::env::var_os("XDG_RUNTIME_DIR").map(PathBuf::from);
    let is_mine = |p: &PathBuf| fs::metadata(p).is_ok_and(|m| m.is_dir() && m.uid() == user);
    match own.filter(is_mine) {
        Some(own) => own.join("edgecap"),
        None => PathBuf::from(format!("/tmp/edgecap-{user}")),
    }
}

impl Place {
    /// Enters the folder of [`runtime_dir`], which is made if it is not there.
    ///
    /// # Errors
    /// [`LinkError::Place`] where the folder cannot be made, or belongs to somebody else.
    pub fn enter() -> Result<Self, LinkError> {
        Self::enter_at(&runtime_dir())
    }

    /// As [`enter`](Self::enter), at a given folder.
    ///
    /// # Errors
    /// As [`enter`](Self::enter).
    pub fn enter_at(folder: &Path) -> Result<Self, LinkError> {
        let (folder, lock) = open_lock(folder)?;
        let failed = |e: io::Error| place_error(&folder, &e.to_string());
        rustix::fs::flock(&lock, FlockOperation::LockShared).map_err(|e| failed(e.into()))?;
        let prefix = match fs::read_to_string(folder.join("prefix")) {
            Ok(prefix) if is_prefix(&prefix) => prefix,
            _ => make_prefix(&folder).map_err(failed)?,
        };
        let place = Self {
            folder,
            prefix,
            _lock: lock,
        };
        place.remove_unfinished();
        Ok(place)
    }

    /// The folder.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// iceoryx2's settings for this place.
    pub(crate) fn config(&self) -> Result<Config, LinkError> {
        let wrong = |e: &dyn core::fmt::Debug| {
            place_error(
                &self.folder,
                &format!("expected a path of at most 200 characters, found {e:?}"),
            )
        };
        let mut config = Config::default();
        let root = RootPath::new(self.folder.as_os_str().as_encoded_bytes());
        config.global.set_root_path(&root.map_err(|e| wrong(&e))?);
        config.global.prefix = FileName::new(self.prefix.as_bytes()).map_err(|e| wrong(&e))?;
        Ok(config)
    }

    /// Takes from everybody else what iceoryx2 opens to everybody: its count of nodes, which a stranger could truncate.
    pub(crate) fn close_to_others(&self) {
        for object in self.objects() {
            if object.to_string_lossy().contains(".global_mgmt") {
                // Whoever made it may do so; for all others it is closed already.
                let _ = fs::set_permissions(&object, Permissions::from_mode(0o600));
            }
        }
    }

    /// Reserves the memory of this installation's message buffers: a write into memory that is not there would end the process.
    ///
    /// # Errors
    /// The system's, when the memory is full.
    pub(crate) fn reserve(&self) -> io::Result<()> {
        for object in self.objects() {
            if object.extension().is_none_or(|e| e != "data") {
                continue;
            }
            // Another process may have removed its own meanwhile.
            let Ok(file) = OpenOptions::new().write(true).open(&object) else {
                continue;
            };
            let length = file.metadata()?.len();
            if length > 0 {
                rustix::fs::fallocate(&file, FallocateFlags::empty(), 0, length)?;
            }
        }
        Ok(())
    }

    /// This installation's objects in shared memory.
    fn objects(&self) -> Vec<PathBuf> {
        objects(&self.prefix)
    }

    /// Removes what a process left that was killed while it made it; nobody could ever open it.
    fn remove_unfinished(&self) {
        for object in self.objects() {
            let Ok(meta) = fs::metadata(&object) else {
                continue;
            };
            let age = meta
                .modified()
                .ok()
                .and_then(|t| SystemTime::now().duration_since(t).ok());
            if meta.mode() & 0o777 == UNFINISHED && age.is_some_and(|a| a > UNFINISHED_AFTER) {
                let _ = fs::remove_file(&object);
            }
        }
    }
}

/// What [`clear`] did.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cleared {
    /// Everything that the dead left is gone.
    All,
    /// Somebody uses the folder: nothing was touched.
    InUse,
}

/// Removes all that this installation has in shared memory, if nobody alive uses it.
///
/// # Errors
/// [`LinkError::Place`] where the folder cannot be used or emptied.
pub fn clear() -> Result<Cleared, LinkError> {
    clear_at(&runtime_dir())
}

/// As [`clear`], at a given folder.
///
/// # Errors
/// As [`clear`].
pub fn clear_at(folder: &Path) -> Result<Cleared, LinkError> {
    let (folder, lock) = open_lock(folder)?;
    let failed = |e: io::Error| place_error(&folder, &e.to_string());
    match rustix::fs::flock(&lock, FlockOperation::NonBlockingLockExclusive) {
        Ok(()) => {}
        Err(rustix::io::Errno::WOULDBLOCK) => return Ok(Cleared::InUse),
        Err(e) => return Err(failed(e.into())),
    }
    if let Ok(prefix) = fs::read_to_string(folder.join("prefix"))
        && is_prefix(&prefix)
    {
        for object in objects(&prefix) {
            fs::remove_file(object).map_err(failed)?;
        }
    }
    for name in ["nodes", "services"] {
        match fs::remove_dir_all(folder.join(name)) {
            Err(e) if e.kind() != io::ErrorKind::NotFound => return Err(failed(e)),
            _ => {}
        }
    }
    // The next to enter chooses another prefix.
    match fs::remove_file(folder.join("prefix")) {
        Err(e) if e.kind() != io::ErrorKind::NotFound => Err(failed(e)),
        _ => Ok(Cleared::All),
    }
}

fn place_error(folder: &Path, cause: &str) -> LinkError {
    LinkError::Place {
        folder: folder.to_owned(),
        cause: cause.to_owned(),
    }
}

/// Makes sure of the folder and opens its lock.
fn open_lock(folder: &Path) -> Result<(PathBuf, File), LinkError> {
    let failed = |e: &dyn core::fmt::Display| place_error(folder, &e.to_string());
    match DirBuilder::new().mode(0o700).create(folder) {
        Err(e) if e.kind() != io::ErrorKind::AlreadyExists => return Err(failed(&e)),
        _ => {}
    }
    // In a folder for everybody a link could lead anywhere.
    let meta = fs::symlink_metadata(folder).map_err(|e| failed(&e))?;
    if !meta.is_dir() {
        return Err(failed(&"expected a folder, found something else"));
    }
    let user = rustix::process::geteuid().as_raw();
    if meta.uid() != user {
        return Err(failed(&format!(
            "it belongs to user {}, this process runs as user {user}",
            meta.uid()
        )));
    }
    if meta.mode() & 0o022 != 0 {
        return Err(failed(&format!(
            "others may write there (mode {:o}); expected 700",
            meta.mode() & 0o777
        )));
    }
    let folder = folder.canonicalize().map_err(|e| failed(&e))?;
    let lock = OpenOptions::new()
        .read(true)
        .write(true)
        .create(true)
        .truncate(false)
        .mode(0o600)
        .custom_flags(OFlags::NOFOLLOW.bits().cast_signed())
        .open(folder.join("lock"))
        .map_err(|e| failed(&e))?;
    Ok((folder, lock))
}

/// Chooses a prefix, or takes the one that another process chose at the same moment.
fn make_prefix(folder: &Path) -> io::Result<String> {
    let mut random = [0; 8];
    File::open("/dev/urandom")?.read_exact(&mut random)?;
    let prefix = format!("edgecap_{:016x}_", u64::from_ne_bytes(random));
    let (path, draft) = (folder.join("prefix"), folder.join(format!(".{prefix}")));
    if !fs::read_to_string(&path).is_ok_and(|p| is_prefix(&p)) {
        // Missing, or damaged: it names nothing that could be found again.
        let _ = fs::remove_file(&path);
    }
    let mut file = OpenOptions::new()
        .write(true)
        .create_new(true)
        .mode(0o600)
        .open(&draft)?;
    let made = file
        .write_all(prefix.as_bytes())
        .and_then(|()| fs::hard_link(&draft, &path));
    fs::remove_file(&draft)?;
    match made {
        Ok(()) => Ok(prefix),
        Err(e) if e.kind() == io::ErrorKind::AlreadyExists => fs::read_to_string(&path),
        Err(e) => Err(e),
    }
}

fn is_prefix(text: &str) -> bool {
    let digits = text
        .strip_prefix("edgecap_")
        .and_then(|t| t.strip_suffix('_'));
    digits.is_some_and(|d| d.len() == 16 && d.bytes().all(|b| b.is_ascii_hexdigit()))
}

fn objects(prefix: &str) -> Vec<PathBuf> {
    let Ok(entries) = fs::read_dir(SHARED_MEMORY) else {
        return Vec::new();
    };
    entries
        .flatten()
        .filter(|e| {
            e.file_name()
                .as_encoded_bytes()
                .starts_with(prefix.as_bytes())
        })
        .map(|e| e.path())
        .collect()
}
