//! Whole files into memory, but not `/dev/zero`: what does not end is refused before it fills the memory.

use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

/// Most bytes of a file that people write: settings, lenses.
pub const SETTINGS: u64 = 16 << 20;
/// Most bytes of a file that programs write: models, records, truth.
pub const DATA: u64 = 2 << 30;

/// The bytes of a file or pipe.
///
/// # Errors
/// The system's, and [`io::ErrorKind::FileTooLarge`] beyond `most` bytes.
pub fn read(path: &Path, most: u64) -> io::Result<Vec<u8>> {
    let file = File::open(path)?;
    let meta = file.metadata()?;
    let mut bytes = Vec::new();
    // A file says how long it is; a device says 0 and never ends.
    if meta.len() <= most {
        bytes.reserve(usize::try_from(meta.len()).unwrap_or(0));
        file.take(most + 1).read_to_end(&mut bytes)?;
    }
    if meta.len() > most || bytes.len() as u64 > most {
        return Err(io::Error::new(
            io::ErrorKind::FileTooLarge,
            format!("expected at most {} MB, found more", most >> 20),
        ));
    }
    Ok(bytes)
}

/// The text of a file or pipe.
///
/// # Errors
/// As [`read`], and [`io::ErrorKind::InvalidData`] for bytes that are no UTF-8.
pub fn read_text(path: &Path, most: u64) -> io::Result<String> {
    String::from_utf8(read(path, most)?).map_err(|_| {
        io::Error::new(
            io::ErrorKind::InvalidData,
            "expected text, found other bytes",
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_fits_is_read_and_what_does_not_end_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        std::fs::write(&path, "text").unwrap();
        assert_eq!(read_text(&path, 4).unwrap(), "text");
        for (path, most) in [(&*path, 3), (Path::new("/dev/zero"), 1000)] {
            let refused = read(path, most).unwrap_err();
            assert_eq!(refused.kind(), io::ErrorKind::FileTooLarge);
        }
        std::fs::write(&path, b"\xff\xfe").unwrap();
        let refused = read_text(&path, 4).unwrap_err();
        assert_eq!(refused.kind(), io::ErrorKind::InvalidData);
    }
}
