//! Where the shared memory of an installation lies: found by every process without a flag.
//!
//! A writer takes the first that fits: `$EDGECAP_RUNTIME_DIR`; `/run/edgecap` where it belongs to this user (a
//! service's `RuntimeDirectory`); `edgecap` in `$XDG_RUNTIME_DIR` or `/run/user/<uid>`; `/dev/shm/edgecap-<uid>`, or
//! where somebody else took that name, `~/.cache/edgecap/run`. A reader looks there too, in `/run/edgecap` where it may
//! read it, and in `/dev/shm/edgecap-<uid>`: who publishes may have begun before this user had a session.
//!
//! Only the folder's owner may write there. Its group may read if the folder's mode says so (0750): then it may read
//! the streams and nothing else.
//!
//! | file | mode | what |
//! |---|---|---|
//! | `<camera>.<stream>.v<version>` | 0600, 0640 for a group | the newest messages (`ring`) |
//! | `<camera>.<stream>.lock` | 0600 | locked by the one process that may publish the stream |
//! | `sweep.lock` | 0600 | locked by the one process that clears away what the dead left, while it does |
//! | `d<16 digits>/` | 0700 | what one publisher has of iceoryx2 |

use std::fs::{self, DirBuilder, File, Metadata, Permissions};
use std::io;
use std::os::unix::fs::{DirBuilderExt, MetadataExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::time::Duration;

use rustix::fs::{FlockOperation, Mode, OFlags};

use crate::claim::{self, Claim, PATIENCE, Turn};
use crate::domain;
use crate::error::LinkError;
use crate::stream::stem_of;

/// Names the folder instead of the search.
pub const RUNTIME_DIR_VARIABLE: &str = "EDGECAP_RUNTIME_DIR";
/// A service's own folder.
pub const SERVICE_FOLDER: &str = "/run/edgecap";

/// The folder of this installation, for a process that publishes.
#[derive(Debug)]
pub struct Place {
    folder: PathBuf,
    /// The group that may read.
    readers: Option<u32>,
    /// Keeps systemd's cleaner of temporary files away.
    _held: File,
}

/// The folder that this process publishes in; it need not exist yet. Found once: sessions come and go while it runs.
pub fn runtime_dir() -> PathBuf {
    static FOUND: OnceLock<PathBuf> = OnceLock::new();
    FOUND.get_or_init(search).clone()
}

fn search() -> PathBuf {
    if let Some(named) = named() {
        return named;
    }
    let user = user();
    let service = Path::new(SERVICE_FOLDER);
    if is_own(service) {
        return service.to_owned();
    }
    let session = std::env::var_os("XDG_RUNTIME_DIR").map(PathBuf::from);
    let sessions = session
        .into_iter()
        .chain([format!("/run/user/{user}").into()]);
    if let Some(session) = sessions.into_iter().find(|s| is_own(s)) {
        return session.join("edgecap");
    }
    let memory = without_session();
    let is_taken = fs::symlink_metadata(&memory).is_ok_and(|m| m.uid() != user);
    match std::env::home_dir().filter(|home| is_taken && is_own(home)) {
        Some(home) => home.join(".cache/edgecap/run"),
        None => memory,
    }
}

/// The folders that a reader looks in, this user's own first.
pub fn reading_dirs() -> Vec<PathBuf> {
    let mut dirs = vec![runtime_dir()];
    if named().is_some() {
        return dirs;
    }
    let (service, memory) = (PathBuf::from(SERVICE_FOLDER), without_session());
    let others = [
        Some(search()),
        fs::read_dir(&service).is_ok().then_some(service),
        is_own_itself(&memory).then_some(memory),
    ];
    for other in others.into_iter().flatten() {
        if !dirs.contains(&other) {
            dirs.push(other);
        }
    }
    dirs
}

fn without_session() -> PathBuf {
    format!("/dev/shm/edgecap-{}", user()).into()
}

fn named() -> Option<PathBuf> {
    let named = std::env::var_os(RUNTIME_DIR_VARIABLE)?;
    (!named.is_empty()).then(|| from_here(Path::new(&named)))
}

/// The same folder for as long as the process runs, wherever that goes meanwhile.
pub(crate) fn from_here(folder: &Path) -> PathBuf {
    std::path::absolute(folder).unwrap_or_else(|_| folder.to_owned())
}

fn user() -> u32 {
    rustix::process::geteuid().as_raw()
}

fn is_own(folder: &Path) -> bool {
    fs::metadata(folder).is_ok_and(|m| m.is_dir() && m.uid() == user())
}

/// As [`is_own`], in a folder for everybody, where a link of somebody else's may lead here.
fn is_own_itself(folder: &Path) -> bool {
    fs::symlink_metadata(folder).is_ok_and(|m| m.is_dir() && m.uid() == user())
}

/// Makes a folder of mode 0700, whatever is kept back: while iceoryx2 binds a socket it keeps all but 0600 back from
/// the whole process, from children that are started meanwhile for good.
pub(crate) fn private_folder(path: &Path) -> io::Result<()> {
    let mode = 0o700;
    DirBuilder::new().mode(mode).create(path)?;
    fs::set_permissions(path, Permissions::from_mode(mode))
}

/// What the folder is, if nobody but its owner can change it.
pub(crate) fn sealed(folder: &Path) -> Result<Metadata, LinkError> {
    let failed = |e: &dyn core::fmt::Display| LinkError::place(folder, e);
    // In a folder for everybody a link could lead anywhere.
    let meta = fs::symlink_metadata(folder).map_err(|e| failed(&e))?;
    if !meta.is_dir() {
        return Err(failed(&"expected a folder, found something else"));
    }
    if meta.mode() & 0o022 != 0 {
        let mode = meta.mode() & 0o777;
        return Err(failed(&format!(
            "others may write there (mode {mode:o}); expected 700, or 750 for a group of readers"
        )));
    }
    Ok(meta)
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
        let failed = |e: &dyn core::fmt::Display| LinkError::place(folder, e);
        if folder.ends_with(".cache/edgecap/run") {
            let parent = folder.parent().unwrap_or(folder);
            let mut builder = DirBuilder::new();
            let made = builder.recursive(true).mode(0o700).create(parent);
            made.map_err(|e| failed(&e))?;
        }
        match private_folder(folder) {
            Ok(()) => {}
            Err(e) if e.kind() == io::ErrorKind::AlreadyExists => {}
            Err(e) if e.kind() == io::ErrorKind::NotFound => {
                let parent = folder.parent().unwrap_or(folder).display();
                let why = format!(
                    "{parent} is not there; a session's goes with the last logout, unless 'loginctl enable-linger' keeps it"
                );
                return Err(LinkError::NoPlace {
                    folder: folder.to_owned(),
                    cause: why,
                });
            }
            Err(e) => return Err(failed(&e)),
        }
        let meta = sealed(folder)?;
        if meta.uid() != user() {
            return Err(failed(&format!(
                "it belongs to user {}, this process runs as user {}",
                meta.uid(),
                user()
            )));
        }
        let folder = folder.canonicalize().map_err(|e| failed(&e))?;
        let flags = OFlags::RDONLY | OFlags::DIRECTORY | OFlags::CLOEXEC;
        let held = rustix::fs::open(&folder, flags, Mode::empty());
        let held = File::from(held.map_err(|e| failed(&e))?);
        // Where a reader holds another lock, that one keeps the cleaner away.
        let _ = rustix::fs::flock(&held, FlockOperation::NonBlockingLockShared);
        Ok(Self {
            folder,
            readers: (meta.mode() & 0o050 == 0o050).then_some(meta.gid()),
            _held: held,
        })
    }

    /// The folder.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// The group that may read what is published here.
    pub fn readers(&self) -> Option<u32> {
        self.readers
    }

    /// Removes what the dead left; returns the streams that are published now. `None` where another process is at it
    /// for longer than [`PATIENCE`].
    ///
    /// # Errors
    /// The system's, once all that can be removed is.
    pub(crate) fn sweep(&self) -> io::Result<Option<Vec<String>>> {
        let Some(_turn) = Turn::take(&self.folder, PATIENCE)? else {
            return Ok(None);
        };
        let mut alive = Vec::new();
        for stem in stems_in(&self.folder)? {
            match Claim::take(&self.folder, &stem, Duration::ZERO)? {
                // Letting go of it removes the lock.
                Some(claim) => claim.remove_others()?,
                None => alive.push(stem),
            }
        }
        let mut refused = None;
        for name in names_in(&self.folder)? {
            if let Err(e) = domain::remove_if_dead(&self.folder, &name) {
                refused.get_or_insert(e);
            }
        }
        refused.map_or(Ok(Some(alive)), Err)
    }
}

