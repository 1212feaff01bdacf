//! A ring's file in a folder: found there, looked at, and read message by message.

use std::fs::{self, File, OpenOptions};
use std::io;
use std::os::unix::fs::{FileExt, MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::time::Duration;

use rustix::fs::OFlags;

use super::watch::Watch;
use super::{COUNT_AT, GONE_AFTER, Header, SLOTS, now, place_of, read_u64};
use crate::claim::is_at;
use crate::error::LinkError;
use crate::message::FLAG_END_OF_STREAM;
use crate::place::sealed;
use crate::stream::{Message, file_stem, ring_path, service_name, version_of};

/// So often in a row a writer may overtake a reader that copies; then the reader looks at its own time limit.
const OVERTAKEN_AT_MOST: usize = 100;

/// A message of what was so for so long ago may be all that a camera that is away has left.
const STALE_AFTER: Duration = Duration::from_secs(2);

/// A publisher's file, open for reading.
#[derive(Debug)]
pub(super) struct Open {
    pub(super) folder: PathBuf,
    pub(super) path: PathBuf,
    file: File,
    pub(super) life: u64,
    /// Number of the message that comes next.
    pub(super) next: u64,
    /// Its number within the reader's [`Watch`]; `None` where the kernel tells nothing of this file.
    pub(super) watched: Option<i32>,
    pub(super) is_alive: bool,
}

impl Open {
    /// Opens the ring of a camera's stream in a folder, and has the kernel tell of its messages; `None` where there is
    /// none.
    ///
    /// # Errors
    /// [`LinkError`], as its texts say.
    pub(super) fn find<M: Message>(
        folder: &Path,
        camera: &str,
        watch: &Watch,
    ) -> Result<Option<Self>, LinkError> {
        let (path, service) = (ring_path::<M>(folder, camera), service_name::<M>(camera));
        let failed = |e: io::Error| LinkError::failed(&service, e);
        let owner = match sealed(folder) {
            Ok(meta) => meta.uid(),
            Err(_) if !folder.exists() => return Ok(None),
            Err(e) => return Err(e),
        };
        let flags = OFlags::NOFOLLOW | OFlags::NONBLOCK;
        let opened = OpenOptions::new()
            .read(true)
            .custom_flags(flags.bits().cast_signed())
            .open(&path);
        let file = match opened {
            Ok(file) => file,
            Err(e) if e.kind() == io::ErrorKind::NotFound => {
                return other_version::<M>(folder, camera).map_or(Ok(None), Err);
            }
            Err(e) if e.kind() == io::ErrorKind::PermissionDenied => {
                let group = fs::metadata(&path).or_else(|_| fs::metadata(folder));
                return Err(LinkError::Permission {
                    service,
                    owner,
                    group: group.map_or(owner, |m| m.gid()),
                    user: rustix::process::geteuid().as_raw(),
                });
            }
            Err(e) => return Err(failed(e)),
        };
        let meta = file.metadata().map_err(failed)?;
        // Only the folder's owner can have put it there; a file that somebody else may write holds what somebody else
        // says.
        if !meta.is_file() || meta.uid() != owner || meta.mode() & 0o022 != 0 {
            return Err(LinkError::place(
                folder,
                format!("{} is not its owner's alone", path.display()),
            ));
        }
        let header = Header::read(&file).map_err(failed)?;
        let Some(header) = header.filter(|h| h.size as usize == size_of::<M>()) else {
            // Cut short, or never finished.
            return Ok(None);
        };
        if header.version != M::VERSION {
            return Ok(None);
        }
        let watched = watch.add(&path);
        if !is_at(&file, &path) {
            watch.remove(watched);
            return Ok(None);
        }
        Ok(Some(Self {
            folder: folder.to_owned(),
            is_alive: alive(&file),
            life: header.life,
            next: 0,
            path,
            file,
            watched,
        }))
    }

    /// Looks whether its publisher is alive.
    pub(super) fn look(&mut self) -> bool {
        // Alive only where others find it: what was cleaned away is made anew elsewhere.
        self.is_alive = is_at(&self.file, &self.path) && alive(&self.file);
        self.is_alive
    }

    /// Messages written so far; none new where the file does not say.
    pub(super) fn count(&self) -> u64 {
        read_u64(&self.file, COUNT_AT).unwrap_or(self.next)
    }

    /// Whether message `n` tells what was so a while ago and may not be any more. The end of a stream stays one.
    pub(super) fn is_stale<M: Message>(&self, n: u64) -> bool {
        let mut message = Box::<M>::default();
        let at = place_of(n, size_of::<M>());
        let read = self.file.read_exact_at(message.as_mut_bytes(), at);
        let is_old = |told: u64| now().saturating_sub(told) > STALE_AFTER.as_nanos() as u64;
        read.is_ok()
            && message.flags() & FLAG_END_OF_STREAM == 0
            && message.told_ns().is_some_and(is_old)
    }

    /// Copies the next message, whole; `false` where there is none, or the writer overtakes again and again.
    ///
    /// # Errors
    /// The system's; those of [`is_damage`].
    pub(super) fn read(&mut self, message: &mut [u8]) -> io::Result<bool> {
        for _ in 0..OVERTAKEN_AT_MOST {
            let count = read_u64(&self.file, COUNT_AT)?;
            if count < self.next {
                // A writer only counts up.
                return Err(io::ErrorKind::InvalidData.into());
            }
            if self.next == count {
                return Ok(false);
            }
            self.next = self.next.max(count.saturating_sub(SLOTS - 1));
            self.file
                .read_exact_at(message, place_of(self.next, message.len()))?;
            // SYNC POINT: each of these reads enters the kernel and takes the page's reference count, which orders
            // them.
            let count = read_u64(&self.file, COUNT_AT)?;
            if count.saturating_sub(self.next) < SLOTS {
                self.next += 1;
                return Ok(true);
            }
        }
        Ok(false)
    }
}

/// Tells when the stream is published with messages that this program cannot read.
fn other_version<M: Message>(folder: &Path, camera: &str) -> Option<LinkError> {
    let stem = file_stem::<M>(camera);
    fs::read_dir(folder).ok()?.flatten().find_map(|entry| {
        let found = version_of(entry.file_name().to_str()?, &stem)?;
        // A pipe would be waited for.
        let flags = OFlags::NOFOLLOW | OFlags::NONBLOCK;
        let opened = OpenOptions::new()
            .read(true)
            .custom_flags(flags.bits().cast_signed())
            .open(entry.path());
        let is_other = found != M::VERSION && alive(&opened.ok()?);
        is_other.then(|| LinkError::Version {
            service: service_name::<M>(camera),
            expected: M::VERSION,
            found,
        })
    })
}

/// Whether somebody else than its writer changed the ring's file: it is cut short, or its count fell.
pub(super) fn is_damage(e: &io::Error) -> bool {
    matches!(
        e.kind(),
        io::ErrorKind::UnexpectedEof | io::ErrorKind::InvalidData
    )
}

/// Whether its writer gave a sign of life lately.
fn alive(file: &File) -> bool {
    match Header::read(file) {
        Ok(Some(header)) if header.alive > 0 => {
            now().abs_diff(header.alive) < GONE_AFTER.as_nanos() as u64
        }
        _ => false,
    }
}
