//! What a run has computed, kept in its folder until the results are there: after a kill or a power cut the same
//! command goes on.
//!
//! Everything is bound by a digest to what it was computed from; what is cut, damaged or of other inputs counts as not
//! there.

use std::fs::{self, File, TryLockError};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};

use super::inputs::{difference, film};
use crate::bounded;
use crate::commands::exit::Failure;
use crate::commands::say;
use crate::commands::view_file::{Looked, look};
use crate::multiview::Kept;
use crate::output::{self, AtomicFile, AtomicFolder, is_unfinished};

/// The folder in the run's.
pub const NAME: &str = "resume";
const LOCK: &str = "lock";
const INPUTS: &str = "inputs.txt";
const PARTS: &str = "parts";
const MASKS: &str = "masks";
const FILM: &str = "film-";
const SEAL: &str = "seal";
/// Bytes of a digest before a part.
const DIGEST: usize = blake3::OUT_LEN;

/// Whether a folder holds what is kept here, and is not somebody's own of that name.
pub fn is_one(folder: &Path) -> bool {
    match bounded::read_text(&folder.join(INPUTS), bounded::SETTINGS) {
        Ok(inputs) => inputs.starts_with("edgecap "),
        // It was only begun, or a power cut took its first file.
        Err(_) => fs::read_dir(folder).is_ok_and(|mut all| {
            all.all(|e| e.is_ok_and(|e| e.file_name() == LOCK || is_unfinished(&e.path())))
        }),
    }
}

/// The observations of a film.
pub struct Film {
    /// The file of them.
    pub record: PathBuf,
    /// How much of the film they are of.
    pub looked: Looked,
    /// Whether an earlier run has made them.
    pub was_there: bool,
}

/// What a film's observations are sealed with: their inputs, and how much of the film could be seen.
fn ended(inputs: &str, looked: Looked) -> String {
    match looked {
        Looked::Whole => inputs.to_owned(),
        Looked::InPart => format!("{inputs}in part\n"),
    }
}

/// The work of a run that is not done.
pub struct Store {
    out: PathBuf,
    folder: PathBuf,
    /// What results depend on.
    inputs: String,
    /// Held while the folder is in use; `None` before this process uses it.
    lock: Mutex<Option<File>>,
    /// Whether the run's folder was made for this one.
    made: AtomicBool,
    /// Whether it was said that nothing can be kept.
    failed: AtomicBool,
}

impl Store {
    /// Finds what an earlier run left in `out`, and leaves it as it is until [`begin`](Self::begin).
    ///
    /// # Errors
    /// When another process is at work there, or it cannot be written.
    pub fn open(out: &Path, inputs: String) -> anyhow::Result<Self> {
        let store = Self {
            out: out.to_owned(),
            folder: out.join(NAME),
            inputs,
            lock: Mutex::new(None),
            made: AtomicBool::new(false),
            failed: AtomicBool::new(false),
        };
        if store.folder.is_dir() {
            store.make()?;
        }
        Ok(store)
    }

    /// Makes the folder its own, removes what is not of these inputs, and says so. A command that names a file which is
    /// not there has other inputs: this is for after all of them were read.
    ///
    /// # Errors
    /// When another process is at work there by now, or the folder cannot be read or written.
    pub fn begin(&self) -> anyhow::Result<()> {
        // Before anything is removed: what lies there may be the work of one that began meanwhile.
        self.make()?;
        Ok(self.tidy().map_err(|e| Failure::output(&self.out, &e))?)
    }

    /// Makes the folder where it is not there yet.
    fn make(&self) -> anyhow::Result<()> {
        let failed = |e: &io::Error| Failure::output(&self.folder, e);
        let mut lock = self.lock.lock().unwrap_or_else(PoisonError::into_inner);
        if lock.is_some() {
            return Ok(());
        }
        let inputs = self.folder.join(INPUTS);
        self.made.store(!self.out.is_dir(), Ordering::Relaxed);
        fs::create_dir_all(&self.folder).map_err(|e| failed(&e))?;
        let file = File::create(self.folder.join(LOCK)).map_err(|e| failed(&e))?;
        if let Err(TryLockError::WouldBlock) = file.try_lock() {
            let found = format!(
                "expected nobody else at work on {}, found another 'multiview'; wait for it, or choose another --out",
                self.out.display()
            );
            return Err(Failure::try_later(found).into());
        }
        *lock = Some(file);
        // Without it, what is kept before the work begins would be taken for somebody's own.
        if !inputs.exists() {
            output::write(&inputs, self.inputs.as_bytes()).map_err(|e| failed(&e))?;
        }
        Ok(())
    }

