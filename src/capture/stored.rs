//! Photos and films that lie in files or in memory. What a file is, its bytes say, not its name.

use std::fs::File;
use std::io::{BufReader, Cursor, Read, Seek, SeekFrom};
use std::path::Path;

use super::album::other_kind;
use super::avi::{AviReader, is_avi};
use super::error::{CaptureError, name_of};
use super::ffmpeg::{Ffmpeg, FfmpegSource};
use super::photo::{PhotoSource, is_jpeg, is_png};
use super::source::Source;
use super::square::square;
use super::y4m::{self, Y4mReader};

/// Bytes read at once.
const BUFFER_BYTES: usize = 1 << 18;

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

/// Opens a photo, a folder of photos or a film. `fps`: at which a folder's photos were taken.
///
/// # Errors
/// [`CaptureError::NoInput`] for missing files and empty folders, [`CaptureError::Data`] for files that are no picture
/// or film, [`CaptureError::Unavailable`] without ffmpeg where it is needed, [`CaptureError::Io`] as the system says.
pub fn open_stored(path: &Path, fps: Option<f64>) -> Result<Box<dyn Source>, CaptureError> {
    if path.is_dir() {
        return Ok(Box::new(PhotoSource::folder(path, fps)?));
    }
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
        return Ok(Box::new(PhotoSource::file(path, fps)));
    }
    if let Some(kind) = other_kind(&head) {
        return Err(CaptureError::data(
            name_of(path),
            format!("expected a JPEG or PNG photo, found {kind}; convert it to JPEG or PNG"),
        ));
    }
    if head.starts_with(y4m::MAGIC) {
        let reader = BufReader::with_capacity(BUFFER_BYTES, file);
        let film = Y4mReader::new(reader, name_of(path), Some(length))?;
        let shape = film.pixel_shape();
        return Ok(square(film, shape));
    }
    if is_avi(&head) {
        // Without a buffer, which would be filled for every chunk's eight bytes: pictures are read whole.
        let mut film = AviReader::new(file, name_of(path))?;
        if film.is_motion_jpeg() {
            let shape = film.pixel_shape();
            return Ok(square(film, shape));
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
        let shape = film.pixel_shape();
        return Ok(square(film, shape));
    }
    Ok(Box::new(FfmpegSource::open(path, &Ffmpeg::default())?))
}

/// Whether ffmpeg should be asked. It would take any text for a film of letters, so that not everything is given to it:
/// a name counts only for kinds whose first bytes do not tell.
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
