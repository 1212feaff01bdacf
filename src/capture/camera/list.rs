//! Which cameras there are.

use std::fs;
use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use super::v4l2::{Camera, Capabilities};
use crate::capture::error::CaptureError;
use crate::capture::natural::natural_order;

/// One camera of this machine.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CameraInfo {
    /// Device file.
    pub path: PathBuf,
    /// What it calls itself.
    pub name: String,
    /// Kernel driver.
    pub driver: String,
    /// Where it is plugged in.
    pub bus: String,
    /// Which of its device's files it is, where the system tells: a device with several sensors has as many cameras of
    /// one name.
    pub index: Option<u32>,
}

impl CameraInfo {
    /// Whether two device files belong to the same camera in the same socket.
    pub(crate) fn is_same_camera(&self, other: &Self) -> bool {
        // Where one of them is not known, nothing speaks against it.
        let unlike = self.index.zip(other.index).is_some_and(|(a, b)| a != b);
        (&self.name, &self.bus) == (&other.name, &other.bus) && !unlike
    }

    pub(crate) fn new(path: PathBuf, caps: Capabilities) -> Self {
        Self {
            index: index(Path::new("/sys/dev/char"), &path),
            path,
            name: caps.card,
            driver: caps.driver,
            bus: caps.bus,
        }
    }
}

/// The kernel's number of a device file among those of its device; `files`: where it describes them, by their numbers.
/// A name would not do: the path may be a link.
fn index(files: &Path, path: &Path) -> Option<u32> {
    let device = fs::metadata(path).ok()?.rdev();
    let number = format!("{}:{}", libc::major(device), libc::minor(device));
    let index = fs::read_to_string(files.join(number).join("index")).ok()?;
    index.trim().parse().ok()
}

/// Every camera that gives pictures, by number of its device file.
///
/// # Errors
/// [`CaptureError::Unavailable`] when there is none, [`CaptureError::Permission`] when there are device files that this
/// user may not open and no other camera.
pub fn list_cameras() -> Result<Vec<CameraInfo>, CaptureError> {
    let mut paths: Vec<PathBuf> = fs::read_dir("/dev")
        .map_err(|e| CaptureError::from_io_named("/dev", e))?
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| {
            let name = path.file_name().map(|n| n.to_string_lossy());
            name.and_then(|n| n.strip_prefix("video")?.parse::<u32>().ok())
                .is_some()
        })
        .collect();
    paths.sort_by(|a, b| natural_order(&a.to_string_lossy(), &b.to_string_lossy()));
    let mut cameras = Vec::new();
    let (mut part, mut forbidden) = (None, None);
    for path in paths {
        match Camera::open(&path).and_then(|camera| camera.capabilities()) {
            // Webcams have a second file for metadata, which gives no pictures.
            Ok(caps) if !caps.can_stream => {}
            Ok(caps) => {
                let stands_alone = caps.stands_alone;
                let info = CameraInfo::new(path, caps);
                match stands_alone {
                    true => cameras.push(info),
                    false => part = part.or(Some(info)),
                }
            }
            Err(e) if e.kind() == io::ErrorKind::PermissionDenied => {
                forbidden.get_or_insert(path);
            }
            Err(e) => tracing::debug!("{}: {e}", path.display()),
        }
    }
    match (cameras.is_empty(), forbidden) {
        (false, _) => Ok(cameras),
        (true, Some(path)) => Err(not_permitted(&path.display().to_string())),
        (true, None) => Err(no_camera(part.as_ref())),
    }
}

/// The error of a machine without a camera; `part`: what gives pictures, and none by itself.
fn no_camera(part: Option<&CameraInfo>) -> CaptureError {
    let but = part.map_or(String::new(), |part| {
        format!(
            " that gives pictures by itself ({}, {}, wants other programs: v4l2loopback hands on what they take)",
            part.path.display(),
            part.name
        )
    });
    CaptureError::Unavailable {
        what: "camera".into(),
        reason: format!(
            "expected a camera (/dev/video*), found none{but}; plug one in, or give --input with a photo, a folder or \
             a film"
        ),
    }
}

/// The error of a camera that belongs to others.
pub(crate) fn not_permitted(device: &str) -> CaptureError {
    CaptureError::Permission {
        input: device.into(),
        remedy:
            "add this user to the group `video` (sudo usermod -aG video $USER) and log in again"
                .into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_machine_with_nothing_but_parts_of_cameras_is_told_so() {
        let processor = CameraInfo {
            path: "/dev/video14".into(),
            name: "bcm2835-isp".into(),
            driver: "bcm2835-isp".into(),
            bus: "platform:bcm2835-isp".into(),
            index: None,
        };
        let said = no_camera(Some(&processor)).to_string();
        assert!(said.contains("(/dev/video14, bcm2835-isp, wants"), "{said}");
        let said = no_camera(None).to_string();
        assert!(said.contains("found none; plug one in"), "{said}");
    }

    #[test]
    fn a_device_file_s_index_is_read_by_its_number() {
        let folder = tempfile::tempdir().unwrap();
        let link = folder.path().join("camera");
        // Any device will do: this one is 1:3 everywhere.
        std::os::unix::fs::symlink("/dev/null", &link).unwrap();
        assert_eq!(index(folder.path(), &link), None);
        fs::create_dir(folder.path().join("1:3")).unwrap();
        fs::write(folder.path().join("1:3/index"), "2\n").unwrap();
        assert_eq!(index(folder.path(), &link), Some(2));
    }
}
