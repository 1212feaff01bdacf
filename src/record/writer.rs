//! Writing records: a message goes in, a line or a binary frame goes out.

use std::io::{self, Write};
use std::marker::PhantomData;
use std::path::{Path, PathBuf};

use super::binary::{self, MAGIC};
use super::rows::Row;
use crate::output::AtomicFile;

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
    rows_written: u64,
    buffer: Vec<u8>,
    rows: PhantomData<T>,
}

impl<T: Row> RecordWriter<T> {
    /// Starts a record at `path`; `-` is standard output.
    ///
    /// # Errors
    /// As [`AtomicFile::create`].
    pub fn create(path: &Path, format: Format) -> io::Result<Self> {
        let mut file = AtomicFile::create(path)?;
        if format == Format::Binary {
            file.write_all(&head::<T>(format))?;
            file.mark_whole();
        }
        Ok(Self {
            file,
            path: path.to_owned(),
            format,
            grows: false,
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

    /// The same for an input without an end: whatever ends the process, the rows before are in the file.
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
        self.buffer.clear();
        encode(&T::new(message, source), self.format, &mut self.buffer)?;
        self.file.write_all(&self.buffer)?;
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

    /// Gives the file its name. After an error, too, the whole frames that reached the disk are there. Whether there is
    /// a file: of an input without an end that gave no frame there is none.
    ///
    /// # Errors
    /// As [`AtomicFile::finish`].
    pub fn finish(self) -> io::Result<bool> {
        if self.grows && self.rows_written == 0 {
            return Ok(false);
        }
        self.file.finish()?;
        Ok(true)
    }
}

/// How a record begins.
pub(super) fn head<T: Row>(format: Format) -> Vec<u8> {
    match format {
        Format::Jsonl => Vec::new(),
        Format::Binary => [MAGIC.as_slice(), &[T::KIND]].concat(),
    }
}

/// Appends a row.
pub(super) fn encode<T: Row>(row: &T, format: Format, out: &mut Vec<u8>) -> io::Result<()> {
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
            assert!(record.finish().unwrap());
            let before = std::fs::read(&path).unwrap();
            assert!(!create().growing().finish().unwrap());
            assert_eq!(std::fs::read(&path).unwrap(), before, "nothing came");
        }
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2);
    }
}
