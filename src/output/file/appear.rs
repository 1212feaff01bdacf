//! A file that has its name before its end, because it grows without one: when it gets the name, and whether it still
//! has it.

use std::io::{self, BufWriter, Write};
use std::path::PathBuf;

use rustix::fs::{OFlags, fcntl_getfl, fcntl_setfl};

use super::{AtomicFile, Place};
use crate::output::aside::{move_to_free, set_aside};
use crate::output::is_in_place;

impl AtomicFile {
    /// Gives the file its name now and goes on writing to it, for what has no end: whatever ends the process, what was
    /// written is there. An older file of that name that holds anything is set aside, and its new name returned.
    ///
    /// # Errors
    /// If the disk is full, or a rename fails; then it goes on without its name, and the older file keeps its own.
    pub fn appear(&mut self) -> io::Result<Option<PathBuf>> {
        match &mut self.writer {
            Some(writer) if matches!(writer.get_ref(), Place::Beside(_)) => writer.flush()?,
            _ => return Ok(None),
        }
        let older = set_aside(&self.path)?;
        let Some((Place::Beside(file), _)) = self.writer.take().map(BufWriter::into_parts) else {
            return Ok(older);
        };
        let named = match file.persist(&self.path) {
            Ok(named) => named,
            Err(refused) => {
                self.writer = Some(BufWriter::new(Place::Beside(refused.file)));
                if let Some(older) = &older {
                    // Where that is refused, too, it lies under the other name.
                    let _ = move_to_free(older, &self.path);
                }
                return Err(refused.error);
            }
        };
        // Where somebody empties it, what follows begins at its start, and not behind as many zeros as it was long.
        fcntl_setfl(&named, fcntl_getfl(&named)? | OFlags::APPEND)?;
        self.writer = Some(BufWriter::new(Place::Named(named)));
        self.made.keep();
        Ok(older)
    }

    /// Whether a file that has [appeared](Self::appear) holds what was written: nobody has removed or cut it, nor,
    /// which is looked at only `by_name`, moved it or put another in its place. Any other file does.
    ///
    /// # Errors
    /// Those of the file.
    pub fn is_intact(&self, by_name: bool) -> io::Result<bool> {
        let Some(writer) = &self.writer else {
            return Ok(true);
        };
        let Place::Named(file) = writer.get_ref() else {
            return Ok(true);
        };
        is_in_place(file, &self.path, self.on_disk(writer), by_name)
    }
}

#[cfg(test)]
mod tests {
    use std::fs::{self, File};

    use super::*;
    use crate::output::is_unfinished;

    #[test]
    fn an_older_file_keeps_its_name_where_the_next_cannot_have_it() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("hall.jsonl");
        fs::write(&path, "older").unwrap();
        let mut file = AtomicFile::create(&path).unwrap();
        file.write_all(b"one\n").unwrap();
        let entries = fs::read_dir(folder.path()).unwrap();
        let mut beside = entries.map(|e| e.unwrap().path());
        fs::remove_file(beside.find(|p| is_unfinished(p)).unwrap()).unwrap();
        assert!(file.appear().is_err());
        assert_eq!(fs::read_to_string(&path).unwrap(), "older");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_file_that_appears_early_holds_what_was_written_when_the_process_is_gone() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("hall.jsonl");
        fs::write(&path, "older").unwrap();
        let mut file = AtomicFile::create(&path).unwrap();
        file.write_all(b"one\n").unwrap();
        file.mark_whole();
        assert_eq!(fs::read_to_string(&path).unwrap(), "older");
        let older = file.appear().unwrap().unwrap();
        assert_eq!(older, folder.path().join("hall-1.jsonl"));
        assert_eq!(fs::read_to_string(&older).unwrap(), "older");
        assert_eq!(fs::read_to_string(&path).unwrap(), "one\n");
        assert_eq!(file.appear().unwrap(), None, "once");
        file.write_all(b"two\n").unwrap();
        file.mark_whole();
        // As of a process that is killed: nothing more is written.
        assert_eq!(fs::read_to_string(&path).unwrap(), "one\ntwo\n");
        file.write_all(b"thr").unwrap();
        drop(file);
        assert_eq!(fs::read_to_string(&path).unwrap(), "one\ntwo\n");
        let mut third = AtomicFile::create(&path).unwrap();
        third.write_all(b"three\n").unwrap();
        assert!(third.appear().unwrap().unwrap().ends_with("hall-2.jsonl"));
        third.finish().unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "three\n");
    }

    #[test]
    fn a_file_that_somebody_cut_moved_or_removed_is_no_longer_intact() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("hall.jsonl");
        let begun = || {
            let mut file = AtomicFile::create(&path).unwrap();
            file.write_all(b"one\n").unwrap();
            file.mark_whole();
            assert!(file.is_intact(true).unwrap(), "it has no name yet");
            file.appear().unwrap();
            assert!(file.is_intact(true).unwrap());
            file
        };
        let mut cut = begun();
        File::options()
            .write(true)
            .open(&path)
            .unwrap()
            .set_len(0)
            .unwrap();
        assert!(!cut.is_intact(false).unwrap());
        cut.write_all(b"two\n").unwrap();
        cut.mark_whole();
        assert_eq!(fs::read_to_string(&path).unwrap(), "two\n");
        let moved = begun();
        let elsewhere = folder.path().join("elsewhere");
        fs::rename(&path, &elsewhere).unwrap();
        assert!(moved.is_intact(false).unwrap() && !moved.is_intact(true).unwrap());
        fs::write(&path, "another").unwrap();
        assert!(!moved.is_intact(true).unwrap());
        let removed = begun();
        fs::remove_file(&path).unwrap();
        assert!(!removed.is_intact(false).unwrap());
    }
}
