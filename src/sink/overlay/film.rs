//! A film of pictures: Motion-JPEG in AVI, which any player opens.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use super::real_time::{RealTime, Taken};
use crate::capture::{AviWriter, Frame, Rate};
use crate::counted::counted;
use crate::output::{AtomicFile, is_full, suffixed};
use crate::sink::SinkError;

/// Fine enough that lines of skeletons stay sharp.
const QUALITY: u8 = 85;
/// How many pictures a second an input without a rate gets.
const USUAL_RATE: f64 = 30.0;
/// Rates are kept as so many parts of a frame a second.
const PARTS: u32 = 1000;

/// Writes a film; where one file is full, or a camera has come back with pictures of another size, it goes on in
/// `name-2.avi`, `name-3.avi` and so on.
#[derive(Debug)]
pub struct Film {
    path: PathBuf,
    rate: Rate,
    time: RealTime,
    part: Part,
    /// Of the file that is being written.
    number: u32,
    /// The files after the first.
    more: Vec<PathBuf>,
    written: u64,
    /// Size of the first picture of this file: it has one.
    size: Option<(u32, u32)>,
}

/// The file that is being written.
#[derive(Debug)]
enum Part {
    /// It waits for its first picture, which tells the size.
    Waiting(AtomicFile),
    Open(AviWriter<AtomicFile>),
    /// It failed, or is being replaced by the next.
    None,
}

impl Film {
    /// Starts a film with the rate that is known when its first picture comes.
    ///
    /// # Errors
    /// [`SinkError::Create`].
    pub fn create(path: &Path, rate: Rate) -> Result<Self, SinkError> {
        let file = AtomicFile::create(path).map_err(|cause| SinkError::Create {
            path: path.to_owned(),
            cause,
        })?;
        Ok(Self {
            path: path.to_owned(),
            rate,
            time: RealTime::default(),
            part: Part::Waiting(file),
            number: 1,
            more: Vec::new(),
            written: 0,
            size: None,
        })
    }

    /// Appends a picture, after repeating the one before until the film is as long as the time since its first; leaves
    /// it out where the film is longer.
    ///
    /// # Errors
    /// [`SinkError::Write`]; `InvalidInput` where a file's picture has not the size of the first.
    pub fn write(&mut self, picture: &Frame, taken: Taken) -> Result<(), SinkError> {
        let Some(missing) = self.time.missing(taken, self.rate(), self.written) else {
            return Ok(());
        };
        self.catch_up(missing).map_err(|e| self.failed(e))?;
        let size = (picture.width, picture.height);
        if matches!(taken, Taken::Live(_)) && self.size.is_some_and(|known| known != size) {
            self.next_part().map_err(|e| self.failed(e))?;
            self.size = None;
        }
        let written = match self.append(picture) {
            Err(e) if is_full(&e) => self.next_part().and_then(|()| self.append(picture)),
            other => other,
        };
        written.map_err(|e| self.failed(e))?;
        self.written += 1;
        Ok(())
    }

    fn catch_up(&mut self, missing: u64) -> io::Result<()> {
        for _ in 0..missing {
            let Part::Open(film) = &mut self.part else {
                break;
            };
            match film.repeat() {
                Ok(()) => self.written += 1,
                // The next file begins with the picture.
                Err(e) if is_full(&e) => break,
                Err(e) => return Err(e),
            }
        }
        Ok(())
    }

    fn rate(&self) -> f64 {
        self.rate.get().unwrap_or(USUAL_RATE)
    }

    fn append(&mut self, picture: &Frame) -> io::Result<()> {
        let size = (picture.width, picture.height);
        let (width, height) = *self.size.get_or_insert(size);
        if size != (width, height) {
            return Err(io::Error::new(
                io::ErrorKind::InvalidInput,
                format!(
                    "a film has one size, expected {width}x{height}, found {}x{}; give a folder for photos",
                    size.0, size.1
                ),
            ));
        }
        if let Part::Waiting(_) = self.part
            && let Part::Waiting(file) = std::mem::replace(&mut self.part, Part::None)
        {
            let rate = (self.rate() * f64::from(PARTS)).round().max(1.0) as u32;
            self.part = Part::Open(AviWriter::new(file, width, height, (rate, PARTS))?);
        }
        let Part::Open(film) = &mut self.part else {
            return Err(io::ErrorKind::NotConnected.into());
        };
        film.write_frame(picture, QUALITY)?;
        film.get_mut().mark_whole();
        Ok(())
    }

    /// Goes on in the next file that is not there: nobody has named it to be replaced.
    fn next_part(&mut self) -> io::Result<()> {
        self.end_part(false)?;
        self.number += 1;
        while fs::symlink_metadata(self.part_path()).is_ok() {
            self.number += 1;
        }
        let path = self.part_path();
        self.part = Part::Waiting(AtomicFile::create(&path)?);
        self.more.push(path);
        Ok(())
    }

    fn part_path(&self) -> PathBuf {
        if self.number == 1 {
            return self.path.clone();
        }
        suffixed(&self.path, &format!("-{}", self.number))
    }

    /// Completes the file that is being written; the name that it got in place of its own, if it did.
    fn end_part(&mut self, is_last: bool) -> io::Result<Option<PathBuf>> {
        match std::mem::replace(&mut self.part, Part::None) {
            Part::Open(film) => {
                let file = film.finish()?;
                // Pictures go on, and do not wait for the disk.
                let file = if is_last { file } else { file.passing() };
                file.finish_beside()
            }
            // Without a picture there is no film.
            Part::Waiting(_) | Part::None => Ok(None),
        }
    }

    /// Says that pictures were to follow and never came.
    pub fn break_off(&mut self) {
        if let Part::Open(film) = &mut self.part {
            film.get_mut().break_off();
        }
    }

