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

/// Writes rows; the file takes its name on [`finish`](Self::finish).
#[derive(Debug)]
pub struct RecordWriter<T> {
    file: AtomicFile,
    path: PathBuf,
    format: Format,
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
            buffer: Vec::new(),
            rows: PhantomData,
        })
    }

    /// Says that frames were to follow and never came, as [`AtomicFile::break_off`].
    pub fn break_off(&mut self) {
        self.file.break_off();
    }

    /// As [`AtomicFile::keeps_anything`].
    pub fn keeps_anything(&self) -> bool {
        self.file.keeps_anything()
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
        Ok(())
    }

    /// Gives the file its name. After an error, too, the whole frames that reached the disk are there.
    ///
    /// # Errors
    /// As [`AtomicFile::finish`].
    pub fn finish(self) -> io::Result<()> {
        self.file.finish()
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
