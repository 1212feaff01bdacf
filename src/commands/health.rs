//! How a source is doing, published beside what comes of its pictures: at every change, and about once a second.

use std::time::Duration;

use edgecap_client::message::HealthFrame;
use edgecap_client::{LinkError, Subscriber};

use crate::camera::monotonic_ns;
use crate::metrics::{About, Health};
use crate::sink::{Packet, SharedMemorySink, SinkError, Sinks, Streams};

/// The health of one source and its stream.
pub struct HealthStream {
    health: Health,
    sinks: Sinks<HealthFrame>,
    has_ended: bool,
}

impl HealthStream {
    /// Of a source that is opened now; without `streams` nobody is told.
    ///
    /// # Errors
    /// As [`Streams::add_to`].
    pub fn open(about: About, streams: Option<&Streams>) -> Result<Self, LinkError> {
        let mut sinks = Sinks::default();
        if let Some(streams) = streams {
            streams.add_to(&mut sinks, SharedMemorySink::<HealthFrame>::open)?;
        }
        Ok(Self {
            health: Health::new(about, monotonic_ns()),
            sinks,
            has_ended: false,
        })
    }

    /// Where it is told: whoever is added before the first word hears all.
    pub fn sinks(&mut self) -> &mut Sinks<HealthFrame> {
        &mut self.sinks
    }

    /// Takes in what has become of the source by now, in nanoseconds of the monotonic clock, and tells it where it is
    /// time for that. Call it several times a second, also where nothing has happened.
    ///
    /// # Errors
    /// Shared memory's.
    pub fn look(&mut self, takes_in: impl FnOnce(&mut Health, u64)) -> Result<(), SinkError> {
        if self.sinks.is_empty() {
            return Ok(());
        }
        let now = monotonic_ns();
        takes_in(&mut self.health, now);
        match self.health.tell(now) {
            Some(message) => self.publish(&message),
            None => Ok(()),
        }
    }

    /// Tells that nothing follows from this process, with the newest counts.
    pub fn end(&mut self) {
        if self.sinks.is_empty() || std::mem::replace(&mut self.has_ended, true) {
            return;
        }
        let newest = self.health.as_of(monotonic_ns());
        // Where it cannot be told, readers see within a second that nobody publishes any more.
        let _ = self.publish(&newest);
        let _ = self.sinks.end();
    }

    /// The same, and waits a little for those who still read.
    pub fn finish(mut self) {
        self.end();
        let _ = self.sinks.finish();
    }

    fn publish(&mut self, message: &HealthFrame) -> Result<(), SinkError> {
        self.sinks.take(&Packet {
            message,
            source: "",
            picture: None,
        })
    }
}

/// What a camera that publishes says of itself now; `None` where it says nothing.
pub fn health_of(camera: &str) -> Option<HealthFrame> {
    let stream = Subscriber::<HealthFrame>::open(camera).ok()?;
    let newest = stream.newest(Duration::ZERO).ok()??;
    Some(*newest)
}
