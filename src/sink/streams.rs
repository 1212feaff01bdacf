//! Streams in shared memory, as sinks. A camera's are its result; that of a film lies in files, and whatever becomes of
//! the streams beside them, the film is seen to its end.

use std::cell::RefCell;
use std::rc::Rc;
use std::time::{Duration, Instant};

use edgecap_client::LinkError;

use super::{Packet, Sink, SinkError, Sinks};

/// How often a stream that failed is tried again.
const AGAIN: Duration = Duration::from_secs(1);

/// Opens a stream of the camera that it is given.
type Open<S> = fn(&str) -> Result<S, LinkError>;

/// Opens the streams of one input.
#[derive(Debug)]
pub struct Streams {
    camera: String,
    /// They are the result.
    are_result: bool,
    /// Somebody waits for them.
    are_wanted: bool,
    shared: Rc<RefCell<Shared>>,
}

/// What the streams of one input have in common.
#[derive(Debug, Default)]
struct Shared {
    /// Why they fail, as was said.
    said: Option<String>,
    /// Another process publishes under this name. Nothing of ours belongs beside it.
    is_taken: bool,
}

impl Shared {
    /// A stream fails. It is said where that `is_news` of this one, and the others have not failed of the same.
    fn fails(&mut self, why: &SinkError, is_news: bool) {
        let told = why.to_string();
        if is_news && self.said.as_ref() != Some(&told) {
            tracing::warn!("nobody can watch this run: {told}");
            self.said = Some(told);
        }
        self.is_taken |= matches!(why, SinkError::Link(LinkError::Busy { .. }));
    }
}

impl Streams {
    /// Of a camera: their failures are errors.
    pub fn of_camera(camera: &str) -> Self {
        Self {
            camera: camera.to_owned(),
            are_result: true,
            are_wanted: true,
            shared: Rc::default(),
        }
    }

    /// Of a file: where they fail, that is said once, and they are tried again. What the user has named must be there
    /// at the start.
    pub fn of_file(camera: &str, is_named: bool) -> Self {
        Self {
            are_result: false,
            are_wanted: is_named,
            ..Self::of_camera(camera)
        }
    }

    /// Takes in whether the name is `free`, before any stream is opened. Where it is not there are none, which is said.
    ///
    /// # Errors
    /// That it is not, unless it can be done without.
    pub fn expect(&self, free: Result<(), LinkError>) -> Result<(), LinkError> {
        match free {
            Err(e) if self.are_wanted => Err(e),
            Err(e) => {
                self.shared.borrow_mut().fails(&e.into(), true);
                Ok(())
            }
            Ok(()) => Ok(()),
        }
    }

    /// Adds one; whether it is there.
    ///
    /// # Errors
    /// Those of `open`, unless it can be done without.
    pub fn add_to<M, S: Sink<M> + 'static>(
        &self,
        sinks: &mut Sinks<M>,
        open: Open<S>,
    ) -> Result<bool, LinkError> {
        if self.shared.borrow().is_taken {
            return Ok(false);
        }
        let opened = match open(&self.camera) {
            Err(e) if self.are_wanted => return Err(e),
            Ok(stream) if self.are_result => {
                sinks.push(stream);
                return Ok(true);
            }
            opened => opened,
        };
        let stream = self.patient(open, opened);
        let is_there = stream.stream.is_some();
        sinks.push(stream);
        Ok(is_there)
    }

    fn patient<S>(&self, open: Open<S>, opened: Result<S, LinkError>) -> PatientStream<S> {
        let mut stream = PatientStream {
            camera: self.camera.clone(),
            open,
            stream: None,
            again: None,
            shared: Rc::clone(&self.shared),
        };
        match opened {
            Ok(opened) => stream.stream = Some(opened),
            Err(e) => stream.fails(Instant::now(), e.into()),
        }
        stream
    }
}

/// Publishes what can be published.
#[derive(Debug)]
struct PatientStream<S> {
    camera: String,
    open: Open<S>,
    /// `None` where it has to be opened.
    stream: Option<S>,
    /// When it is tried again, where it has failed.
    again: Option<Instant>,
    shared: Rc<RefCell<Shared>>,
}

