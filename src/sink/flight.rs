//! The last minute as a sink, and a handle with which it is saved. A thread of its own writes it: a disk that is slow,
//! or hangs, holds nothing up.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant, SystemTime};

use super::patient::is_full_or_away;
use super::{Packet, Sink, SinkError};
use crate::message::BodyFrame;
use crate::output;
use crate::record::{BodiesRow, FlightRecorder};

/// Crashes save no more often than this: what they save would be the same minute.
const BETWEEN: Duration = Duration::from_secs(60);
/// With so many of a camera's minutes in the folder crashes save no more: nobody looks at them.
const MOST_FILES: usize = 20;
/// How long the end waits for what is being written.
const LAST: Duration = Duration::from_secs(3);

/// How bytes become a file.
type Write = fn(&Path, &[u8]) -> io::Result<()>;

/// Keeps the last minute of a camera's bodies. Its clones are the same one.
#[derive(Debug, Clone)]
pub struct FlightSink(Arc<Mutex<Inner>>);

#[derive(Debug)]
struct Inner {
    flight: FlightRecorder<BodiesRow>,
    folder: PathBuf,
    camera: String,
    write: Write,
    /// When a crash was last saved, or began to be.
    saved: Option<Instant>,
    /// Hears the end of what is being written: nothing is sent.
    under_way: Option<Receiver<()>>,
    /// Somebody was told that there are plenty of them.
    has_told: bool,
}

impl FlightSink {
    /// Saves to `folder`, which is made; where its disk is full or away, when something is saved.
    ///
    /// # Errors
    /// [`SinkError::Create`] for a place that cannot be one.
    pub fn create(folder: &Path, camera: &str) -> Result<Self, SinkError> {
        let made = fs::create_dir_all(folder);
        Self::with_writer(folder, made, camera, output::write_passing)
    }

    /// With a folder that was `made`, or could not be.
    fn with_writer(
        folder: &Path,
        made: io::Result<()>,
        camera: &str,
        write: Write,
    ) -> Result<Self, SinkError> {
        let refused = |cause| SinkError::Create {
            path: folder.to_owned(),
            cause,
        };
        match made {
            Err(e) if is_full_or_away(folder, &e) => {
                let e = refused(e);
                tracing::warn!("the last minute: {e}; the folder is made when something is saved");
            }
            made => made.map_err(refused)?,
        }
        Ok(Self(Arc::new(Mutex::new(Inner {
            flight: FlightRecorder::default(),
            folder: folder.to_owned(),
            camera: camera.to_owned(),
            write,
            saved: None,
            under_way: None,
            has_told: false,
        }))))
    }

    /// Begins to save the last minute, if there is any and none is being saved; what becomes of it the log says.
    pub fn save(&self) {
        self.begin(false);
    }

    /// As [`save`](Self::save), because something has crashed: not again and again, and not where there is plenty
    /// already.
    pub fn save_after_crash(&self) {
        self.begin(true);
    }

    fn begin(&self, crashed: bool) {
        let now = Instant::now();
        let mut inner = self.lock();
        if inner.is_under_way() {
            if !crashed {
                tracing::warn!("the last minute is still being written; ask again later");
            }
            return;
        }
        let is_same = |t| now.saturating_duration_since(t) < BETWEEN;
        if crashed && inner.saved.is_some_and(is_same) {
            return;
        }
        // A crash of which nothing was kept leaves the next one its file.
        let Some(bytes) = inner.flight.minute(now) else {
            return;
        };
        let (path, write) = (inner.next_path(), inner.write);
        let (ends, under_way) = channel();
        let this = self.clone();
        let thread = thread::Builder::new().name("flight".into());
        let begun = thread.spawn(move || {
            let is_kept = !(crashed && this.has_plenty()) && keep(&path, &bytes, write);
            if !is_kept && crashed {
                this.lock().saved = None;
            }
            drop(ends);
        });
        if let Err(e) = begun {
            tracing::error!("the last minute: {e}");
            return;
        }
        inner.under_way = Some(under_way);
        if crashed {
            inner.saved = Some(now);
        }
    }

    /// Whether so many of this camera's minutes are in the folder that a crash saves no more; said once.
    fn has_plenty(&self) -> bool {
        let (folder, camera) = {
            let inner = self.lock();
            (inner.folder.clone(), inner.camera.clone())
        };
        let is_minute = |name: &str| {
            let time = name.strip_prefix(&*camera)?.strip_prefix('-')?;
            let time = time.strip_suffix(".record")?;
            time.bytes().all(|b| b.is_ascii_digit()).then_some(())
        };
        // A folder that cannot be read cannot be written to, most often, and that says why.
        let entries = fs::read_dir(&folder).into_iter().flatten().flatten();
        let names = entries.filter_map(|e| e.file_name().into_string().ok());
        let has_plenty = names.filter_map(|n| is_minute(&n)).count() >= MOST_FILES;
        if has_plenty && !self.lock().has_told {
            tracing::warn!(
                "no more last minutes of {camera} are saved after crashes: {} holds {MOST_FILES}; move them away",
                folder.display()
            );
        }
        self.lock().has_told = has_plenty;
        has_plenty
    }