    fn failed(&self, cause: io::Error) -> SinkError {
        let path = self.part_path();
        match cause.kind() {
            io::ErrorKind::InvalidInput => SinkError::Write { path, cause },
            // Without its index a film is none.
            _ => SinkError::Lost { path, cause },
        }
    }

    /// Completes the film; what there is.
    ///
    /// # Errors
    /// [`SinkError::Write`].
    pub fn finish(mut self) -> Result<Option<String>, SinkError> {
        let beside = self.end_part(true).map_err(|e| self.failed(e))?;
        let mut files = vec![self.path];
        files.append(&mut self.more);
        if let Some(beside) = beside {
            files.pop();
            files.push(beside);
        }
        let names: Vec<String> = files.iter().map(|f| f.display().to_string()).collect();
        let pictures = counted(self.written, "picture", "pictures");
        Ok((self.written > 0).then(|| format!("a film of {pictures} → {}", names.join(", "))))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::{AviReader, Source};

    fn picture(width: u32, height: u32) -> Frame {
        Frame {
            width,
            height,
            rgb: vec![90; 3 * (width * height) as usize],
            ..Frame::default()
        }
    }

    #[test]
    fn a_film_plays_with_its_rate_and_has_one_size() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("film.avi");
        let rate = Rate::default();
        let mut film = Film::create(&path, rate.clone()).unwrap();
        // As a pipe does, whose header comes later.
        rate.tell(Some(29.97));
        for _ in 0..5 {
            film.write(&picture(64, 48), Taken::File(0)).unwrap();
        }
        let other = film
            .write(&picture(48, 64), Taken::File(0))
            .unwrap_err()
            .to_string();
        assert!(
            other.contains("64x48") && other.contains("48x64"),
            "{other}"
        );
        assert!(!path.exists(), "a film appears whole");
        assert!(film.finish().unwrap().unwrap().contains("5 pictures"));
        let mut reader = AviReader::new(std::fs::File::open(&path).unwrap(), "film").unwrap();
        assert!((reader.fps().unwrap() - 29.97).abs() < 1e-9);
        let (mut frame, mut count) = (Frame::default(), 0);
        while reader.next_into(&mut frame).unwrap() {
            count += 1;
        }
        assert_eq!((count, frame.width, frame.height), (5, 64, 48));
    }

    #[test]
    fn a_film_of_a_running_camera_lasts_as_long_as_what_it_shows() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("film.avi");
        let rate = Rate::from(Some(30.0)).at_most(Some(20.0));
        let mut film = Film::create(&path, rate).unwrap();
        // Two seconds, of which 10 pictures a second were looked at.
        for k in 0..=20 {
            film.write(
                &picture(64, 48),
                Taken::Live(7_000_000_000 + k * 100_000_000),
            )
            .unwrap();
        }
        assert!(film.finish().unwrap().unwrap().contains("41 pictures"));
        let mut reader = AviReader::new(fs::File::open(&path).unwrap(), "film").unwrap();
        assert_eq!(reader.fps(), Some(20.0));
        let mut frame = Frame::default();
        let shown = std::iter::from_fn(|| reader.next_into(&mut frame).unwrap().then_some(()));
        assert_eq!(shown.count(), 41);
    }

    /// As one that was unplugged and comes back in another mode.
    #[test]
    fn a_camera_of_another_size_goes_on_in_another_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("film.avi");
        let mut film = Film::create(&path, Rate::default()).unwrap();
        for (k, size) in [(64, 48), (64, 48), (48, 64), (48, 64)]
            .into_iter()
            .enumerate()
        {
            let taken = Taken::Live(7_000_000_000 + k as u64 * 33_333_333);
            film.write(&picture(size.0, size.1), taken).unwrap();
        }
        film.finish().unwrap();
        for (name, size) in [("film.avi", (64, 48)), ("film-2.avi", (48, 64))] {
            let file = fs::File::open(folder.path().join(name)).unwrap();
            let mut reader = AviReader::new(file, name).unwrap();
            let mut frame = Frame::default();
            assert!(reader.next_into(&mut frame).unwrap());
            assert_eq!((frame.width, frame.height), size);
            assert_eq!(reader.frame_count(), Some(2));
        }
    }

    #[test]
    fn a_full_file_is_followed_by_another_and_an_empty_one_is_none() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("film.avi");
        let mut film = Film::create(&path, Rate::default()).unwrap();
        film.write(&picture(64, 48), Taken::File(0)).unwrap();
        film.next_part().unwrap();
        film.write(&picture(64, 48), Taken::File(0)).unwrap();
        let another = folder.path().join("film-3.avi");
        fs::write(&another, "another film").unwrap();
        film.next_part().unwrap();
        film.write(&picture(64, 48), Taken::File(0)).unwrap();
        let said = film.finish().unwrap().unwrap();
        for name in ["film.avi", "film-2.avi", "film-4.avi"] {
            let path = folder.path().join(name);
            assert!(path.exists(), "{name}");
            assert!(said.contains(&path.display().to_string()), "{said}");
        }
        assert!(!said.contains("film-3.avi"), "{said}");
        assert_eq!(fs::read(&another).unwrap(), b"another film");
        let mut cut = Film::create(&path, Rate::default()).unwrap();
        fs::write(&path, vec![0; 100_000]).unwrap();
        cut.write(&picture(64, 48), Taken::File(0)).unwrap();
        cut.break_off();
        let said = cut.finish().unwrap().unwrap();
        assert!(said.ends_with("film-cut.avi"), "{said}");
        let none = folder.path().join("none.avi");
        assert_eq!(
            Film::create(&none, Rate::default())
                .unwrap()
                .finish()
                .unwrap(),
            None
        );
        assert!(!none.exists());
    }
}
