//! What a user types after `--input` goes in, a [`Source`] comes out.

use std::convert::Infallible;
use std::fmt;
use std::fs::{File, FileType};
use std::io::{BufReader, Cursor, ErrorKind, Read, Seek, SeekFrom};
use std::os::unix::fs::{FileTypeExt, MetadataExt};
use std::path::{Path, PathBuf};
use std::str::FromStr;

use super::avi::{AviReader, is_avi};
use super::camera::{CameraSource, ControlSetting, list_cameras};
use super::error::{CaptureError, name_of};
use super::ffmpeg::{Ffmpeg, FfmpegSource};
use super::photo::{PhotoSource, is_jpeg, is_png};
use super::pipe::PipeSource;
use super::source::Source;
use super::stand_in::StandIn;
use super::y4m::{self, Y4mReader};
use crate::camera::SystemClock;

/// Bytes read at once from files and pipes.
const BUFFER_BYTES: usize = 1 << 18;
/// What standard input is called.
const STDIN: &str = "standard input";
/// How the name of a camera's stand-in begins.
const STAND_IN: &str = "stand-in:";
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

/// Wishes about an input; a source that cannot fulfil one goes on without it.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct OpenOptions {
    /// Width and height asked of a camera, pixels.
    pub size: Option<(u32, u32)>,
    /// Pictures per second asked of a camera, or at which a folder's photos were taken.
    pub fps: Option<f64>,
    /// What to set on a camera, in this order.
    pub controls: Vec<ControlSetting>,
}

/// Opens an input. What a path is, its bytes say, not its name.
///
/// # Errors
/// [`CaptureError::NoInput`] for missing files and empty folders, [`CaptureError::Data`] for files that are no picture or
/// film, [`CaptureError::Unavailable`] without a camera or without ffmpeg where it is needed, [`CaptureError::Busy`] for a
/// camera in use, [`CaptureError::Permission`] and [`CaptureError::Io`] as the system says.
pub fn open(spec: &InputSpec, options: &OpenOptions) -> Result<Box<dyn Source>, CaptureError> {
    match spec {
        InputSpec::Stdin => {
            let open = || {
                let stdin = BufReader::with_capacity(BUFFER_BYTES, std::io::stdin());
                Ok(Box::new(Y4mReader::new(stdin, STDIN, None)?) as Box<dyn Source>)
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

/// Opens a film in memory: YUV4MPEG2 or Motion-JPEG AVI.
///
/// # Errors
/// [`CaptureError::Data`] for other bytes.
pub fn open_bytes(name: &str, bytes: &'static [u8]) -> Result<Box<dyn Source>, CaptureError> {
    if bytes.starts_with(y4m::MAGIC) {
        let reader = Y4mReader::new(Cursor::new(bytes), name, Some(bytes.len() as u64))?;
        return Ok(Box::new(reader));
    }
    Ok(Box::new(AviReader::new(Cursor::new(bytes), name)?))
}

fn open_path(path: &Path, options: &OpenOptions) -> Result<Box<dyn Source>, CaptureError> {
    let io = |e| CaptureError::from_io(path, e);
    let meta = match std::fs::metadata(path) {
        Err(e) if e.kind() == ErrorKind::NotFound && path.starts_with("/dev") => {
            return Err(no_such_camera(path));
        }
        other => other.map_err(io)?,
    };
    let kind = meta.file_type();
    if kind.is_dir() {
        return Ok(Box::new(PhotoSource::folder(path, options.fps)?));
    }
    if kind.is_char_device() {
        if libc::major(meta.rdev()) != VIDEO_MAJOR {
            return Err(CaptureError::data(
                name_of(path),
                "expected a picture, a film or a camera, found a device that is no camera; see /dev/video*",
            ));
        }
        return open_camera(Some(path), options);
    }
    if is_pipe(kind) {
        let name = name_of(path);
        let path = path.to_owned();
        let open = move || {
            // Opening waits for the pipe's writer.
            let pipe = File::open(&path).map_err(|e| CaptureError::from_io(&path, e))?;
            let pipe = BufReader::with_capacity(BUFFER_BYTES, pipe);
            Ok(Box::new(Y4mReader::new(pipe, name_of(&path), None)?) as Box<dyn Source>)
        };
        return Ok(Box::new(PipeSource::start(name, open)));
    }
    open_file(path, options)
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

/// A named pipe can be read once, from front to back: it carries YUV4MPEG2, like standard input.
fn is_pipe(kind: FileType) -> bool {
    kind.is_fifo() || kind.is_socket()
}

fn open_file(path: &Path, options: &OpenOptions) -> Result<Box<dyn Source>, CaptureError> {
    let io = |e| CaptureError::from_io(path, e);
    let mut file = File::open(path).map_err(io)?;
    let length = file.metadata().map_err(io)?.len();
    let mut head = Vec::new();
    file.by_ref().take(64).read_to_end(&mut head).map_err(io)?;
    file.seek(SeekFrom::Start(0)).map_err(io)?;
    if head.is_empty() {
        return Err(CaptureError::data(
            name_of(path),
            "expected a picture or film, found an empty file; copy it again",
        ));
    }
    if is_jpeg(&head) || is_png(&head) {
        return Ok(Box::new(PhotoSource::file(path, options.fps)));
    }
    let reader = BufReader::with_capacity(BUFFER_BYTES, file);
    if head.starts_with(y4m::MAGIC) {
        return Ok(Box::new(Y4mReader::new(
            reader,
            name_of(path),
            Some(length),
        )?));
    }
    if is_avi(&head) {
        let film = AviReader::new(reader, name_of(path))?;
        if film.is_motion_jpeg() {
            return Ok(Box::new(film));
        }
    }
    if !is_film(&head, path) {
        return Err(CaptureError::data(
            name_of(path),
            "expected a photo (JPEG, PNG), a folder of photos, a film or a camera, found other bytes; check the path",
        ));
    }
    #[cfg(feature = "mp4")]
    if head.get(4..8) == Some(b"ftyp")
        && let Some(film) = super::mp4::Mp4Source::open(path)?
    {
        return Ok(Box::new(film));
    }
    Ok(Box::new(FfmpegSource::open(path, &Ffmpeg::default())?))
}

/// Whether ffmpeg should be asked. It would take any text for a film of letters, so that not everything is given to it: a
/// name counts only for kinds whose first bytes do not tell.
fn is_film(head: &[u8], path: &Path) -> bool {
    let container = is_avi(head)
        || head.get(4..8) == Some(b"ftyp")
        || head.starts_with(&[0x1A, 0x45, 0xDF, 0xA3])
        || head.starts_with(b"FLV")
        || head.starts_with(b"OggS");
    container
        || path.extension().is_some_and(|e| {
            [
                "mp4", "m4v", "mov", "mpg", "mpeg", "ts", "m2ts", "wmv", "3gp", "h264", "265",
                "264", "gif",
            ]
            .iter()
            .any(|k| e.eq_ignore_ascii_case(k))
        })
}

fn open_camera(
    path: Option<&Path>,
    options: &OpenOptions,
) -> Result<Box<dyn Source>, CaptureError> {
    Ok(Box::new(CameraSource::open(path, options)?))
}