    /// Waits so long for what is being written.
    fn wait(&self, patience: Duration) {
        let under_way = self.lock().under_way.take();
        if let Some(under_way) = under_way {
            // It has ended, or there is no time left.
            let _ = under_way.recv_timeout(patience);
        }
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Inner {
    fn is_under_way(&self) -> bool {
        let heard = self.under_way.as_ref().map(Receiver::try_recv);
        heard == Some(Err(TryRecvError::Empty))
    }

    fn next_path(&self) -> PathBuf {
        let now = SystemTime::now()
            .duration_since(SystemTime::UNIX_EPOCH)
            .unwrap_or_default();
        let name = format!("{}-{}.record", self.camera, now.as_millis());
        self.folder.join(name)
    }
}

/// Writes the minute; whether it is there, which is said.
fn keep(path: &Path, bytes: &[u8], write: Write) -> bool {
    match write(path, bytes) {
        Ok(()) => {
            tracing::warn!("the last minute → {}", path.display());
            true
        }
        Err(cause) => {
            let path = path.to_owned();
            tracing::error!("the last minute: {}", SinkError::Create { path, cause });
            false
        }
    }
}

impl Sink<BodyFrame> for FlightSink {
    fn take(&mut self, packet: &Packet<'_, BodyFrame>) -> Result<(), SinkError> {
        let mut inner = self.lock();
        let added = inner
            .flight
            .add(Instant::now(), packet.message, packet.source);
        added.map_err(|cause| SinkError::Write {
            path: inner.folder.clone(),
            cause,
        })
    }

    fn finish(self: Box<Self>) -> Result<Option<String>, SinkError> {
        self.wait(LAST);
        Ok(None)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn take(flight: &mut FlightSink) {
        let packet = Packet {
            message: &BodyFrame::default(),
            source: "",
            picture: None,
        };
        flight.take(&packet).unwrap();
    }

    fn files(folder: &Path) -> usize {
        fs::read_dir(folder).unwrap().count()
    }

    #[test]
    fn a_crash_with_nothing_to_save_leaves_the_next_one_its_file() {
        let folder = tempfile::tempdir().unwrap();
        let mut flight = FlightSink::create(folder.path(), "hall").unwrap();
        let after_crash = |flight: &FlightSink| {
            flight.save_after_crash();
            flight.wait(Duration::MAX);
            files(folder.path())
        };
        assert_eq!(after_crash(&flight), 0, "no frame came");
        take(&mut flight);
        assert_eq!(after_crash(&flight), 1);
        assert_eq!(after_crash(&flight), 1, "the same minute");
    }

    #[test]
    fn a_crash_is_saved_whatever_else_is_in_the_folder_and_twenty_times() {
        let folder = tempfile::tempdir().unwrap();
        let make = |name: &str| fs::write(folder.path().join(name), "").unwrap();
        for n in 0..MOST_FILES {
            make(&format!("hall-2-{n}.record"));
            make(&format!("hall-{n}.jsonl"));
        }
        let mut flight = FlightSink::create(folder.path(), "hall").unwrap();
        take(&mut flight);
        let after_crash = || {
            let before = files(folder.path());
            flight.lock().saved = None;
            flight.save_after_crash();
            flight.wait(Duration::MAX);
            (files(folder.path()) - before, flight.lock().has_told)
        };
        assert_eq!(after_crash(), (1, false));
        for n in 1..MOST_FILES {
            make(&format!("hall-{n}.record"));
        }
        assert_eq!(after_crash(), (0, true));
        fs::remove_file(folder.path().join("hall-1.record")).unwrap();
        // It is told of again when there are plenty again.
        assert!(!after_crash().1);
    }

    #[test]
    fn a_crash_that_could_not_be_saved_leaves_the_next_one_its_file() {
        let folder = tempfile::tempdir().unwrap();
        let full: Write = |_, _| Err(io::ErrorKind::StorageFull.into());
        let mut flight = FlightSink::with_writer(folder.path(), Ok(()), "hall", full).unwrap();
        take(&mut flight);
        flight.save_after_crash();
        flight.wait(Duration::MAX);
        assert!(flight.lock().saved.is_none());
    }

    /// A service that ended over it would begin again and again.
    #[test]
    fn a_folder_for_which_there_was_no_room_is_made_when_something_is_saved() {
        let folder = tempfile::tempdir().unwrap();
        let place = folder.path().join("last");
        let begun = |errno: i32| {
            let refused = Err(io::Error::from_raw_os_error(errno));
            FlightSink::with_writer(&place, refused, "hall", output::write_passing)
        };
        assert!(begun(libc::EACCES).is_err());
        let mut flight = begun(libc::ENOSPC).unwrap();
        assert!(!place.exists());
        take(&mut flight);
        flight.save();
        flight.wait(Duration::MAX);
        assert_eq!(files(&place), 1);
    }

    /// Held by a test for as long as the disk hangs.
    static DISK: Mutex<()> = Mutex::new(());

    #[test]
    fn a_disk_that_hangs_holds_nothing_up() {
        let folder = tempfile::tempdir().unwrap();
        let hanging: Write = |path, bytes| {
            let _disk = DISK.lock();
            output::write(path, bytes)
        };
        let mut flight = FlightSink::with_writer(folder.path(), Ok(()), "hall", hanging).unwrap();
        let disk = DISK.lock();
        take(&mut flight);
        flight.save();
        take(&mut flight);
        // One at a time.
        flight.save();
        flight.save_after_crash();
        assert_eq!(files(folder.path()), 0);
        assert!(flight.lock().is_under_way());
        drop(disk);
        flight.wait(Duration::MAX);
        assert_eq!(files(folder.path()), 1);
    }
}
