//! Where results go. A message goes to every sink of a list: shared memory, records, pictures with skeletons.

mod error;
mod events;
mod flight;
mod overlay;
mod patient;
mod picture;
mod record;
mod shared_memory;
mod silence;
mod streams;

pub use error::SinkError;
pub use events::EventSink;
pub use flight::FlightSink;
pub use overlay::OverlaySink;
pub use patient::PatientRecord;
pub(crate) use patient::is_full_or_away;
pub use picture::PictureSink;
pub use record::RecordSink;
pub use shared_memory::{SharedMemorySink, Streamed};
pub use silence::{Rhythm, Silence};
pub use streams::Streams;

use crate::capture::Frame;

/// A frame's result and what it came of.
#[derive(Debug, Clone, Copy)]
pub struct Packet<'a, M> {
    /// The result.
    pub message: &'a M,
    /// The picture's file, or the film.
    pub source: &'a str,
    /// The picture, where the stage still has it.
    pub picture: Option<&'a Frame>,
}

/// One place where results go.
pub trait Sink<M> {
    /// Takes a frame's result.
    ///
    /// # Errors
    /// What the place failed of; what it took before is kept.
    fn take(&mut self, packet: &Packet<'_, M>) -> Result<(), SinkError>;

    /// Says that results were to follow and never came, before [`finish`](Self::finish): what there is must not take
    /// the place of more.
    fn break_off(&mut self) {}

    /// Says that no result has come for a while, although the stream has not ended: what shows people shows nobody
    /// until the next one.
    fn quiet(&mut self) {}

    /// Says that nobody of before is there any more, although the stream goes on: whoever comes has an id of their own.
    fn everybody_leaves(&mut self) {}

    /// Tells whoever reads that nothing follows; [`finish`](Self::finish) comes next.
    ///
    /// # Errors
    /// What the place failed of.
    fn end(&mut self) -> Result<(), SinkError> {
        Ok(())
    }

    /// Makes what was taken complete, and says in a few words what there is, if that is worth saying.
    ///
    /// # Errors
    /// What the place failed of.
    fn finish(self: Box<Self>) -> Result<Option<String>, SinkError>;
}

/// The sinks of a stage.
pub struct Sinks<M>(Vec<Box<dyn Sink<M>>>);

impl<M> Default for Sinks<M> {
    fn default() -> Self {
        Self(Vec::new())
    }
}

impl<M> Sinks<M> {
    /// Adds one.
    pub fn push(&mut self, sink: impl Sink<M> + 'static) {
        self.0.push(Box::new(sink));
    }

    /// Whether results go nowhere.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Gives a result to every sink, whether or not another one failed.
    ///
    /// # Errors
    /// The first failure.
    pub fn take(&mut self, packet: &Packet<'_, M>) -> Result<(), SinkError> {
        let mut first = Ok(());
        for sink in &mut self.0 {
            let taken = sink.take(packet);
            first = first.and(taken);
        }
        first
    }

    /// Tells every sink that results were to follow and never came.
    pub fn break_off(&mut self) {
        self.0.iter_mut().for_each(|sink| sink.break_off());
    }

    /// Tells every sink that no result has come for a while.
    pub fn quiet(&mut self) {
        self.0.iter_mut().for_each(|sink| sink.quiet());
    }

    /// Tells every sink that nobody of before is there any more.
    pub fn everybody_leaves(&mut self) {
        self.0.iter_mut().for_each(|sink| sink.everybody_leaves());
    }

    /// Has every sink tell that nothing follows, whether or not another one failed.
    ///
    /// # Errors
    /// The first failure.
    pub fn end(&mut self) -> Result<(), SinkError> {
        let ended = self.0.iter_mut().map(|sink| sink.end());
        ended.fold(Ok(()), Result::and)
    }

    /// Makes all of them complete and returns what they have to say.
    ///
    /// # Errors
    /// The first failure; the others are complete all the same.
    pub fn finish(mut self) -> (Vec<String>, Result<(), SinkError>) {
        // Readers of all of them hear it before one of them waits for its own.
        let (mut words, mut first) = (Vec::new(), self.end());
        for sink in self.0 {
            match sink.finish() {
                Ok(said) => words.extend(said),
                Err(e) => first = first.and(Err(e)),
            }
        }
        (words, first)
    }
}
