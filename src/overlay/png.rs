//! A frame goes in, a PNG file comes out: whole or not at all.

use std::io;
use std::path::{Path, PathBuf};

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};

use crate::capture::Frame;
use crate::output::AtomicFile;

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

/// Writes the picture: nobody ever sees half a file, and nothing is left behind after an error. A link of this name is
/// replaced: it may lead to the very picture that was drawn on.
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
    let mut file = AtomicFile::replacing_links(path)?.passing();
    PngEncoder::new_with_quality(&mut file, CompressionType::Fast, FilterType::Up)
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
    file.finish()
}
