//! Writing records: a message goes in, a line or a binary frame goes out.

use std::io::{self, Write};
use std::marker::PhantomData;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use super::binary::{self, MAGIC};
use super::rows::Row;
use crate::output::AtomicFile;

/// How often it is looked whether a record that grows is still the file of its name.
const LOOK_EVERY: Duration = Duration::from_secs(60);

/// How a record is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// JSON lines.
    Jsonl,
    /// Binary.
    Binary,
}

/// Writes rows; the file takes its name on [`finish`](Self::finish), that of an input without an end with its first
/// row.
#[derive(Debug)]
pub struct RecordWriter<T> {
    file: AtomicFile,
    path: PathBuf,
    format: Format,
    /// Whether the file has its name while it is written.
    grows: bool,
    /// When that name was looked at.
    looked: Instant,
    rows_written: u64,
    buffer: Vec<u8>,
    /// Rows are written, never held: whatever they are, another thread may do it.
    rows: PhantomData<fn(T)>,
}

impl<T: Row> RecordWriter<T> {
    /// Starts a record at `path`; `-` is standard output.
    ///
    /// # Errors
    /// As [`AtomicFile::create`].
    pub fn create(path: &Path, format: Format) -> io::Result<Self> {
        Ok(Self {
            file: begin::<T>(path, format)?,
            path: path.to_owned(),
            format,
            grows: false,
            looked: Instant::now(),
            rows_written: 0,
            buffer: Vec::new(),
            rows: PhantomData,
        })
    }

    /// Says that frames were to follow and never came, as [`AtomicFile::break_off`].
    pub fn break_off(&mut self) {
        self.file.break_off();
    }

    /// After a failure, as [`AtomicFile::go_back`].
    ///
    /// # Errors
    /// As there.
    pub fn go_back(&mut self) -> io::Result<bool> {
        self.file.go_back()
    }

    /// Brings the rows so far out of this process, so that a failure shows now.
    ///
    /// # Errors
    /// Those of the file.
    pub fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }

    /// As [`AtomicFile::keeps_anything`].
    pub fn keeps_anything(&self) -> bool {
        self.file.keeps_anything()
    }

    /// The same for an input without an end: whatever ends the process, the rows before are in the file. Where somebody
    /// removes, moves or cuts that, another begins under the name, within a minute at most.
    #[must_use]
    pub fn growing(self) -> Self {
        Self {
            grows: true,
            ..self
        }
    }

    /// Where it goes.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Adds a frame.
    ///
    /// # Errors
    /// Those of the file; the frames before are kept by [`finish`](Self::finish).
    pub fn write(&mut self, message: &T::Message, source: &str) -> io::Result<()> {
        self.write_at(Instant::now(), message, source)
    }

    fn write_at(&mut self, now: Instant, message: &T::Message, source: &str) -> io::Result<()> {
        let mut row = std::mem::take(&mut self.buffer);
        row.clear();
        let written = encode(&T::new(message, source), self.format, &mut row)
            .and_then(|()| self.put_at(now, &row));
        self.buffer = row;
        written
    }

    /// Adds a frame whose row [`encode`] has made.
    ///
    /// # Errors
    /// As [`write`](Self::write).
    pub(crate) fn put(&mut self, row: &[u8]) -> io::Result<()> {
        self.put_at(Instant::now(), row)
    }

    fn put_at(&mut self, now: Instant, row: &[u8]) -> io::Result<()> {
        if self.grows && !self.is_intact(now)? {
            tracing::warn!(
                "{}: somebody removed, moved or cut the record; it begins anew",
                self.path.display()
            );
            self.file = begin::<T>(&self.path, self.format)?;
        }
        self.file.write_all(row)?;
        self.file.mark_whole();
        self.rows_written += 1;
        if self.grows
            && let Some(older) = self.file.appear()?
        {
            tracing::warn!(
                "{}: the record that was there is {} now",
                self.path.display(),
                older.display()
            );
        }
        Ok(())
    }

    /// Looks whether the file holds what was written, by its name now and then.
    fn is_intact(&mut self, now: Instant) -> io::Result<bool> {
        let by_name = now.saturating_duration_since(self.looked) >= LOOK_EVERY;
        if by_name {
            self.looked = now;
        }
        self.file.is_intact(by_name)
    }

    /// Gives the file its name. After an error, too, the whole frames that reached the disk are there. Where the record
    /// is: nowhere for an input without an end that gave no frame, or whose record somebody took away; beside its name
    /// as [`AtomicFile::finish_beside`] says.
    ///
    /// # Errors
    /// As [`AtomicFile::finish`].
    pub fn finish(self) -> io::Result<Option<PathBuf>> {
        if self.grows && self.rows_written == 0 {
            return Ok(None);
        }
        let is_there = !self.grows || self.file.is_intact(true)?;
        let beside = self.file.finish_beside()?;
        if !is_there {
            tracing::warn!(
                "{}: somebody removed, moved or cut the record",
                self.path.display()
            );
            return Ok(None);
        }
        Ok(Some(beside.unwrap_or(self.path)))
    }
}

