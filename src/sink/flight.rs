//! The last minute as a sink, and a handle with which it is saved.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
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
        let inner = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let now = SystemTime::now()
            .duration_since(SystemTime::UNIX_EPOCH)
            .unwrap_or_default();
        let name = format!("{}-{}.record", inner.camera, now.as_millis());
        let path = inner.folder.join(name);
        match inner.flight.save(Instant::now(), &path) {
            Ok(is_there) => Ok(is_there.then_some(path)),
            Err(cause) => Err(SinkError::Create { path, cause }),
        }
    }

    /// As [`save`](Self::save), because something has crashed: not again and again, and not where there is plenty
    /// already.
    ///
    /// # Errors
    /// As [`save`](Self::save).
    pub fn save_after_crash(&self) -> Result<Option<PathBuf>, SinkError> {
        {
            let mut inner = self.0.lock().unwrap_or_else(PoisonError::into_inner);
            let files = fs::read_dir(&inner.folder).map_or(0, Iterator::count);
            if inner.saved.is_some_and(|t| t.elapsed() < BETWEEN) || files >= MOST_FILES {
                return Ok(None);
            }
            inner.saved = Some(Instant::now());
        }
        self.save()
    }
}

impl Sink<BodyFrame> for FlightSink {
    fn take(&mut self, packet: &Packet<'_, BodyFrame>) -> Result<(), SinkError> {
        let mut inner = self.0.lock().unwrap_or_else(PoisonError::into_inner);
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