    /// Removes what a kill left half done, and what other inputs gave. Observations of a film depend on it and its
    /// lens alone.
    fn tidy(&self) -> io::Result<()> {
        let path = self.folder.join(INPUTS);
        let before = bounded::read_text(&path, bounded::SETTINGS).ok();
        let is_same = before.as_ref() == Some(&self.inputs);
        // A run that ended before its fit has looked at films alone, which stay.
        let is_begun = [self.folder.join(PARTS), self.all_masks()]
            .iter()
            .any(|folder| folder.exists());
        for entry in fs::read_dir(&self.folder)? {
            let entry = entry?;
            let name = entry.file_name();
            let name = name.to_string_lossy();
            if name == LOCK || (is_same && !name.starts_with('.')) || name.starts_with(FILM) {
                continue;
            }
            if entry.file_type()?.is_dir() {
                fs::remove_dir_all(entry.path())?;
            } else {
                fs::remove_file(entry.path())?;
            }
        }
        if !is_same {
            // Of a run that was only begun nothing is lost.
            if let Some(before) = before.filter(|_| is_begun) {
                say::err(&format!(
                    "bodies are computed afresh: the run that {} is left of had other inputs ({})",
                    self.folder.display(),
                    difference(&self.inputs, &before)
                ));
            }
            output::write(&path, self.inputs.as_bytes())?;
        }
        Ok(())
    }

    /// The observations of a film; `fov` is the lens's field of view, degrees, where one is known.
    ///
    /// # Errors
    /// When they cannot be computed or written.
    pub fn film(&self, fov: Option<f64>, path: &Path) -> anyhow::Result<Film> {
        self.make()?;
        let inputs = film(path, fov);
        let name = format!("{FILM}{}", &blake3::hash(inputs.as_bytes()).to_hex()[..16]);
        let record = self.folder.join(&name);
        // What was seen in part, of the same film, comes out no better by another look.
        for looked in [Looked::Whole, Looked::InPart] {
            if self.is_sealed(&name, &ended(&inputs, looked)) {
                return Ok(Film {
                    record,
                    looked,
                    was_there: true,
                });
            }
        }
        // Under another name until it is whole: one that is interrupted makes its record complete.
        let part = self.folder.join(format!("{name}.part"));
        let looked = look(path, fov, &part).inspect_err(|_| {
            let _ = fs::remove_file(&part);
        })?;
        let sealed = File::open(&part)
            .and_then(|f| f.sync_all())
            .and_then(|()| fs::rename(&part, &record))
            .and_then(|()| self.seal(&name, &ended(&inputs, looked)));
        sealed.map_err(|e| Failure::output(&record, &e))?;
        Ok(Film {
            record,
            looked,
            was_there: false,
        })
    }

    /// Where masks of a view go, and whether they are all there; what there is of some is removed. The folder is called
    /// by its number: a calibration may call its cameras anything, `../../pictures` too.
    ///
    /// # Errors
    /// When the folder cannot be made.
    pub fn masks(&self, view: usize) -> anyhow::Result<(PathBuf, bool)> {
        self.make()?;
        let name = format!("{MASKS}/{view}");
        let path = self.folder.join(&name);
        if self.is_sealed(&name, &self.inputs) {
            return Ok((path, true));
        }
        let made = match fs::remove_dir_all(&path) {
            Err(e) if e.kind() != io::ErrorKind::NotFound => Err(e),
            _ => fs::create_dir_all(&path),
        };
        made.map_err(|e| Failure::output(&path, &e))?;
        Ok((path, false))
    }

    /// Says that all masks of a view are there.
    pub fn masks_are_whole(&self, view: usize) {
        let sealed = self.seal(&format!("{MASKS}/{view}"), &self.inputs);
        self.note(sealed);
    }

    /// The folder with a folder of masks a view.
    pub fn all_masks(&self) -> PathBuf {
        self.folder.join(MASKS)
    }

    /// Where results are written before they are moved into the run's folder, on the same disk: with the work that is
    /// kept, so that a killed run goes on all the same.
    ///
    /// # Errors
    /// When the folder cannot be made.
    pub fn results(&self) -> anyhow::Result<AtomicFolder> {
        self.make()?;
        let made = AtomicFolder::create_in(&self.folder, &self.out);
        Ok(made.map_err(|e| Failure::output(&self.folder, &e))?)
    }

    /// Removes everything: the results are there. What cannot be removed is said; it does no harm.
    pub fn remove(self) {
        // A file that is open keeps its folder on NFS.
        *self.lock.lock().unwrap_or_else(PoisonError::into_inner) = None;
        if let Err(e) = fs::remove_dir_all(&self.folder)
            && e.kind() != io::ErrorKind::NotFound
        {
            self.say_left(&e);
        }
    }

    /// Says that the work is left beside its results.
    pub fn say_left(&self, why: &io::Error) {
        say::err(&format!(
            "the results are in {}; what they were computed with is left in {} ({why}): remove it",
            self.out.display(),
            self.folder.display()
        ));
    }

    fn seal(&self, name: &str, inputs: &str) -> io::Result<()> {
        let digest = self.digest(name, inputs)?;
        output::write(&self.sealed(name), digest.to_hex().as_bytes())
    }

    fn is_sealed(&self, name: &str, inputs: &str) -> bool {
        let Ok(sealed) = bounded::read_text(&self.sealed(name), bounded::SETTINGS) else {
            return false;
        };
        self.digest(name, inputs)
            .is_ok_and(|d| sealed == d.to_hex().as_str())
    }