/// Starts a file with what stands before the first row.
fn begin<T: Row>(path: &Path, format: Format) -> io::Result<AtomicFile> {
    let mut file = AtomicFile::create(path)?;
    if format == Format::Binary {
        file.write_all(&head::<T>(format))?;
        file.mark_whole();
    }
    Ok(file)
}

/// How a record begins.
pub(super) fn head<T: Row>(format: Format) -> Vec<u8> {
    match format {
        Format::Jsonl => Vec::new(),
        Format::Binary => [MAGIC.as_slice(), &[T::KIND]].concat(),
    }
}

/// Appends a row.
///
/// # Errors
/// If it cannot be written in this format.
pub fn encode<T: Row>(row: &T, format: Format, out: &mut Vec<u8>) -> io::Result<()> {
    match format {
        Format::Jsonl => {
            serde_json::to_writer(&mut *out, row)?;
            out.push(b'\n');
        }
        Format::Binary => {
            let bytes = postcard::to_stdvec(row).map_err(io::Error::other)?;
            binary::put(&bytes, out);
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::io::BufReader;

    use super::*;
    use crate::message::BodyFrame;
    use crate::record::{BodiesRow, RowReader};

    #[test]
    fn a_growing_record_holds_every_frame_before_it_is_finished() {
        let folder = tempfile::tempdir().unwrap();
        for (name, format) in [("a.jsonl", Format::Jsonl), ("a.ecr", Format::Binary)] {
            let path = folder.path().join(name);
            let create = || RecordWriter::<BodiesRow>::create(&path, format).unwrap();
            let mut record = create().growing();
            assert!(!path.exists(), "of nobody's frames there is no record");
            for n in 1..4 {
                record.write(&BodyFrame::default(), "").unwrap();
                // As whoever looks after the process was killed.
                let file = std::fs::File::open(&path).unwrap();
                let mut rows = RowReader::<_, BodiesRow>::new(BufReader::new(file), name);
                let mut found = 0;
                while rows.read().unwrap().is_some() {
                    found += 1;
                }
                assert_eq!((found, rows.was_cut()), (n, false));
            }
            assert_eq!(record.finish().unwrap().as_ref(), Some(&path));
            let before = std::fs::read(&path).unwrap();
            assert_eq!(create().growing().finish().unwrap(), None);
            assert_eq!(std::fs::read(&path).unwrap(), before, "nothing came");
        }
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2);
    }

    /// As an administrator does, or logrotate, by either of its ways.
    #[test]
    fn a_record_that_was_removed_moved_or_emptied_begins_anew() {
        let folder = tempfile::tempdir().unwrap();
        for (name, format) in [("a.jsonl", Format::Jsonl), ("a.ecr", Format::Binary)] {
            let path = folder.path().join(name);
            let rows = |path: &Path| {
                let file = std::fs::File::open(path).unwrap();
                let mut rows = RowReader::<_, BodiesRow>::new(BufReader::new(file), name);
                let mut found = 0;
                while rows.read().unwrap().is_some() {
                    found += 1;
                }
                found
            };
            let start = Instant::now();
            let mut record = RecordWriter::<BodiesRow>::create(&path, format)
                .unwrap()
                .growing();
            let mut at = |seconds: u64| {
                let now = start + Duration::from_secs(seconds);
                record.write_at(now, &BodyFrame::default(), "").unwrap();
            };
            at(0);
            std::fs::remove_file(&path).unwrap();
            at(1);
            assert_eq!(rows(&path), 1, "{name}");
            let moved = folder.path().join(format!("{name}.1"));
            std::fs::rename(&path, &moved).unwrap();
            at(2);
            assert!(!path.exists(), "{name}: not looked at every time");
            at(70);
            assert_eq!((rows(&moved), rows(&path)), (2, 1), "{name}");
            std::fs::File::create(&path).unwrap();
            for n in 1..3 {
                at(70 + n);
                assert_eq!(rows(&path), n, "{name}");
            }
            std::fs::remove_file(&path).unwrap();
            assert_eq!(record.finish().unwrap(), None, "{name}: it is not there");
        }
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2);
    }
}
