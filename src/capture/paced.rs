//! A film played as a camera would show it, over and over: at its own rate, pictures lost while nobody looks. A
//! camera's stand-in.

use std::time::{Duration, Instant};

use super::error::CaptureError;
use super::frame::Frame;
use super::raw::{RawDecoder, RawPicture};
use super::source::Source;
use crate::camera::Clock;

/// Longest that one step takes.
const STEP: Duration = Duration::from_millis(250);
/// Time between the last picture and the first one again, for films that do not say their rate.
const DEFAULT_FPS: f64 = 30.0;

/// A film in the time of a clock.
pub struct PacedSource<O, C> {
    open: O,
    film: Box<dyn Source>,
    clock: C,
    /// The clock's and the monotonic time when the film began.
    began: Option<(Instant, u64)>,
    /// What is added to a picture's time and sequence: the films played before.
    offset: (u64, u64),
    /// The next picture, not due yet.
    next: RawPicture,
    has_next: bool,
    /// For who wants the pictures decoded.
    decoder: RawDecoder,
    raw: RawPicture,
}

impl<O, C> PacedSource<O, C>
where
    O: FnMut() -> Result<Box<dyn Source>, CaptureError>,
    C: Clock,
{
    /// Plays what `open` opens, from the first call on.
    ///
    /// # Errors
    /// As `open`.
    pub fn new(mut open: O, clock: C) -> Result<Self, CaptureError> {
        let film = open()?;
        Ok(Self {
            open,
            film,
            clock,
            began: None,
            offset: (0, 0),
            next: RawPicture::default(),
            has_next: false,
            decoder: RawDecoder::default(),
            raw: RawPicture::default(),
        })
    }

    /// Reads the next picture, from the beginning again where the film has ended; `false` for a film without pictures.
    fn read(&mut self) -> Result<bool, CaptureError> {
        let last = (self.next.time_ns, self.next.sequence);
        if !self.film.next_raw(&mut self.next)? {
            let interval = 1e9 / self.film.fps().unwrap_or(DEFAULT_FPS);
            self.offset = (last.0 + interval as u64, last.1 + 1);
            self.film = (self.open)()?;
            if !self.film.next_raw(&mut self.next)? {
                return Ok(false);
            }
        }
        self.next.time_ns += self.offset.0;
        self.next.sequence += self.offset.1;
        Ok(true)
    }
}

impl<O, C> Source for PacedSource<O, C>
where
    O: FnMut() -> Result<Box<dyn Source>, CaptureError> + Send,
    C: Clock,
{
    fn next_into(&mut self, frame: &mut Frame) -> Result<bool, CaptureError> {
        let mut raw = std::mem::take(&mut self.raw);
        let decoded = self.next_raw(&mut raw).and_then(|more| {
            if more {
                let drawn = self.decoder.decode(&mut raw, frame);
                drawn.map_err(|reason| CaptureError::Picture {
                    input: format!("{}, frame {}", self.name(), raw.sequence),
                    reason,
                })?;
            }
            Ok(more)
        });
        self.raw = raw;
        decoded
    }

    /// The newest picture that is due; of those before it none is decoded.
    fn next_raw(&mut self, raw: &mut RawPicture) -> Result<bool, CaptureError> {
        let (began, began_ns) = *self
            .began
            .get_or_insert_with(|| (self.clock.now(), crate::camera::monotonic_ns()));
        if !self.has_next && !self.read()? {
            return Ok(false);
        }
        self.has_next = true;
        let mut now = self.clock.now() - began;
        let due = Duration::from_nanos(self.next.time_ns);
        if now < due {
            self.clock.sleep((due - now).min(STEP));
            now = self.clock.now() - began;
            if now < due {
                return Err(CaptureError::NoPictureYet {
                    device: self.film.name().to_owned(),
                    reason: "the next picture is not due yet".into(),
                });
            }
        }
        loop {
            std::mem::swap(raw, &mut self.next);
            (self.next.time_ns, self.next.sequence) = (raw.time_ns, raw.sequence);
            self.has_next = self.read()?;
            if !self.has_next || Duration::from_nanos(self.next.time_ns) > now {
                break;
            }
        }
        raw.time_ns += began_ns;
        Ok(true)
    }

    fn fps(&self) -> Option<f64> {
        self.film.fps()
    }

    fn is_live(&self) -> bool {
        true
    }

    fn name(&self) -> &str {
        self.film.name()
    }

    fn picture(&self) -> String {
        self.film.picture()
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::sync::Mutex;

    use super::*;

    /// Three pictures, 100 ms apart.
    struct Film(u64);

    impl Source for Film {
        fn next_into(&mut self, frame: &mut Frame) -> Result<bool, CaptureError> {
            if self.0 == 3 {
                return Ok(false);
            }
            (frame.sequence, frame.time_ns) = (self.0, self.0 * 100_000_000);
            self.0 += 1;
            Ok(true)
        }

        fn fps(&self) -> Option<f64> {
            Some(10.0)
        }

        fn name(&self) -> &str {
            "film"
        }
    }

    #[derive(Clone)]
    struct Turned(Arc<Mutex<Instant>>);

    impl Clock for Turned {
        fn now(&self) -> Instant {
            *self.0.lock().unwrap()
        }

        fn sleep(&self, duration: Duration) {
            *self.0.lock().unwrap() += duration;
        }
    }

    #[test]
    fn pictures_come_when_they_are_due_for_ever_and_late_ones_are_lost() {
        let clock = Turned(Arc::new(Mutex::new(Instant::now())));
        let start = clock.now();
        let open = || Ok(Box::new(Film(0)) as Box<dyn Source>);
        let mut paced = PacedSource::new(open, clock.clone()).unwrap();
        let mut frame = Frame::default();
        let mut seen = Vec::new();
        while seen.len() < 6 {
            assert!(paced.next_into(&mut frame).unwrap());
            let ms = (clock.now() - start).as_millis();
            seen.push((frame.sequence, ms));
        }
        assert_eq!(
            seen,
            [(0, 0), (1, 100), (2, 200), (3, 300), (4, 400), (5, 500)]
        );
        clock.sleep(Duration::from_millis(350));
        assert!(paced.next_into(&mut frame).unwrap());
        assert_eq!(frame.sequence, 8, "850 ms after the start");
        assert!(paced.is_live());
    }
}
