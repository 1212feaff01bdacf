//! A frame goes in, a PNG file comes out: whole or not at all.

use std::fs::Permissions;
use std::io::{self, BufWriter, Write};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};

use crate::capture::Frame;

/// Why a picture could not be written.
#[derive(Debug, thiserror::Error)]
#[error(
    "{path}: cannot write the picture ({source}); check that the folder exists, is writable and has room"
)]
pub struct OverlayError {
    /// The file that was to be written.
    pub path: PathBuf,
    /// The system's own words.
    pub source: io::Error,
}

impl OverlayError {
    /// The code from `sysexits.h` that a command ends with: 73, cannot create.
    pub fn exit_code(&self) -> u8 {
        73
    }
}

/// Writes beside `path`, then renames: nobody ever sees half a file, and nothing is left behind after an error.
///
/// # Errors
/// [`OverlayError`] when the file cannot be created, written or renamed.
pub fn write_png(frame: &Frame, path: &Path) -> Result<(), OverlayError> {
    write(frame, path).map_err(|source| OverlayError {
        path: path.to_owned(),
        source,
    })
}

fn write(frame: &Frame, path: &Path) -> io::Result<()> {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty());
    let file = tempfile::Builder::new()
        .prefix(".overlay-")
        .suffix(".part")
        // As any other new file; the user's mask applies.
        .permissions(Permissions::from_mode(0o666))
        .tempfile_in(folder.unwrap_or(Path::new(".")))?;
    let mut buffered = BufWriter::with_capacity(1 << 16, file);
    PngEncoder::new_with_quality(&mut buffered, CompressionType::Fast, FilterType::Up)
        .write_image(
            &frame.rgb,
            frame.width,
            frame.height,
            ExtendedColorType::Rgb8,
        )
        .map_err(|e| match e {
            image::ImageError::IoError(e) => e,
            other => io::Error::other(other),
        })?;
    buffered.flush()?;
    let file = buffered.into_inner().map_err(|e| e.into_error())?;
    file.persist(path)?;
    Ok(())
}
