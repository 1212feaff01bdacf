//! What a user types after `--input` goes in, a [`Source`] comes out.

use std::convert::Infallible;
use std::fmt;
use std::fs::{self, File};
use std::io::{BufReader, ErrorKind};
use std::os::unix::fs::{FileTypeExt, MetadataExt};
use std::path::{Component, Path, PathBuf};
use std::str::FromStr;

use super::camera::{CameraSource, OpenOptions, list_cameras};
use super::error::{CaptureError, name_of};
use super::pipe::PipeSource;
use super::source::Source;
use super::square::square;
use super::stand_in::StandIn;
use super::stored::{is_film, open_stored};
use super::y4m::Y4mReader;
use crate::camera::SystemClock;

/// Bytes read at once from pipes.
const BUFFER_BYTES: usize = 1 << 18;
/// What standard input is called as a source.
pub const STDIN: &str = "standard input";
/// How the name of a camera's stand-in begins.
const STAND_IN: &str = "stand-in:";
/// Folders of /dev in which no devices lie, but what people and programs put there.
const HOLD_FILES: [&str; 4] = ["shm", "mqueue", "hugepages", "fd"];
/// Links that are followed at most, one from another: some lead to each other.
const MOST_LINKS: usize = 8;
/// Major number of V4L2 device files on Linux.
const VIDEO_MAJOR: u32 = 81;

/// An input by name.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum InputSpec {
    /// `camera`: the first camera there is.
    FirstCamera,
    /// `-`: YUV4MPEG2 on standard input.
    Stdin,
    /// `demo`: the bundled clip.
    Demo,
    /// `stand-in:FILE`: a camera for tests, which the file stands for.
    StandIn(PathBuf),
    /// Anything else: a photo, a folder of photos, a film or a camera's device file.
    Path(PathBuf),
}

impl FromStr for InputSpec {
    type Err = Infallible;

    fn from_str(text: &str) -> Result<Self, Infallible> {
        Ok(match text {
            "camera" => Self::FirstCamera,
            "-" => Self::Stdin,
            "demo" => Self::Demo,
            other => match other.strip_prefix(STAND_IN) {
                Some(file) => Self::StandIn(file.into()),
                None => Self::Path(other.into()),
            },
        })
    }
}

impl fmt::Display for InputSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::FirstCamera => f.write_str("camera"),
            Self::Stdin => f.write_str("-"),
            Self::Demo => f.write_str("demo"),
            Self::StandIn(path) => write!(f, "{STAND_IN}{}", path.display()),
            Self::Path(path) => path.display().fmt(f),
        }
    }
}

/// Opens an input. What a path is, its bytes say, and its name only where they do not.
///
/// # Errors
/// [`CaptureError::NoInput`] for missing files and empty folders, [`CaptureError::Data`] for files that are no picture
/// or film, [`CaptureError::Unavailable`] without a camera or without ffmpeg where it is needed, [`CaptureError::Busy`]
/// for a camera in use, [`CaptureError::Permission`] and [`CaptureError::Io`] as the system says.
pub fn open(spec: &InputSpec, options: &OpenOptions) -> Result<Box<dyn Source>, CaptureError> {
    match spec {
        InputSpec::Stdin => {
            let open = || {
                let stdin = BufReader::with_capacity(BUFFER_BYTES, std::io::stdin());
                let film = Y4mReader::new(stdin, STDIN, None)?;
                let shape = film.pixel_shape();
                Ok(square(film, shape))
            };
            Ok(Box::new(PipeSource::start(STDIN.to_owned(), open)))
        }
        InputSpec::Demo => Err(CaptureError::Config {
            setting: "demo".into(),
            reason: "the bundled clip is opened from memory, by open_bytes".into(),
        }),
        InputSpec::FirstCamera => open_camera(None, options),
        InputSpec::StandIn(path) => Ok(Box::new(StandIn::open(path, SystemClock)?)),
        InputSpec::Path(path) => open_path(path, options),
    }
}

