//! A stream in shared memory, as a sink.

use std::time::{Duration, Instant};

use edgecap_client::message::FLAG_END_OF_STREAM;
use edgecap_client::{LinkError, Message, Publisher};

use super::{Packet, Sink, SinkError};
use crate::camera::monotonic_ns;
use crate::message::{BodyFrame, EventFrame, ObservationFrame, PictureFrame};

/// How long readers may take to read the last messages: these lie in this process's memory.
const LAST_WORDS: Duration = Duration::from_millis(1500);

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
        let began = self.ended.unwrap_or_else(Instant::now);
        while self.publisher.subscriber_count() > 0 && began.elapsed() < LAST_WORDS {
            std::thread::sleep(Duration::from_millis(5));
        }
        Ok(None)
    }
}
