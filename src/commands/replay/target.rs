//! Where the frames of a record go.

use edgecap_client::LinkError;
use edgecap_client::message::{BodyFrame, EventFrame};

use crate::events::EventConfig;
use crate::record::Lives;
use crate::sink::{EventSink, Packet, SharedMemorySink, Sink, SinkError, Sinks, Streamed};

/// Where the frames of a record go.
pub trait Target<M> {
    /// Counts what the record counts anew for people on from those before.
    fn count_on(&mut self, _recorded: &mut M) {}

    /// Publishes a frame as it is `replayed`, which was `recorded` with other times and another number.
    ///
    /// # Errors
    /// Shared memory's.
    fn take(&mut self, replayed: &M, recorded: &M) -> Result<(), SinkError>;

    /// Says that the next frame is the first of another pass.
    fn begin_anew(&mut self) {}

    /// Says that in the record a publisher has ended, and what another one has published follows.
    fn publisher_ended(&mut self) {}

    /// Tells readers that nothing follows.
    ///
    /// # Errors
    /// Shared memory's.
    fn finish(self) -> Result<(), SinkError>;
}

impl<M: Streamed> Target<M> for SharedMemorySink<M> {
    fn take(&mut self, replayed: &M, _: &M) -> Result<(), SinkError> {
        <Self as Sink<M>>::take(self, &packet(replayed))
    }

    fn finish(self) -> Result<(), SinkError> {
        <Self as Sink<M>>::finish(Box::new(self)).map(drop)
    }
}

/// Bodies, and what happens with them.
pub struct BodyStreams {
    lives: Lives,
    bodies: Sinks<BodyFrame>,
    events: Box<EventSink>,
}

impl BodyStreams {
    /// Becomes the writer of both streams of a camera.
    ///
    /// # Errors
    /// A name that cannot be or is taken, and shared memory that fails.
    pub fn open(name: &str, config: EventConfig) -> Result<Self, LinkError> {
        let (mut bodies, mut events) = (Sinks::default(), Sinks::default());
        bodies.push(SharedMemorySink::<BodyFrame>::open(name)?);
        events.push(SharedMemorySink::<EventFrame>::open(name)?);
        let events = Box::new(EventSink::new(config, events));
        Ok(Self {
            lives: Lives::default(),
            bodies,
            events,
        })
    }
}

impl Target<BodyFrame> for BodyStreams {
    fn count_on(&mut self, recorded: &mut BodyFrame) {
        self.lives.count_on(recorded);
    }

    fn take(&mut self, replayed: &BodyFrame, recorded: &BodyFrame) -> Result<(), SinkError> {
        let packet = packet(replayed);
        self.bodies.take(&packet)?;
        // By the record's own times and numbers, which say where it begins anew.
        self.events.take_as(&packet, recorded)
    }

    fn begin_anew(&mut self) {
        self.lives.begin_anew();
        self.events.begin_anew();
    }

    fn publisher_ended(&mut self) {
        self.lives.end();
        self.events.begin_anew();
    }

    fn finish(mut self) -> Result<(), SinkError> {
        // Readers of both hear it before one of them waits for its own.
        let ended = self.bodies.end().and(self.events.end());
        let events = self.events.finish().map(drop);
        let bodies = self.bodies.finish().1;
        ended.and(events).and(bodies)
    }
}

fn packet<M>(message: &M) -> Packet<'_, M> {
    Packet {
        message,
        source: "",
        picture: None,
    }
}
