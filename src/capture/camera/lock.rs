//! One program per camera: a lock that the kernel gives back when its holder ends, however it ends.
//!
//! It lies in the folder of this user's shared memory, where nobody else can make, hold or remove it. Of another user's
//! program the camera's own refusal tells.

use std::fs::{File, OpenOptions, TryLockError};
use std::io::{Read, Seek, SeekFrom, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};

use edgecap_client::place::{Place, runtime_dir};

use crate::capture::error::CaptureError;

/// The right to use a camera, for as long as this value lives.
#[derive(Debug)]
pub struct InstanceLock {
    /// Holds the lock; `None` where no lock file can be made, and the camera's own refusal has to do.
    file: Option<File>,
}

impl InstanceLock {
    /// Takes the lock of `key` (a device's name).
    ///
    /// # Errors
    /// [`CaptureError::Busy`] when another process, or another place in this one, holds it; the message names the
    /// process.
    pub fn acquire(key: &str) -> Result<Self, CaptureError> {
        Self::acquire_in(&runtime_dir(), key)
    }

    /// As [`acquire`](Self::acquire), in a given folder, which is nobody's but this user's.
    ///
    /// # Errors
    /// As [`acquire`](Self::acquire).
    pub fn acquire_in(folder: &Path, key: &str) -> Result<Self, CaptureError> {
        if let Err(e) = Place::enter_at(folder) {
            tracing::debug!("no place for a lock: {e}");
            return Ok(Self { file: None });
        }
        let safe: String = key
            .chars()
            .map(|c| if c.is_ascii_alphanumeric() { c } else { '-' })
            .collect();
        let path = folder.join(format!("edgecap{safe}.lock"));
        let opened = OpenOptions::new()
            .read(true)
            .write(true)
            .create(true)
            .truncate(false)
            .mode(0o600)
            .custom_flags(libc::O_NOFOLLOW)
            .open(&path);
        let mut file = match opened {
            Ok(file) => file,
            Err(e) => {
                tracing::debug!("no lock file {}: {e}", path.display());
                return Ok(Self { file: None });
            }
        };
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                let mut holder = String::new();
                // A missing number only makes the message shorter.
                let _ = file.take(16).read_to_string(&mut holder);
                let holder = match holder.trim().parse::<u32>() {
                    Ok(pid) => format!("process {pid}"),
                    Err(_) => "another process".into(),
                };
                return Err(CaptureError::Busy {
                    device: key.into(),
                    reason: format!(
                        "edgecap already uses this camera ({holder}); stop it first, or read what it publishes"
                    ),
                });
            }
            Err(TryLockError::Error(e)) => {
                tracing::debug!("no lock on {}: {e}", path.display());
                return Ok(Self { file: None });
            }
        }
        // For the message above only: a failure changes nothing.
        let _ = file
            .set_len(0)
            .and_then(|()| file.seek(SeekFrom::Start(0)))
            .and_then(|_| writeln!(file, "{}", std::process::id()));
        Ok(Self { file: Some(file) })
    }

    /// Whether the kernel guards this camera for us.
    pub fn is_held(&self) -> bool {
        self.file.is_some()
    }
}

impl Drop for InstanceLock {
    fn drop(&mut self) {
        // Closing would not do while a child of another thread, forked but not yet another program, holds the same open
        // file.
        if let Some(file) = &self.file {
            let _ = file.unlock();
        }
    }
}

/// The lock of the device that a camera has: plugged in again, it may have another one.
#[derive(Debug)]
pub struct DeviceLock {
    folder: PathBuf,
    held: Option<(String, InstanceLock)>,
}

impl DeviceLock {
    /// Holds nothing yet; locks lie in `folder`.
    pub fn new(folder: impl Into<PathBuf>) -> Self {
        Self {
            folder: folder.into(),
            held: None,
        }
    }

    /// Holds the lock of `device`, and no other any more, whether it gets this one or not: two cameras that have
    /// changed places would wait for each other.
    ///
    /// # Errors
    /// As [`InstanceLock::acquire`].
    pub fn hold(&mut self, device: &Path) -> Result<(), CaptureError> {
        let key = lock_key(device);
        let held = self.held.take().filter(|(held, _)| *held == key);
        let lock = match held {
            Some((_, lock)) => lock,
            None => InstanceLock::acquire_in(&self.folder, &key)?,
        };
        self.held = Some((key, lock));
        Ok(())
    }

    /// Holds nothing any more.
    pub fn release(&mut self) {
        self.held = None;
    }
}

/// A name that is the same for all links to a device: `/dev/video0` for `/dev/v4l/by-id/usb-…`.
fn lock_key(path: &Path) -> String {
    let real = path.canonicalize().unwrap_or_else(|_| path.to_owned());
    real.display().to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_lock_follows_a_camera_to_its_new_device() {
        let folder = tempfile::tempdir().unwrap();
        let (old, new) = (folder.path().join("video0"), folder.path().join("video1"));
        let link = folder.path().join("by-id");
        for device in [&old, &new] {
            std::fs::write(device, "").unwrap();
        }
        let plug = |device: &Path| {
            let _ = std::fs::remove_file(&link);
            std::os::unix::fs::symlink(device, &link).unwrap();
        };
        let is_free = |device: &Path| DeviceLock::new(folder.path()).hold(device).is_ok();
        let mut camera = DeviceLock::new(folder.path());
        plug(&old);
        camera.hold(&link).unwrap();
        camera.hold(&old).unwrap();
        assert!(!is_free(&old) && is_free(&new));
        plug(&new);
        camera.hold(&link).unwrap();
        assert!(is_free(&old) && !is_free(&new));
        camera.release();
        assert!(is_free(&new));
    }

    #[test]
    fn cameras_that_have_changed_places_do_not_wait_for_each_other() {
        let folder = tempfile::tempdir().unwrap();
        let [left, right] = ["left", "right"].map(|name| folder.path().join(name));
        let [mut a, mut b] = [(); 2].map(|()| DeviceLock::new(folder.path()));
        a.hold(&left).unwrap();
        b.hold(&right).unwrap();
        assert_eq!(a.hold(&right).unwrap_err().exit_code(), 75);
        b.hold(&left).unwrap();
        a.hold(&right).unwrap();
    }
}
