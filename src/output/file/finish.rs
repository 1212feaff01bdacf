//! The end of a file: it gets its name, or another where that holds more, and after a failure keeps whole records.

use std::io::{self, Write};
use std::path::PathBuf;

use super::place::written_to;
use super::{AtomicFile, Place};
use crate::output::{kept, stump};

impl AtomicFile {
    /// Says that what was to follow never came: a longer file of the same name then stays, and this one gets another
    /// name beside it.
    pub fn break_off(&mut self) {
        self.is_broken = true;
    }

    /// Gives the file its name once it is on the disk, replacing an older one. Where [`mark_whole`](Self::mark_whole)
    /// was called, the file of a full disk has its name, too, and holds the whole records that found room.
    ///
    /// # Errors
    /// If the disk is full or fails, or the rename does: [`kept_at`](crate::output::kept_at) says where the file lies
    /// then.
    pub fn finish(self) -> io::Result<()> {
        self.finish_beside().map(drop)
    }

    /// As [`finish`](Self::finish); the name that the file got in place of its own, where what is there holds more than
    /// what [broke off](Self::break_off).
    ///
    /// # Errors
    /// As there.
    pub fn finish_beside(mut self) -> io::Result<Option<PathBuf>> {
        let Some(mut writer) = self.writer.take() else {
            return Ok(None);
        };
        // What a failed write left of a record is in the file, not in the buffer, which may have nothing to flush.
        let flushed = writer.flush().and(self.failed.take().map_or(Ok(()), Err));
        // The parts, so that nothing is written behind our back.
        let (mut place, _) = writer.into_parts();
        let bring = self.bring;
        // A disk of another machine may say only now that it is full.
        let flushed = flushed.and_then(|()| match &place {
            Place::Beside(file) => bring(file.as_file()),
            Place::Named(_) | Place::Device(_) => Ok(()),
        });
        if flushed.is_err() {
            let file = match &mut place {
                Place::Beside(file) => file.as_file_mut(),
                Place::Named(file) => file,
                Place::Device(_) => return flushed.map(|()| None),
            };
            let end = written_to(file)?;
            let Some(whole) = self.whole.iter().rev().find(|w| **w <= end && **w > 0) else {
                return flushed.map(|()| None);
            };
            file.set_len(*whole)?;
        }
        let mut beside = None;
        if let Place::Beside(mut file) = place {
            let path = match flushed.is_err() || self.is_broken {
                true => stump::place(&self.path, file.as_file_mut()),
                false => self.path.clone(),
            };
            if flushed.is_err() {
                // What is wrong with the disk is said already.
                let _ = bring(file.as_file());
            }
            let named = match self.is_kept {
                true => kept::named(file, &path),
                false => file.persist(&path).map_err(|e| e.error),
            };
            if let Err(refused) = named {
                return Err(match flushed {
                    Ok(()) => refused,
                    // What lies elsewhere is not whole.
                    Err(why) => kept::because(why, &refused),
                });
            }
            self.made.keep();
            beside = Some(path).filter(|p| *p != self.path);
        }
        flushed.map(|()| beside)
    }
}

#[cfg(test)]
mod tests {
    use std::cell::RefCell;
    use std::fs::{self, File};
    use std::path::Path;

    use tempfile::NamedTempFile;

    use super::super::Bring;
    use super::*;
    use crate::output::kept_at;