fn open_path(path: &Path, options: &OpenOptions) -> Result<Box<dyn Source>, CaptureError> {
    let io = |e| CaptureError::from_io(path, e);
    let meta = match fs::metadata(path) {
        Err(e) if e.kind() == ErrorKind::NotFound && is_camera_place(path) => {
            return Err(no_such_camera(path));
        }
        other => other.map_err(io)?,
    };
    let kind = meta.file_type();
    if kind.is_char_device() {
        if libc::major(meta.rdev()) != VIDEO_MAJOR {
            return Err(CaptureError::data(
                name_of(path),
                "expected a picture, a film or a camera, found a device that is no camera; see /dev/video*",
            ));
        }
        return open_camera(Some(path), options);
    }
    if kind.is_socket() {
        return Err(CaptureError::NoInput {
            input: name_of(path),
            reason: "expected a file, a pipe or a camera, found a socket; check the path, or hand its bytes on through a pipe (mkfifo)".into(),
        });
    }
    // It can be read once, from front to back: it carries YUV4MPEG2, like standard input.
    if kind.is_fifo() {
        let name = name_of(path);
        let path = path.to_owned();
        let open = move || {
            // Opening waits for the pipe's writer.
            let pipe = File::open(&path).map_err(|e| CaptureError::from_io(&path, e))?;
            let pipe = BufReader::with_capacity(BUFFER_BYTES, pipe);
            let film = Y4mReader::new(pipe, name_of(&path), None)?;
            let shape = film.pixel_shape();
            Ok(square(film, shape))
        };
        return Ok(Box::new(PipeSource::start(name, open)));
    }
    open_stored(path, options.fps)
}

/// Whether a camera may come where nothing is: its device file, a link to it in a folder of udev's, or a link from
/// anywhere to one of these.
pub fn is_camera_place(path: &Path) -> bool {
    let mut place = path.to_owned();
    for _ in 0..MOST_LINKS {
        if is_device_place(&place) {
            return true;
        }
        match fs::read_link(&place) {
            Ok(target) => place = followed(&place, &target),
            Err(_) => return false,
        }
    }
    false
}

fn is_device_place(path: &Path) -> bool {
    path.strip_prefix("/dev").is_ok_and(|below| {
        let holds_files = HOLD_FILES.iter().any(|folder| below.starts_with(folder));
        !holds_files && !is_film(path)
    })
}

/// Where a link leads that has this target, also where nothing is: a folder of udev's is there with its first device.
fn followed(link: &Path, target: &Path) -> PathBuf {
    let folder = match link.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    let mut place = folder.canonicalize().unwrap_or_else(|_| folder.to_owned());
    for part in target.components() {
        match part {
            Component::ParentDir => {
                place.pop();
            }
            Component::CurDir => {}
            // The root begins anew.
            other => place.push(other),
        }
    }
    place
}

/// A device file that is not there, with those that are.
fn no_such_camera(path: &Path) -> CaptureError {
    let others: Vec<String> = list_cameras()
        .unwrap_or_default()
        .iter()
        .map(|c| format!("{} ({})", c.path.display(), c.name))
        .collect();
    let remedy = if others.is_empty() {
        "plug a camera in".into()
    } else {
        format!("there is {}", others.join(", "))
    };
    CaptureError::Unavailable {
        what: name_of(path),
        reason: format!("expected a camera, found no such device; {remedy}"),
    }
}

fn open_camera(
    path: Option<&Path>,
    options: &OpenOptions,
) -> Result<Box<dyn Source>, CaptureError> {
    Ok(Box::new(CameraSource::open(path, options)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cameras_come_where_devices_lie_and_files_do_not() {
        for (path, may_come) in [
            ("/dev/video0", true),
            ("/dev/v4l/by-id/usb-hall-video-index0", true),
            ("/dev/hall", true),
            ("/dev/cameras/hall", true),
            ("/dev/none.avi", false),
            ("/dev/shm/none.avi", false),
            ("/dev/shm/photos", false),
            ("/dev/mqueue/hall", false),
            ("/dev/fd/9", false),
            ("/home/video0", false),
            ("video0", false),
        ] {
            assert_eq!(is_camera_place(Path::new(path)), may_come, "{path}");
        }
    }

    #[test]
    fn a_camera_comes_where_a_link_leads_that_is_told_from_its_folder() {
        let folder = tempfile::tempdir().unwrap();
        let link = |name: &str, target: &str| {
            let link = folder.path().join(name);
            std::os::unix::fs::symlink(target, &link).unwrap();
            link
        };
        let real = folder.path().canonicalize().unwrap();
        let up = "../".repeat(real.components().count() - 1);
        for (name, target, may_come) in [
            ("hall", "/dev/video99", true),
            ("by-id", "/dev/v4l/by-id/nobody-has-this", true),
            ("relative", &format!("./{up}dev/video99"), true),
            ("of-another", "hall", true),
            ("film", "/nowhere.avi", false),
            ("film-there", "/dev/none.avi", false),
            ("beside", "dev/video99", false),
            ("itself", "itself", false),
        ] {
            assert_eq!(is_camera_place(&link(name, target)), may_come, "{name}");
        }
    }
}
