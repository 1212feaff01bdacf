//! Where the bytes of a file go until it is finished.

use std::fs::File;
use std::io::{self, Seek, SeekFrom, Write};

use tempfile::NamedTempFile;

/// Where bytes go until the file is finished.
#[derive(Debug)]
pub(super) enum Place {
    /// Beside the file's place.
    Beside(NamedTempFile),
    /// In the file's place already.
    Named(File),
    /// A device or pipe that was there before and stays.
    Device(File),
}

impl Write for Place {
    fn write(&mut self, buf: &[u8]) -> io::Result<usize> {
        match self {
            // Not through the temporary file, whose errors name it.
            Self::Beside(file) => file.as_file_mut().write(buf),
            Self::Named(file) | Self::Device(file) => file.write(buf),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match self {
            Self::Beside(file) => file.flush(),
            Self::Named(file) | Self::Device(file) => file.flush(),
        }
    }
}

impl Seek for Place {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        match self {
            Self::Beside(file) => file.seek(to),
            Self::Named(file) | Self::Device(file) => file.seek(to),
        }
    }
}

/// Up to where a file holds what was written to it: somebody may have cut it since, and it is not to be made longer.
pub(super) fn written_to(file: &mut File) -> io::Result<u64> {
    Ok(file.stream_position()?.min(file.metadata()?.len()))
}
