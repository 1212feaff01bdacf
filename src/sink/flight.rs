//! The last minute as a sink, and a handle with which it is saved.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant, SystemTime};

use super::{Packet, Sink, SinkError};
use crate::message::BodyFrame;
use crate::record::{BodiesRow, FlightRecorder};

/// Crashes save no more often than this: what they save would be the same minute.
const BETWEEN: Duration = Duration::from_secs(60);
/// With so many files in the folder crashes save nothing any more: nobody looks at them.
const MOST_FILES: usize = 20;

/// Keeps the last minute of a camera's bodies. Its clones are the same one.
#[derive(Debug, Clone)]
pub struct FlightSink(Arc<Mutex<Inner>>);

#[derive(Debug)]
struct Inner {
    flight: FlightRecorder<BodiesRow>,
    folder: PathBuf,
    camera: String,
    /// When a crash was last saved.
    saved: Option<Instant>,
}

impl FlightSink {
    /// Saves to `folder`, which is made.
    ///
    /// # Errors
    /// [`SinkError::Create`].
    pub fn create(folder: &Path, camera: &str) -> Result<Self, SinkError> {
        fs::create_dir_all(folder).map_err(|cause| SinkError::Create {
            path: folder.to_owned(),
            cause,
        })?;
        Ok(Self(Arc::new(Mutex::new(Inner {
            flight: FlightRecorder::default(),
            folder: folder.to_owned(),
            camera: camera.to_owned(),
            saved: None,
        }))))
    }

    /// Saves the last minute; where it is now, or `None` where there was nothing.
    ///
    /// # Errors
    /// [`SinkError::Create`].
    pub fn save(&self) -> Result<Option<PathBuf>, SinkError> {
        self.lock().save()
    }

    /// As [`save`](Self::save), because something has crashed: not again and again, and not where there is plenty
    /// already.
    ///
    /// # Errors
    /// As [`save`](Self::save).
    pub fn save_after_crash(&self) -> Result<Option<PathBuf>, SinkError> {
        let mut inner = self.lock();
        let files = fs::read_dir(&inner.folder).map_or(0, Iterator::count);
        if inner.saved.is_some_and(|t| t.elapsed() < BETWEEN) || files >= MOST_FILES {
            return Ok(None);
        }
        let path = inner.save()?;
        // A crash of which nothing was kept leaves the next one its file.
        if path.is_some() {
            inner.saved = Some(Instant::now());
        }
        Ok(path)
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Inner {
    fn save(&self) -> Result<Option<PathBuf>, SinkError> {
        let now = SystemTime::now()
            .duration_since(SystemTime::UNIX_EPOCH)
            .unwrap_or_default();
        let name = format!("{}-{}.record", self.camera, now.as_millis());
        let path = self.folder.join(name);
        match self.flight.save(Instant::now(), &path) {
            Ok(is_there) => Ok(is_there.then_some(path)),
            Err(cause) => Err(SinkError::Create { path, cause }),
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
        Ok(None)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_crash_with_nothing_to_save_leaves_the_next_one_its_file() {
        let folder = tempfile::tempdir().unwrap();
        let mut flight = FlightSink::create(folder.path(), "hall").unwrap();
        assert_eq!(flight.save_after_crash().unwrap(), None, "no frame came");
        let message = BodyFrame::default();
        let packet = Packet {
            message: &message,
            source: "",
            picture: None,
        };
        flight.take(&packet).unwrap();
        let saved = flight.save_after_crash().unwrap().unwrap();
        assert!(saved.is_file());
        assert_eq!(flight.save_after_crash().unwrap(), None, "the same minute");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }
}
