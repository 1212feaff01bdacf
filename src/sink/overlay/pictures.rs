//! A folder of pictures.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use crate::capture::Frame;
use crate::counted::counted;
use crate::overlay::write_png;
use crate::sink::SinkError;

/// Writes one PNG a picture.
#[derive(Debug)]
pub struct Pictures {
    folder: PathBuf,
    /// Names given so far, where pictures are called like their photos.
    names: Option<HashSet<String>>,
    written: u64,
}

impl Pictures {
    /// Makes the folder; `by_photo`: pictures are called like their photo, else by their number.
    ///
    /// # Errors
    /// [`SinkError::Create`].
    pub fn create(folder: &Path, by_photo: bool) -> Result<Self, SinkError> {
        std::fs::create_dir_all(folder).map_err(|cause| SinkError::Create {
            path: folder.to_owned(),
            cause,
        })?;
        Ok(Self {
            folder: folder.to_owned(),
            names: by_photo.then(HashSet::new),
            written: 0,
        })
    }

    /// Writes a picture.
    ///
    /// # Errors
    /// [`SinkError::Picture`].
    pub fn write(&mut self, picture: &Frame, sequence: u64, source: &str) -> Result<(), SinkError> {
        let name = self.name(sequence, source);
        write_png(picture, &self.folder.join(name))?;
        self.written += 1;
        Ok(())
    }

    fn name(&mut self, sequence: u64, source: &str) -> String {
        let number = format!("{sequence:06}.png");
        let Some(names) = &mut self.names else {
            return number;
        };
        let part = |p: Option<&std::ffi::OsStr>| p.map(|s| s.to_string_lossy().into_owned());
        let (stem, whole) = (
            part(Path::new(source).file_stem()),
            part(Path::new(source).file_name()),
        );
        // `a.jpg` and `a.webp` become `a.png` and `a.webp.png`; the same name from another folder gets a number.
        let wanted = [stem, whole].into_iter().flatten();
        let wanted = wanted.map(|name| format!("{name}.png"));
        wanted
            .chain([number])
            .find(|name| names.insert(name.clone()))
            .unwrap_or_else(|| format!("{sequence:06}-again.png"))
    }

    /// What there is.
    pub fn words(&self) -> String {
        let pictures = counted(self.written, "picture", "pictures");
        format!("{pictures} → {}", self.folder.display())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_are_called_like_their_photos_and_none_is_written_over() {
        let folder = tempfile::tempdir().unwrap();
        let mut all = Pictures::create(folder.path(), true).unwrap();
        let named = ["x/a.jpg", "x/b.c.png", "x/a.webp", "y/a.webp", ""];
        let names: Vec<String> = named
            .iter()
            .enumerate()
            .map(|(k, source)| all.name(k as u64, source))
            .collect();
        assert_eq!(
            names,
            ["a.png", "b.c.png", "a.webp.png", "000003.png", "000004.png"]
        );
        let mut film = Pictures::create(folder.path(), false).unwrap();
        assert_eq!(film.name(7, "film.mp4"), "000007.png");
    }
}