    #[test]
    fn a_finished_file_is_whole_and_alone() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("new/result.txt");
        let mut file = AtomicFile::create(&path).unwrap();
        file.write_all(b"whole").unwrap();
        assert!(!path.exists(), "not before it is whole");
        file.finish().unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"whole");
        assert_eq!(fs::read_dir(path.parent().unwrap()).unwrap().count(), 1);
    }

    thread_local! {
        /// A result; whether it had its name, and how long it was, each time it was brought onto the disk.
        static BROUGHT: RefCell<(PathBuf, Vec<(bool, u64)>)> = RefCell::default();
    }

    fn seen(file: &File) -> io::Result<()> {
        let length = file.metadata()?.len();
        BROUGHT.with_borrow_mut(|(path, brought)| brought.push((path.exists(), length)));
        Ok(())
    }

    #[test]
    fn a_file_is_on_the_disk_before_it_has_its_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("result.txt");
        BROUGHT.set((path.clone(), Vec::new()));
        let begun = |bring: Bring| {
            let mut file = AtomicFile::create(&path).unwrap();
            file.bring = bring;
            file.write_all(b"whole").unwrap();
            file
        };
        begun(seen).finish().unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"whole");
        begun(seen).passing().finish().unwrap();
        let (_, brought) = BROUGHT.take();
        assert_eq!(brought, [(false, 5)]);
        fs::write(&path, "older").unwrap();
        let failed = begun(|_| Err(io::Error::other("no disk"))).finish();
        assert_eq!(failed.unwrap_err().to_string(), "no disk");
        assert_eq!(fs::read(&path).unwrap(), b"older");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    /// A file that takes so many bytes and no more, as on a disk that is full then.
    fn full_at(bytes: u64) -> File {
        use rustix::fs::{MemfdFlags, SealFlags, fcntl_add_seals, memfd_create};
        let full = File::from(memfd_create("full", MemfdFlags::ALLOW_SEALING).unwrap());
        full.set_len(bytes).unwrap();
        fcntl_add_seals(&full, SealFlags::GROW).unwrap();
        full
    }

    #[test]
    fn a_full_disk_keeps_whole_records_or_nothing() {
        let record = [b'r'; 20_000];
        for (room, whole) in [(45_000, 40_000), (20_001, 20_000), (19_999, 0)] {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("file");
            let full = full_at(room);
            let kept = full.try_clone().unwrap();
            let beside = NamedTempFile::new_in(folder.path()).unwrap();
            let beside = NamedTempFile::from_parts(full, beside.into_temp_path());
            let mut file = AtomicFile::new(Place::Beside(beside), &path);
            while file.write_all(&record).is_ok() {
                file.mark_whole();
            }
            assert_eq!(file.keeps_anything(), whole > 0, "{room}");
            assert!(file.finish().is_err(), "what broke off is said");
            assert_eq!(path.exists(), whole > 0, "{room}");
            if whole > 0 {
                assert_eq!(kept.metadata().unwrap().len(), whole);
            }
            let left = fs::read_dir(folder.path()).unwrap().count();
            assert_eq!(left, usize::from(whole > 0), "{room}");
        }
    }

    /// What lies under another name in the end is a part: whoever finds it must not take it for the whole.
    #[test]
    fn of_what_broke_off_and_cannot_have_its_name_it_is_said_that_it_broke_off() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        fs::create_dir(&path).unwrap();
        let beside = NamedTempFile::new_in(folder.path()).unwrap();
        let beside = NamedTempFile::from_parts(full_at(45_000), beside.into_temp_path());
        let mut file = AtomicFile::new(Place::Beside(beside), &path);
        file.is_kept = true;
        let why = loop {
            match file.write_all(&[b'r'; 20_000]) {
                Ok(()) => file.mark_whole(),
                Err(why) => break why,
            }
        };
        let told = file.finish().unwrap_err();
        let (at, reason) = kept_at(&told).unwrap();
        assert_eq!(at, folder.path().join("file-new"));
        assert_eq!(reason.kind(), why.kind());
    }

    /// Of a record that is longer than the buffer, and so goes past it, a part finds room.
    #[test]
    fn a_part_of_a_long_record_is_not_kept() {
        let full = full_at(24 << 10);
        let kept = full.try_clone().unwrap();
        let mut file = AtomicFile::new(Place::Named(full), Path::new("full"));
        let record = [b'r'; 20_000];
        file.write_all(&record).unwrap();
        file.mark_whole();
        assert!(file.write_all(&record).is_err());
        assert!(file.finish().is_err(), "what broke off is said");
        assert_eq!(kept.metadata().unwrap().len(), 20_000);
    }
}
