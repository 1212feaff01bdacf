//! A stream in shared memory, as a sink.

use std::time::{Duration, Instant};

use edgecap_client::message::{FLAG_END_OF_STREAM, HealthFrame, HealthPace, HealthState};
use edgecap_client::{LinkError, Message, Publisher};

use super::{Packet, Sink, SinkError};
use crate::camera::monotonic_ns;
use crate::message::{BodyFrame, EventFrame, ObservationFrame, PictureFrame};

/// How long readers may take to read the last messages: these lie in this process's memory.
const LAST_WORDS: Duration = Duration::from_millis(1500);

/// How long a stream's file stays at least: who has waited for a run for long looks for one every 200 ms, and a little
/// later where the machine is busy.
const FOUND_WITHIN: Duration = Duration::from_millis(300);

/// What a stream's end looks like.
pub trait Streamed: Message {
    /// Marks the end: nobody in it any more.
    fn end(&mut self);
    /// Sets when it was published.
    fn stamp(&mut self, now: u64);
}

impl Streamed for ObservationFrame {
    fn end(&mut self) {
        self.flags |= FLAG_END_OF_STREAM;
        self.count = 0;
    }

    fn stamp(&mut self, now: u64) {
        self.publish_ns = now;
    }
}

impl Streamed for BodyFrame {
    fn end(&mut self) {
        self.flags |= FLAG_END_OF_STREAM;
        self.count = 0;
    }

    fn stamp(&mut self, now: u64) {
        self.publish_ns = now;
    }
}

impl Streamed for EventFrame {
    fn end(&mut self) {
        self.flags |= FLAG_END_OF_STREAM;
        self.first += u64::from(self.count);
        (self.count, self.present, self.main_person) = (0, 0, 0);
    }

    fn stamp(&mut self, now: u64) {
        self.publish_ns = now;
    }
}

impl Streamed for HealthFrame {
    fn end(&mut self) {
        self.flags |= FLAG_END_OF_STREAM;
        (self.state, self.since_ns) = (HealthState::ENDED, monotonic_ns());
        (self.source_hz, self.observed_hz, self.look_hz) = (0.0, 0.0, 0.0);
        (self.latency_us, self.pace) = (0, HealthPace::UNKNOWN);
        (self.people, self.cameras_live) = (0, 0);
    }

    fn stamp(&mut self, now: u64) {
        self.publish_ns = now;
    }
}

impl Streamed for PictureFrame {
    fn end(&mut self) {
        self.flags |= FLAG_END_OF_STREAM;
        self.count = 0;
        self.jpeg.fill(0);
    }

    fn stamp(&mut self, now: u64) {
        self.publish_ns = now;
    }
}

/// Publishes every result, and the end of the stream when it finishes.
#[derive(Debug)]
pub struct SharedMemorySink<M: Streamed> {
    publisher: Publisher<M>,
    opened: Instant,
    last: Box<M>,
    ended: Option<Instant>,
}

impl<M: Streamed> SharedMemorySink<M> {
    /// Becomes the writer of `camera`'s stream.
    ///
    /// # Errors
    /// As [`Publisher::open`].
    pub fn open(camera: &str) -> Result<Self, LinkError> {
        Ok(Self {
            publisher: Publisher::open(camera)?,
            opened: Instant::now(),
            last: Box::default(),
            ended: None,
        })
    }

    fn publish(&mut self) -> Result<(), SinkError> {
        self.last.stamp(monotonic_ns());
        Ok(self.publisher.publish(&self.last)?)
    }
}

impl<M: Streamed> Sink<M> for SharedMemorySink<M> {
    fn take(&mut self, packet: &Packet<'_, M>) -> Result<(), SinkError> {
        *self.last = *packet.message;
        self.publish()
    }

    fn end(&mut self) -> Result<(), SinkError> {
        if self.ended.is_none() {
            self.ended = Some(Instant::now());
            self.last.end();
            self.publish()?;
        }
        Ok(())
    }

    fn finish(mut self: Box<Self>) -> Result<Option<String>, SinkError> {
        self.end()?;
        // Nobody waits for readers that were killed.
        self.publisher.clean_up();
        let ended = self.ended.unwrap_or_else(Instant::now);
        let readers = || self.publisher.subscriber_count();
        while is_awaited(self.opened.elapsed(), ended.elapsed(), readers()) {
            std::thread::sleep(Duration::from_millis(5));
        }
        Ok(None)
    }
}

/// Whether somebody may still want what a stream holds that began and ended so long ago and has so many readers.
fn is_awaited(since_begin: Duration, since_end: Duration, readers: usize) -> bool {
    since_begin < FOUND_WITHIN || (readers > 0 && since_end < LAST_WORDS)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_short_run_is_found_by_who_waits_and_a_long_one_ends_with_its_readers() {
        let (brief, long) = (FOUND_WITHIN / 2, 2 * LAST_WORDS);
        assert!(
            is_awaited(brief, Duration::ZERO, 0),
            "nobody may have found it"
        );
        assert!(is_awaited(long, Duration::ZERO, 1), "somebody reads");
        assert!(!is_awaited(FOUND_WITHIN, Duration::ZERO, 0));
        assert!(
            !is_awaited(long, LAST_WORDS, 1),
            "nobody is waited for without end"
        );
    }

    #[test]
    fn the_file_of_a_run_of_one_frame_stays_until_it_is_found() {
        let camera = format!("test-brief-{}", std::process::id());
        let began = Instant::now();
        let mut sink = Box::new(SharedMemorySink::<EventFrame>::open(&camera).unwrap());
        sink.publish().unwrap();
        sink.finish().unwrap();
        assert!(began.elapsed() >= FOUND_WITHIN, "{:?}", began.elapsed());
    }
}
