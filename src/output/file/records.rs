//! Records within a file: which of them are whole, and back to the last of these after a failure.

use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::os::unix::fs::MetadataExt;

use super::place::written_to;
use super::{AtomicFile, Place};
use crate::output::is_in_place;

/// More records than a buffer holds need not be known: they are on the disk.
const RECORDS_KEPT: usize = 1024;

impl AtomicFile {
    /// Whether [`finish`](Self::finish) would leave anything where writing has failed.
    pub fn keeps_anything(&self) -> bool {
        let Some(writer) = &self.writer else {
            return false;
        };
        let on_disk = self.on_disk(writer);
        let is_whole = |end: &u64| (1..=on_disk).contains(end);
        matches!(writer.get_ref(), Place::Device(_) | Place::Named(_))
            || self.whole.iter().any(is_whole)
    }

    /// After a failure: goes back to the last whole record, so that writing can be tried again. Whether there is
    /// anything to go on with: not where no record has found room before the file [appeared](Self::appear), nor where
    /// somebody has removed it to make room.
    ///
    /// # Errors
    /// Those of the file.
    pub fn go_back(&mut self) -> io::Result<bool> {
        let Some(writer) = self.writer.take() else {
            return Ok(false);
        };
        self.failed = None;
        // The parts, so that nothing is written behind our back.
        let (place, _) = writer.into_parts();
        let writer = self.writer.insert(BufWriter::new(place));
        let (file, path) = match writer.get_mut() {
            // What went into it is gone.
            Place::Device(_) => return Ok(true),
            Place::Named(file) => (file, None),
            Place::Beside(file) => {
                let path = file.path().to_owned();
                (file.as_file_mut(), Some(path))
            }
        };
        let end = written_to(file)?;
        let whole = self.whole.iter().rev().find(|w| **w <= end).copied();
        let whole = whole.unwrap_or_default();
        file.set_len(whole)?;
        file.seek(SeekFrom::Start(whole))?;
        self.taken = whole;
        self.whole.retain(|w| *w <= whole);
        match path {
            None => Ok(file.metadata()?.nlink() > 0),
            // Its name it can only get from the one that it has.
            Some(path) => Ok(whole > 0 && is_in_place(file, &path, whole, true)?),
        }
    }

    /// Says that all bytes so far make whole records: if writing fails later, these are kept. Who reads a pipe, or a
    /// file that has appeared, has them now.
    pub fn mark_whole(&mut self) {
        if self.whole.len() == RECORDS_KEPT {
            self.whole.pop_front();
        }
        self.whole.push_back(self.taken);
        if let Some(writer) = &mut self.writer
            && matches!(writer.get_ref(), Place::Named(_) | Place::Device(_))
        {
            // A failure shows at the next write, or at the end.
            let _ = writer.flush();
        }
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn what_lies_in_memory_is_not_kept() {
        let folder = tempfile::tempdir().unwrap();
        let mut file = AtomicFile::create(&folder.path().join("file")).unwrap();
        file.write_all(b"a record").unwrap();
        file.mark_whole();
        assert!(!file.keeps_anything());
        file.flush().unwrap();
        assert!(file.keeps_anything());
    }

    #[test]
    fn after_a_failure_what_follows_stands_behind_the_last_whole_record() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("hall.jsonl");
        let mut file = AtomicFile::create(&path).unwrap();
        let record = |file: &mut AtomicFile, text: &str| {
            file.write_all(text.as_bytes()).unwrap();
            file.mark_whole();
        };
        record(&mut file, "one\n");
        assert!(!file.go_back().unwrap(), "nothing is on the disk");
        record(&mut file, "one\n");
        file.appear().unwrap();
        record(&mut file, "two\n");
        // A part of a record, of which some has reached the disk.
        file.write_all(b"thr").unwrap();
        file.flush().unwrap();
        file.write_all(b"ee").unwrap();
        assert!(file.go_back().unwrap());
        record(&mut file, "four\n");
        assert_eq!(fs::read_to_string(&path).unwrap(), "one\ntwo\nfour\n");
        fs::remove_file(&path).unwrap();
        assert!(!file.go_back().unwrap(), "nobody would find it");
    }
}