impl<S> PatientStream<S> {
    fn take_at<M>(&mut self, now: Instant, packet: &Packet<'_, M>)
    where
        S: Sink<M>,
    {
        if self.shared.borrow().is_taken || self.again.is_some_and(|again| now < again) {
            return;
        }
        match self.publish(packet) {
            Ok(()) if self.again.take().is_some() => {
                if self.shared.borrow_mut().said.take().is_some() {
                    tracing::warn!("this run can be watched again");
                }
            }
            Ok(()) => {}
            Err(e) => self.fails(now, e),
        }
    }

    fn publish<M>(&mut self, packet: &Packet<'_, M>) -> Result<(), SinkError>
    where
        S: Sink<M>,
    {
        if self.stream.is_none() {
            self.stream = Some((self.open)(&self.camera)?);
        }
        match &mut self.stream {
            Some(stream) => stream.take(packet),
            None => Ok(()),
        }
    }

    fn fails(&mut self, now: Instant, why: SinkError) {
        let is_news = self.again.is_none();
        self.shared.borrow_mut().fails(&why, is_news);
        self.again = Some(now + AGAIN);
    }
}

impl<M, S: Sink<M>> Sink<M> for PatientStream<S> {
    fn take(&mut self, packet: &Packet<'_, M>) -> Result<(), SinkError> {
        self.take_at(Instant::now(), packet);
        Ok(())
    }

    fn quiet(&mut self) {
        if let Some(stream) = &mut self.stream {
            stream.quiet();
        }
    }

    fn end(&mut self) -> Result<(), SinkError> {
        if let Some(stream) = &mut self.stream
            && let Err(e) = stream.end()
        {
            self.fails(Instant::now(), e);
        }
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<Option<String>, SinkError> {
        // Its end was told before, or nobody is there to be told.
        let _ = self.stream.map(|stream| Box::new(stream).finish());
        Ok(None)
    }
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use super::*;
    use crate::message::BodyFrame;

    thread_local! {
        static FAILURE: Cell<Option<fn() -> LinkError>> = const { Cell::new(None) };
        static PUBLISHED: Cell<u32> = const { Cell::new(0) };
    }

    /// Fails as [`FAILURE`] says.
    #[derive(Debug)]
    struct Stream;

    fn works() -> Result<(), LinkError> {
        FAILURE.get().map_or(Ok(()), |failure| Err(failure()))
    }

    fn open(_: &str) -> Result<Stream, LinkError> {
        works().map(|()| Stream)
    }

    impl Sink<BodyFrame> for Stream {
        fn take(&mut self, _: &Packet<'_, BodyFrame>) -> Result<(), SinkError> {
            works()?;
            PUBLISHED.set(PUBLISHED.get() + 1);
            Ok(())
        }

        fn end(&mut self) -> Result<(), SinkError> {
            Ok(works()?)
        }

        fn finish(self: Box<Self>) -> Result<Option<String>, SinkError> {
            Ok(works().map(|()| None)?)
        }
    }

    fn gone() -> LinkError {
        LinkError::NoPlace {
            folder: "/run/user/1000/edgecap".into(),
            cause: "gone".into(),
        }
    }

    fn busy() -> LinkError {
        LinkError::Busy {
            service: "edgecap/v2/clip/bodies".into(),
        }
    }

    fn with_packet(look: impl FnOnce(&Packet<'_, BodyFrame>)) {
        look(&Packet {
            message: &BodyFrame::default(),
            source: "",
            picture: None,
        });
    }

    #[test]
    fn a_stream_of_a_film_that_fails_is_tried_again_after_a_second_and_ends_nothing() {
        for fails_at_first in [false, true] {
            PUBLISHED.set(0);
            FAILURE.set(fails_at_first.then_some(gone));
            let streams = Streams::of_file("clip", false);
            let mut stream = streams.patient(open, open("clip"));
            let start = Instant::now() + AGAIN;
            with_packet(|packet| {
                FAILURE.set(Some(gone));
                stream.take_at(start, packet);
                assert!(streams.shared.borrow().said.is_some());
                FAILURE.set(None);
                stream.take_at(start + AGAIN / 2, packet);
                assert_eq!(PUBLISHED.get(), 0, "not yet");
                stream.take_at(start + AGAIN, packet);
                stream.take_at(start + AGAIN, packet);
                assert_eq!(PUBLISHED.get(), 2);
                assert!(streams.shared.borrow().said.is_none(), "it is told");
            });
            FAILURE.set(Some(gone));
            assert!(stream.end().is_ok());
            assert!(Box::new(stream).finish().is_ok());
        }
    }

    #[test]
    fn where_streams_are_asked_for_their_failure_is_one() {
        let mut sinks = Sinks::default();
        let camera = Streams::of_camera("hall");
        FAILURE.set(Some(gone));
        assert!(camera.add_to(&mut sinks, open).is_err());
        let named = Streams::of_file("clip", true);
        assert!(named.add_to(&mut sinks, open).is_err());
        FAILURE.set(None);
        assert!(camera.add_to(&mut sinks, open).unwrap());
        FAILURE.set(Some(gone));
        with_packet(|packet| assert!(sinks.take(packet).is_err()));
    }

    #[test]
    fn beside_streams_of_another_process_there_are_none_of_ours() {
        PUBLISHED.set(0);
        let mut sinks = Sinks::default();
        let streams = Streams::of_file("clip", false);
        FAILURE.set(Some(busy));
        assert!(!streams.add_to(&mut sinks, open).unwrap());
        FAILURE.set(None);
        assert!(!streams.add_to(&mut sinks, open).unwrap());
        with_packet(|packet| assert!(sinks.take(packet).is_ok()));
        assert_eq!(PUBLISHED.get(), 0);
        // Seen beforehand, too, though no two have the same stream.
        let (streams, mut sinks) = (Streams::of_file("clip", false), Sinks::default());
        assert!(streams.expect(Err(busy())).is_ok());
        assert!(!streams.add_to(&mut sinks, open).unwrap() && sinks.is_empty());
        assert!(Streams::of_file("clip", true).expect(Err(busy())).is_err());
        assert!(Streams::of_camera("hall").expect(Err(busy())).is_err());
    }
}
