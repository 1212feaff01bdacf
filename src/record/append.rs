//! A record that grows under its own name: whatever ends the process, every frame written before is in it.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Seek, SeekFrom, Write};
use std::marker::PhantomData;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use super::rows::Row;
use super::syncer::Syncer;
use super::writer::{Format, encode, head};
use crate::output::{MadeFolders, is_in_place, parent, set_aside};

/// How often frames are brought onto the disk itself, a power cut takes no more; and how often it is looked whether the
/// record is still the file of its name.
const SYNC_EVERY: Duration = Duration::from_secs(5);

/// Writes rows that are in the file at once. Where somebody removes, moves or cuts that, another begins under the name.
#[derive(Debug)]
pub struct GrowingRecord<T> {
    file: File,
    path: PathBuf,
    /// Made for this record alone.
    made: MadeFolders,
    format: Format,
    buffer: Vec<u8>,
    whole: u64,
    frames: u64,
    synced: Instant,
    syncer: Syncer,
    rows: PhantomData<T>,
}

impl<T: Row> GrowingRecord<T> {
    /// Starts a record at `path`, where there must be no file; missing folders are made.
    ///
    /// # Errors
    /// Of kind `AlreadyExists` where there is one; the system's.
    pub fn create(path: &Path, format: Format) -> io::Result<Self> {
        let made = MadeFolders::make(parent(path))?;
        let file = OpenOptions::new().write(true).create_new(true).open(path)?;
        let mut record = Self {
            file,
            path: path.to_owned(),
            made,
            format,
            buffer: Vec::new(),
            whole: 0,
            frames: 0,
            synced: Instant::now(),
            syncer: Syncer::default(),
            rows: PhantomData,
        };
        let head = head::<T>(format);
        if let Err(e) = record.file.write_all(&head) {
            record.give_up();
            return Err(e);
        }
        record.whole = head.len() as u64;
        Ok(record)
    }

    /// Leaves nothing of a record of nothing; one that holds frames stays.
    pub fn give_up(self) {
        if self.frames > 0 || !is_in_place(&self.file, &self.path, 0, true).unwrap_or(false) {
            return;
        }
        let _ = fs::remove_file(&self.path);
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Whole frames in the file.
    pub fn frames(&self) -> u64 {
        self.frames
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
        self.write_at(Instant::now(), message, source)
    }

    /// Adds the `end` of a publisher, which is no frame: another one's follow, whose ids may begin anew. Where no frame
    /// is before it, as in a record that somebody has just moved, nothing is added.
    ///
    /// # Errors
    /// Those of the file.
    pub fn write_end(&mut self, end: &T::Message, source: &str) -> io::Result<()> {
        self.make_ready(Instant::now())?;
        match self.frames {
            0 => Ok(()),
            _ => self.put(end, source),
        }
    }

    /// Has the disk take what was written, in a thread: no frame may follow for a while.
    ///
    /// # Errors
    /// Those of the file, of an earlier time.
    pub fn sync(&mut self) -> io::Result<()> {
        self.synced = Instant::now();
        self.syncer.begin(&self.file)
    }

    fn write_at(&mut self, now: Instant, message: &T::Message, source: &str) -> io::Result<()> {
        self.make_ready(now)?;
        self.append(message, source)
    }

    fn make_ready(&mut self, now: Instant) -> io::Result<()> {
        let by_name = now.saturating_duration_since(self.synced) >= SYNC_EVERY;
        if by_name {
            self.synced = now;
            self.syncer.begin(&self.file)?;
        }
        match self.is_intact(by_name)? {
            true => Ok(()),
            false => self.begin_anew(),
        }
    }

    fn append(&mut self, message: &T::Message, source: &str) -> io::Result<()> {
        self.put(message, source)?;
        self.frames += 1;
        Ok(())
    }

    fn put(&mut self, message: &T::Message, source: &str) -> io::Result<()> {
        self.buffer.clear();
        encode(&T::new(message, source), self.format, &mut self.buffer)?;
        if let Err(e) = self.file.write_all(&self.buffer) {
            // A disk that is full took a part of it. What is written next must follow the last whole frame.
            let _ = self.file.set_len(self.whole);
            let _ = self.file.seek(SeekFrom::Start(self.whole));
            return Err(e);
        }
        self.whole += self.buffer.len() as u64;
        self.made.keep();
        Ok(())
    }

    fn is_intact(&self, by_name: bool) -> io::Result<bool> {
        is_in_place(&self.file, &self.path, self.whole, by_name)
    }

    fn begin_anew(&mut self) -> io::Result<()> {
        tracing::warn!(
            "{}: somebody removed, moved or cut the record; it begins anew",
            self.path.display()
        );
        if let Some(older) = set_aside(&self.path)? {
            tracing::warn!(
                "{}: the record that was there is {} now",
                self.path.display(),
                older.display()
            );
        }
        // One that somebody emptied holds nothing to be set aside.
        if fs::symlink_metadata(&self.path).is_ok_and(|m| m.is_file() && m.len() == 0) {
            fs::remove_file(&self.path)?;
        }
        *self = Self::create(&self.path, self.format)?;
        Ok(())
    }

    /// Brings the rest onto the disk. Whether the record is there.
    ///
    /// # Errors
    /// Those of the disk.
    pub fn finish(self) -> io::Result<bool> {
        self.file.sync_all()?;
        self.is_intact(true)
    }
}

#[cfg(test)]
mod tests {
    use rustix::fs::{MemfdFlags, SealFlags, fcntl_add_seals, memfd_create};

