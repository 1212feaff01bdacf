//! Photos and films that lie in files or in memory. What a file is, its bytes say, and its name only where they do not.

use std::fs::File;
use std::io::{BufReader, Cursor, Read, Seek, SeekFrom};
use std::path::Path;

use super::album::{MOTION_JPEG, ends_in, head, other_kind};
use super::avi::{AviReader, is_avi};
use super::error::{CaptureError, name_of};
use super::ffmpeg::{Ffmpeg, FfmpegSource};
use super::jfif::jfif_shape;
use super::mjpeg::MjpegReader;
use super::photo::PhotoSource;
use super::signature::{is_jpeg, is_png};
use super::source::Source;
use super::square::square;
use super::y4m::{self, Y4mReader};

/// Bytes read at once.
const BUFFER_BYTES: usize = 1 << 18;
/// Endings of films whose first bytes do not tell.
const TOLD_BY_NAME: [&str; 24] = [
    "mp4", "m4v", "mov", "mpg", "mpeg", "m2v", "vob", "ts", "m2t", "mts", "m2ts", "wmv", "asf",
    "3gp", "3g2", "mxf", "dv", "264", "h264", "265", "h265", "hevc", "gif", "mod",
];
/// Endings of films that are known by their first bytes, whatever their name.
const TOLD_BY_BYTES: [&str; 7] = ["avi", "mkv", "webm", "y4m", "flv", "ogv", "f4v"];

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

/// Opens a photo, a folder of photos or a film. `fps`: at which a folder's photos, or a film whose file tells no times,
/// were taken.
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
    // Such a film begins as a photo does, and some phones append a film to a photo: only the name tells.
    if is_jpeg(&head) && ends_in(path, &MOTION_JPEG) {
        let shape = head.first_chunk().and_then(jfif_shape);
        let reader = BufReader::with_capacity(BUFFER_BYTES, file);
        return Ok(square(MjpegReader::new(reader, name_of(path), fps), shape));
    }
    if is_photo_by(&head, path) {
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
    if !is_for_ffmpeg(&head, path) {
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
    let film = FfmpegSource::open_at(path, &Ffmpeg::default(), fps)?;
    Ok(Box::new(film))
}

/// Whether photos lie there that have nothing to do with each other in time, as [`Source::is_stills`] says of what
/// `open_stored` opens at this rate. What cannot be read is none.
pub fn holds_stills(path: &Path, fps: Option<f64>) -> bool {
    let is_photo = || path.is_file() && is_photo_by(&head(path), path);
    fps.is_none() && (path.is_dir() || is_photo())
}

fn is_photo_by(head: &[u8], path: &Path) -> bool {
    is_png(head) || is_jpeg(head) && !ends_in(path, &MOTION_JPEG)
}

/// Whether a file is a film by its name.
pub fn is_film(path: &Path) -> bool {
    [&TOLD_BY_NAME[..], &TOLD_BY_BYTES, &MOTION_JPEG]
        .iter()
        .any(|endings| ends_in(path, endings))
}

/// Whether ffmpeg should be asked. It would take any text for a film of letters, so that not everything is given to it:
/// a name counts only for kinds whose first bytes do not tell.
fn is_for_ffmpeg(head: &[u8], path: &Path) -> bool {
    is_avi(head)
        || head.get(4..8) == Some(b"ftyp")
        || head.starts_with(&[0x1A, 0x45, 0xDF, 0xA3])
        || head.starts_with(b"FLV")
        || head.starts_with(b"OggS")
        || ends_in(path, &TOLD_BY_NAME)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn films_of_camcorders_and_encoders_are_given_to_ffmpeg() {
        let path = |ending: &str| format!("hall.{ending}");
        for ending in [
            "mts", "MTS", "m2ts", "vob", "hevc", "h265", "mxf", "dv", "asf", "Mp4",
        ] {
            let name = path(ending);
            assert!(is_for_ffmpeg(b"other bytes", Path::new(&name)), "{ending}");
        }
        for ending in ["txt", "jsonl", "avi"] {
            let name = path(ending);
            assert!(!is_for_ffmpeg(b"other bytes", Path::new(&name)), "{ending}");
        }
    }

    #[test]
    fn stills_are_known_before_they_are_opened() {
        let folder = tempfile::tempdir().unwrap();
        let jpeg = b"\xFF\xD8\xFF\xE0 and more";
        for (name, bytes, holds) in [
            ("a.png", &b"\x89PNG\r\n\x1A\n and more"[..], true),
            ("named-otherwise", jpeg, true),
            ("a.mjpeg", jpeg, false),
            ("a.jpg", b"YUV4MPEG2 W2 H2 F25:1 Cmono\n", false),
        ] {
            let path = folder.path().join(name);
            std::fs::write(&path, bytes).unwrap();
            assert_eq!(holds_stills(&path, None), holds, "{name}");
            assert_eq!(open_stored(&path, None).unwrap().is_stills(), holds);
            assert!(!holds_stills(&path, Some(30.0)), "{name}");
        }
        for (fps, holds) in [(None, true), (Some(30.0), false)] {
            assert_eq!(holds_stills(folder.path(), fps), holds);
            assert_eq!(open_stored(folder.path(), fps).unwrap().is_stills(), holds);
        }
        assert!(!holds_stills(&folder.path().join("none.jpg"), None));
    }

    #[test]
    fn films_are_known_by_their_names() {
        for name in [
            "a.mp4", "a.mpg", "a.MTS", "a.wmv", "a.gif", "a.avi", "a.y4m", "a.mjpeg",
        ] {
            assert!(is_film(Path::new(name)), "{name}");
        }
        for name in ["a.jsonl", "a.edgecap", "a.jpg", "mp4", "a"] {
            assert!(!is_film(Path::new(name)), "{name}");
        }
    }
}
