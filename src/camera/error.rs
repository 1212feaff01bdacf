//! What can be wrong with a file that describes cameras.

use std::io;
use std::path::Path;

/// Why a file yields no camera.
#[derive(Debug, thiserror::Error)]
pub enum CameraError {
    /// The file cannot be read.
    #[error("{file}: {source}; {}", remedy(.source))]
    Read {
        /// The file.
        file: String,
        /// The system's own words.
        source: io::Error,
    },
    /// The user's own description of the camera contradicts itself.
    #[error("{file}: {reason}")]
    Settings {
        /// The file.
        file: String,
        /// What was expected, what was found.
        reason: String,
    },
    /// A calibration of another program cannot be read.
    #[error("{file}: expected {expected}, found {found}")]
    Calibration {
        /// The file.
        file: String,
        /// The format.
        expected: &'static str,
        /// What is wrong with it.
        found: String,
    },
}

impl CameraError {
    /// The code from `sysexits.h` that a command ends with: 65 data, 66 no input, 74 input/output, 77 permission,
    /// 78 configuration.
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Read { source, .. } if is_nowhere(source) => 66,
            Self::Read { source, .. } => match source.kind() {
                io::ErrorKind::IsADirectory => 66,
                io::ErrorKind::PermissionDenied => 77,
                io::ErrorKind::InvalidData | io::ErrorKind::FileTooLarge => 65,
                _ => 74,
            },
            Self::Settings { .. } => 78,
            Self::Calibration { .. } => 65,
        }
    }

    /// A file that cannot be read.
    pub(crate) fn read(path: &Path, source: io::Error) -> Self {
        Self::Read {
            file: path.display().to_string(),
            source,
        }
    }
}

/// What to do about a file that cannot be read.
fn remedy(error: &io::Error) -> &'static str {
    match error.kind() {
        io::ErrorKind::FileTooLarge => "check that it is the right file",
        io::ErrorKind::InvalidData => "check that it is the right file, saved as text in UTF-8",
        _ => "check the path and its permissions",
    }
}

/// Whether the system says that a path leads to no file: nothing is there, or can be (a file as a folder, links in a
/// circle, a name that is too long), or a socket or a device without hardware is.
pub(crate) fn is_nowhere(error: &io::Error) -> bool {
    let code = error.raw_os_error();
    error.kind() == io::ErrorKind::NotFound
        || matches!(
            code,
            Some(libc::ENOTDIR | libc::ELOOP | libc::ENAMETOOLONG | libc::ENXIO)
        )
}

#[cfg(test)]
mod tests {
    use rustix::fs::{CWD, FileType, Mode, mknodat};

    use super::*;

    /// A failure on the way is tried again and again.
    #[test]
    fn what_is_no_file_or_no_lens_does_not_fail_on_the_way() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        std::fs::write(&file, "").unwrap();
        let circle = folder.path().join("circle");
        std::os::unix::fs::symlink(&circle, &circle).unwrap();
        let socket = folder.path().join("socket");
        mknodat(CWD, &socket, FileType::Socket, Mode::RWXU, 0).unwrap();
        for (path, code) in [
            (folder.path().join("none.toml"), 66),
            (file.join("lens.toml"), 66),
            (circle, 66),
            (socket, 66),
            (folder.path().join("a".repeat(300)), 66),
            (folder.path().to_owned(), 66),
            (Path::new("/dev/zero").to_owned(), 65),
        ] {
            let failed = crate::camera::CameraFile::read(&path).unwrap_err();
            assert_eq!(failed.exit_code(), code, "{failed}");
        }
    }
}
