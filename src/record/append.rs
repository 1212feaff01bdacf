//! A record that grows under its own name: whatever ends the process, every frame written before is in it.

use std::fs::{File, OpenOptions};
use std::io::{self, Seek, SeekFrom, Write};
use std::marker::PhantomData;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use super::rows::Row;
use super::writer::{Format, encode, head};

/// How often frames are brought onto the disk itself: a power cut takes no more.
const SYNC_EVERY: Duration = Duration::from_secs(5);

/// Writes rows that are in the file at once.
#[derive(Debug)]
pub struct GrowingRecord<T> {
    file: File,
    path: PathBuf,
    format: Format,
    buffer: Vec<u8>,
    whole: u64,
    synced: Instant,
    rows: PhantomData<T>,
}

impl<T: Row> GrowingRecord<T> {
    /// Starts a record at `path`, where there must be no file.
    ///
    /// # Errors
    /// Of kind `AlreadyExists` where there is one; the system's.
    pub fn create(path: &Path, format: Format) -> io::Result<Self> {
        let mut file = OpenOptions::new().write(true).create_new(true).open(path)?;
        let head = head::<T>(format);
        file.write_all(&head)?;
        Ok(Self {
            file,
            path: path.to_owned(),
            format,
            buffer: Vec::new(),
            whole: head.len() as u64,
            synced: Instant::now(),
            rows: PhantomData,
        })
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Bytes of whole frames.
    pub fn bytes(&self) -> u64 {
        self.whole
    }

    /// Adds a frame. After an error the frames before are whole.
    ///
    /// # Errors
    /// Those of the file.
    pub fn write(&mut self, message: &T::Message, source: &str) -> io::Result<()> {
        self.buffer.clear();
        encode(&T::new(message, source), self.format, &mut self.buffer)?;
        if let Err(e) = self.file.write_all(&self.buffer) {
            // A disk that is full took a part of it. What is written next must follow the last whole frame.
            let _ = self.file.set_len(self.whole);
            let _ = self.file.seek(SeekFrom::Start(self.whole));
            return Err(e);
        }
        self.whole += self.buffer.len() as u64;
        if self.synced.elapsed() >= SYNC_EVERY {
            self.synced = Instant::now();
            self.file.sync_data()?;
        }
        Ok(())
    }

    /// Brings the rest onto the disk.
    ///
    /// # Errors
    /// Those of the disk.
    pub fn finish(self) -> io::Result<()> {
        self.file.sync_all()
    }
}

#[cfg(test)]
mod tests {
    use rustix::fs::{MemfdFlags, SealFlags, fcntl_add_seals, memfd_create};

    use super::*;
    use crate::message::{BodyFrame, MAX_PEOPLE};
    use crate::record::BodiesRow;

    /// A file that may not grow stands in for a full disk: of a frame that does not fit it takes a part.
    #[test]
    fn after_a_failure_the_next_frame_follows_the_last_whole_one() {
        let file = File::from(memfd_create("record", MemfdFlags::ALLOW_SEALING).unwrap());
        let mut record = GrowingRecord::<BodiesRow> {
            file,
            path: PathBuf::new(),
            format: Format::Jsonl,
            buffer: Vec::new(),
            whole: 0,
            synced: Instant::now(),
            rows: PhantomData,
        };
        record.write(&BodyFrame::default(), "").unwrap();
        let whole = record.bytes();
        record.file.set_len(2 * 4096).unwrap();
        fcntl_add_seals(&record.file, SealFlags::GROW).unwrap();
        let crowd = BodyFrame {
            count: MAX_PEOPLE as u32,
            ..BodyFrame::default()
        };
        assert!(record.write(&crowd, "").is_err());
        assert_eq!(record.bytes(), whole);
        assert_eq!(record.file.metadata().unwrap().len(), whole);
        assert_eq!(record.file.stream_position().unwrap(), whole);
    }
}