    use super::*;
    use crate::message::{BodyFrame, FLAG_END_OF_STREAM, MAX_PEOPLE};
    use crate::record::{BodiesRow, RowReader};

    #[test]
    fn a_record_that_was_removed_moved_or_cut_begins_anew() {
        let folder = tempfile::tempdir().unwrap();
        for (name, format) in [("a.jsonl", Format::Jsonl), ("a.ecr", Format::Binary)] {
            let path = folder.path().join(name);
            let rows = |path: &Path| {
                let file = File::open(path).unwrap();
                let mut rows = RowReader::<_, BodiesRow>::new(std::io::BufReader::new(file), name);
                let mut found = 0;
                while rows.read().unwrap().is_some() {
                    found += 1;
                }
                found
            };
            let (stem, ending) = name.split_once('.').unwrap();
            let aside = |n: u64| folder.path().join(format!("{stem}-{n}.{ending}"));
            let start = Instant::now();
            let mut record = GrowingRecord::<BodiesRow>::create(&path, format).unwrap();
            let mut at = |seconds: u64| {
                let now = start + Duration::from_secs(seconds);
                record.write_at(now, &BodyFrame::default(), "").unwrap();
                record.frames()
            };
            assert_eq!((at(0), at(1)), (1, 2));
            std::fs::remove_file(&path).unwrap();
            assert_eq!((at(2), rows(&path)), (1, 1), "{name}: seen at once");
            let moved = folder.path().join(format!("{name}.old"));
            std::fs::rename(&path, &moved).unwrap();
            at(3);
            assert!(!path.exists(), "{name}: not looked at every time");
            at(30);
            assert_eq!((rows(&moved), rows(&path)), (2, 1), "{name}");
            for n in 1..3 {
                OpenOptions::new()
                    .write(true)
                    .open(&path)
                    .unwrap()
                    .set_len(3 - n)
                    .unwrap();
                assert_eq!((at(30 + n), rows(&path)), (1, 1), "{name}");
                assert_eq!(std::fs::metadata(aside(n)).unwrap().len(), 3 - n, "{name}");
            }
            File::create(&path).unwrap();
            assert_eq!((at(40), rows(&path)), (1, 1), "{name}: emptied");
            std::fs::remove_file(&path).unwrap();
            assert!(!record.finish().unwrap(), "{name}: it is not there");
        }
    }

    /// The time of such an end is of before: nothing that follows is due by it.
    #[test]
    fn a_record_that_was_removed_while_the_camera_was_away_begins_with_a_frame() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.jsonl");
        let lines = || fs::read_to_string(&path).unwrap().lines().count();
        let frame = BodyFrame::default();
        let end = BodyFrame {
            flags: FLAG_END_OF_STREAM,
            ..frame
        };
        let mut record = GrowingRecord::<BodiesRow>::create(&path, Format::Jsonl).unwrap();
        record.write(&frame, "").unwrap();
        record.write_end(&end, "").unwrap();
        assert_eq!(lines(), 2);
        fs::remove_file(&path).unwrap();
        record.write_end(&end, "").unwrap();
        assert_eq!(lines(), 0);
        record.write(&frame, "").unwrap();
        assert_eq!(lines(), 1);
    }

    #[test]
    fn of_a_record_of_nothing_nothing_is_left() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("new/deeper/take.record");
        let begin = || GrowingRecord::<BodiesRow>::create(&path, Format::Binary).unwrap();
        begin().give_up();
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
        let mut record = begin();
        record.write(&BodyFrame::default(), "").unwrap();
        record.give_up();
        assert!(path.exists(), "it holds a frame");
        fs::remove_file(&path).unwrap();
        let record = begin();
        fs::remove_file(&path).unwrap();
        fs::write(&path, "another's").unwrap();
        record.give_up();
        assert!(path.exists(), "it is another's");
    }

    /// A file that may not grow stands in for a full disk: of a frame that does not fit it takes a part.
    #[test]
    fn after_a_failure_the_next_frame_follows_the_last_whole_one() {
        let file = File::from(memfd_create("record", MemfdFlags::ALLOW_SEALING).unwrap());
        let mut record = GrowingRecord::<BodiesRow> {
            file,
            path: PathBuf::new(),
            made: MadeFolders::default(),
            format: Format::Jsonl,
            buffer: Vec::new(),
            whole: 0,
            frames: 0,
            synced: Instant::now(),
            syncer: Syncer::default(),
            rows: PhantomData,
        };
        record.append(&BodyFrame::default(), "").unwrap();
        let whole = record.bytes();
        record.file.set_len(2 * 4096).unwrap();
        fcntl_add_seals(&record.file, SealFlags::GROW).unwrap();
        let crowd = BodyFrame {
            count: MAX_PEOPLE as u32,
            ..BodyFrame::default()
        };
        assert!(record.append(&crowd, "").is_err());
        assert_eq!(record.bytes(), whole);
        assert_eq!(record.file.metadata().unwrap().len(), whole);
        assert_eq!(record.file.stream_position().unwrap(), whole);
    }
}
