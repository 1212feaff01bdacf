//! Sources that may keep silent for ever: read in a thread of their own, so that whoever waits can be told to stop.

use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::time::Duration;

use super::error::CaptureError;
use super::frame::Frame;
use super::rate::Rate;
use super::source::Source;

/// Longest that one step takes while nothing comes.
const STEP: Duration = Duration::from_millis(100);
/// Pictures read ahead.
const AHEAD: usize = 2;

/// A source behind a thread. The thread ends with its source, with this value, or, where it waits for ever, with the
/// process.
pub struct PipeSource {
    name: String,
    /// Known once the header was read.
    rate: Rate,
    pictures: Receiver<Result<Frame, CaptureError>>,
    /// Buffers of pictures that were taken, to be filled again.
    used: SyncSender<Frame>,
}

impl PipeSource {
    /// Opens and reads in another thread; what fails there is said by [`Source::next_into`].
    pub fn start<O>(name: String, open: O) -> Self
    where
        O: FnOnce() -> Result<Box<dyn Source>, CaptureError> + Send + 'static,
    {
        let (give, pictures) = sync_channel(AHEAD);
        let (used, returned) = sync_channel(AHEAD + 1);
        let rate = Rate::default();
        let known = rate.clone();
        let refused = give.clone();
        let work = move || read(open, &known, &give, &returned);
        if let Err(e) = std::thread::Builder::new().name("pipe".into()).spawn(work) {
            let _ = refused.send(Err(CaptureError::Unavailable {
                what: name.clone(),
                reason: format!(
                    "expected a thread that reads it, found none to be had ({e}): raise TasksMax= of the service, the \
                     container's limit of processes or 'ulimit -u'"
                ),
            }));
        }
        Self {
            name,
            rate,
            pictures,
            used,
        }
    }
}

/// Reads until the source has ended or nobody wants more.
fn read<O>(
    open: O,
    rate: &Rate,
    give: &SyncSender<Result<Frame, CaptureError>>,
    returned: &Receiver<Frame>,
) where
    O: FnOnce() -> Result<Box<dyn Source>, CaptureError>,
{
    let mut source = match open() {
        Ok(source) => source,
        Err(e) => {
            let _ = give.send(Err(e));
            return;
        }
    };
    rate.tell(source.fps());
    loop {
        let mut frame = returned.try_recv().unwrap_or_default();
        let (item, goes_on) = match source.next_into(&mut frame) {
            Ok(true) => (Ok(frame), true),
            Ok(false) => return,
            Err(e) => {
                let goes_on = e.is_skippable();
                (Err(e), goes_on)
            }
        };
        if give.send(item).is_err() || !goes_on {
            return;
        }
    }
}

impl Source for PipeSource {
    fn next_into(&mut self, frame: &mut Frame) -> Result<bool, CaptureError> {
        match self.pictures.recv_timeout(STEP) {
            Ok(picture) => {
                let old = std::mem::replace(frame, picture?);
                // A full queue of buffers needs no more.
                let _ = self.used.try_send(old);
                Ok(true)
            }
            Err(RecvTimeoutError::Disconnected) => Ok(false),
            Err(RecvTimeoutError::Timeout) => Err(CaptureError::NoPictureYet {
                device: self.name.clone(),
                reason: "nothing has come yet".into(),
                is_away: false,
            }),
        }
    }

    fn fps(&self) -> Option<f64> {
        self.rate.get()
    }

    fn rate(&self) -> Rate {
        self.rate.clone()
    }

    fn name(&self) -> &str {
        &self.name
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Film;

    impl Source for Film {
        fn next_into(&mut self, _: &mut Frame) -> Result<bool, CaptureError> {
            Ok(true)
        }

        fn fps(&self) -> Option<f64> {
            Some(60.0)
        }

        fn name(&self) -> &str {
            "film"
        }
    }

    #[test]
    fn who_asks_for_the_rate_before_the_header_has_come_knows_it_with_the_first_picture() {
        let (begin, begins) = sync_channel::<()>(1);
        let open = move || {
            begins.recv().unwrap();
            Ok(Box::new(Film) as Box<dyn Source>)
        };
        let mut pipe = PipeSource::start("pipe".to_owned(), open);
        let rate = pipe.rate();
        assert_eq!((rate.get(), pipe.fps()), (None, None));
        begin.send(()).unwrap();
        let mut frame = Frame::default();
        while let Err(e) = pipe.next_into(&mut frame) {
            assert!(matches!(e, CaptureError::NoPictureYet { .. }), "{e}");
        }
        assert_eq!((rate.get(), pipe.fps()), (Some(60.0), Some(60.0)));
    }
}