fn names_in(folder: &Path) -> io::Result<Vec<String>> {
    let entries = fs::read_dir(folder)?.flatten();
    let names = entries.filter_map(|e| e.file_name().into_string().ok());
    Ok(names.collect())
}

/// The streams that files of `folder` are of, each once.
fn stems_in(folder: &Path) -> io::Result<Vec<String>> {
    let names = names_in(folder)?;
    let stems = names.iter().filter_map(|n| stem_of(n));
    let mut stems: Vec<String> = stems.map(ToOwned::to_owned).collect();
    stems.sort();
    stems.dedup();
    Ok(stems)
}

/// Those of `folders` besides `folder` in which other processes of this user may publish: which one a process takes
/// depends on the session that it began in.
pub(crate) fn own_besides(folders: Vec<PathBuf>, folder: &Path) -> Vec<PathBuf> {
    let is_other = |other: &PathBuf| {
        sealed(other).is_ok_and(|m| m.uid() == user())
            && other.canonicalize().is_ok_and(|o| o != folder)
    };
    folders.into_iter().filter(is_other).collect()
}

/// The streams that this user publishes in other folders than [`runtime_dir`], from other sessions: nobody else may
/// publish them. One that somebody looks at this moment may be among them.
pub fn published_elsewhere() -> Vec<String> {
    let here = runtime_dir();
    let here = here.canonicalize().unwrap_or(here);
    let others = own_besides(reading_dirs(), &here).into_iter();
    others
        .flat_map(|folder| {
            let mut stems = stems_in(&folder).unwrap_or_default();
            stems.retain(|stem| claim::is_taken(&folder, stem, Duration::ZERO));
            stems
        })
        .collect()
}

/// Removes all that the dead left in the folder of this user; returns the streams that are published now, untouched.
///
/// # Errors
/// [`LinkError::Place`] where the folder cannot be used or emptied, or another process is at that and does not end.
pub fn clear() -> Result<Vec<String>, LinkError> {
    clear_at(&runtime_dir())
}

/// As [`clear`], at a given folder.
///
/// # Errors
/// As [`clear`].
pub fn clear_at(folder: &Path) -> Result<Vec<String>, LinkError> {
    let place = Place::enter_at(folder)?;
    let swept = place.sweep().map_err(|e| LinkError::place(folder, e))?;
    swept.ok_or_else(|| {
        let seconds = PATIENCE.as_secs();
        LinkError::place(
            folder,
            format!("expected to clear it, found another process clearing it for {seconds} s"),
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_link_in_a_folder_for_everybody_is_nobodys_own_folder() {
        let parent = tempfile::tempdir().unwrap();
        let [own, link] = ["own", "link"].map(|name| parent.path().join(name));
        private_folder(&own).unwrap();
        std::os::unix::fs::symlink(&own, &link).unwrap();
        assert!(is_own_itself(&own) && is_own(&link) && !is_own_itself(&link));
    }
}
