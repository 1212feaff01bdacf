//! A frame goes in, a PNG file comes out: whole or not at all.

use std::io;
use std::path::{Path, PathBuf};

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};

use crate::capture::Frame;
use crate::output::{AtomicFile, no_room};

/// Why a picture could not be written.
#[derive(Debug, thiserror::Error)]
#[error("{path}: cannot write the picture ({})", why(.source))]
pub struct OverlayError {
    /// The file that was to be written.
    pub path: PathBuf,
    /// The system's own words.
    pub source: io::Error,
}

impl OverlayError {
    /// The code from `sysexits.h` that a command ends with: 73, cannot create; 74 where nothing more finds room.
    pub fn exit_code(&self) -> u8 {
        if no_room(&self.source).is_some() {
            74
        } else {
            73
        }
    }
}

fn why(source: &io::Error) -> String {
    no_room(source).map_or_else(
        || format!("{source}; check that the folder exists and is writable"),
        ToOwned::to_owned,
    )
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