    fn sealed(&self, name: &str) -> PathBuf {
        self.folder.join(format!("{name}.{SEAL}"))
    }

    /// Of a file, or of the files of a folder, and what they were computed from.
    fn digest(&self, name: &str, inputs: &str) -> io::Result<blake3::Hash> {
        let path = self.folder.join(name);
        let mut hash = blake3::Hasher::new();
        hash.update(inputs.as_bytes());
        if path.is_dir() {
            let entries = fs::read_dir(&path)?.collect::<io::Result<Vec<_>>>()?;
            let mut files: Vec<PathBuf> = entries.iter().map(fs::DirEntry::path).collect();
            files.sort();
            for file in files {
                let name = file.file_name().unwrap_or_default();
                hash.update(name.as_encoded_bytes());
                hash.update(&fs::metadata(&file)?.len().to_le_bytes());
                hash.update_reader(File::open(&file)?)?;
            }
        } else {
            hash.update_reader(File::open(&path)?)?;
        }
        Ok(hash.finalize())
    }

    fn part(&self, part: &str) -> PathBuf {
        self.folder.join(PARTS).join(part)
    }

    fn part_digest(&self, part: &str, bytes: &[u8]) -> blake3::Hash {
        let mut hash = blake3::Hasher::new();
        for piece in [self.inputs.as_bytes(), part.as_bytes(), bytes] {
            hash.update(&(piece.len() as u64).to_le_bytes());
            hash.update(piece);
        }
        hash.finalize()
    }

    fn write(&self, part: &str, bytes: &[u8]) -> anyhow::Result<()> {
        self.make()?;
        let mut file = AtomicFile::create(&self.part(part))?;
        file.write_all(self.part_digest(part, bytes).as_bytes())?;
        file.write_all(bytes)?;
        file.sync()?;
        Ok(file.finish()?)
    }

    /// Says once that nothing can be kept.
    fn note<E: std::fmt::Display>(&self, outcome: Result<(), E>) {
        if let Err(e) = outcome
            && !self.failed.swap(true, Ordering::Relaxed)
        {
            say::err(&format!(
                "cannot keep parts of the work in {}: {e}; if this run is broken off, some of it is lost",
                self.folder.display()
            ));
        }
    }
}

impl Kept for Store {
    fn get(&self, part: &str) -> Option<Vec<u8>> {
        let mut bytes = bounded::read(&self.part(part), bounded::DATA).ok()?;
        let payload = (bytes.len() >= DIGEST).then(|| bytes.split_off(DIGEST))?;
        (bytes == self.part_digest(part, &payload).as_bytes()).then_some(payload)
    }

    fn put(&self, part: &str, bytes: &[u8]) {
        let kept = self.write(part, bytes);
        self.note(kept);
    }
}

impl Drop for Store {
    /// Leaves nothing where nothing was computed.
    fn drop(&mut self) {
        let lock = self.lock.get_mut().unwrap_or_else(PoisonError::into_inner);
        if lock.is_none() {
            return;
        }
        // Parts are whole by themselves; films and masks are when they have their seal.
        let worth = [
            self.folder.clone(),
            self.all_masks(),
            self.folder.join(PARTS),
        ];
        let entries = worth.iter().flat_map(fs::read_dir).flatten().flatten();
        // So are results that could not be moved to their place.
        let is_worth = |path: &Path| {
            path.extension().is_some_and(|e| e == SEAL)
                || path.parent().is_some_and(|p| p.ends_with(PARTS))
                || (path.is_dir() && is_unfinished(path))
        };
        if entries.map(|e| e.path()).any(|path| is_worth(&path)) {
            return;
        }
        let _ = fs::remove_dir_all(&self.folder);
        if *self.made.get_mut() {
            // Fails when somebody else put something there meanwhile; then it stays.
            let _ = fs::remove_dir(&self.out);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::exit::{TRY_LATER, code};

    #[test]
    fn of_two_that_found_no_work_the_second_leaves_that_of_the_first() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("run");
        let [first, second] =
            ["edgecap 1\n", "edgecap 2\n"].map(|i| Store::open(&out, i.to_owned()).unwrap());
        first.begin().unwrap();
        first.put("joints-1-0", b"bodies");
        let e = second.begin().unwrap_err();
        assert_eq!(code(&e), TRY_LATER, "{e}");
        drop(second);
        assert_eq!(first.get("joints-1-0").as_deref(), Some(&b"bodies"[..]));
        let inputs = fs::read_to_string(out.join(NAME).join(INPUTS)).unwrap();
        assert_eq!(inputs, "edgecap 1\n");
    }

    #[test]
    fn a_run_that_began_and_kept_nothing_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("run");
        let store = Store::open(&out, "edgecap 1\n".to_owned()).unwrap();
        store.begin().unwrap();
        assert!(out.join(NAME).join(LOCK).exists());
        drop(store);
        assert!(!out.exists());
    }
}
