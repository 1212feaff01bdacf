//! A film played as a camera would show it, over and over: at its own rate, pictures lost while nobody looks. A
//! camera's stand-in.

use std::time::{Duration, Instant};

use super::drawn::{Drawing, next_drawn};
use super::error::CaptureError;
use super::frame::Frame;
use super::raw::RawPicture;
use super::source::Source;
use crate::camera::Clock;

/// Longest that one step takes, waiting or catching up.
const STEP: Duration = Duration::from_millis(250);
/// Time between the last picture and the first one again, for films that do not say their rate.
const DEFAULT_FPS: f64 = 30.0;
/// Least time between two pictures: some films say that they have billions a second.
const LEAST_INTERVAL_NS: u64 = 1_000_000;

/// A film in the time of a clock.
pub struct PacedSource<O, C> {
    open: O,
    film: Box<dyn Source>,
    clock: C,
    /// The clock's and the monotonic time when the film began.
    began: Option<(Instant, u64)>,
    /// What is added to a picture's time and sequence: the films played before.
    offset: (u64, u64),
    /// Time and sequence of the picture that was read last, with all that was added to them.
    last: Option<(u64, u64)>,
    /// The next picture, not due yet, and where it comes from.
    next: RawPicture,
    next_from: String,
    has_next: bool,
    /// Where the picture comes from that was given last; none was at first.
    given_from: Option<String>,
    /// Whether a picture could be read since the film began.
    has_read: bool,
    /// Why the film's first picture could not be read, where none could be since it began.
    damaged: Option<String>,
    /// Why there is no picture after the one that was given last.
    failed: Option<CaptureError>,
    /// Whether it was said that the film is cut off.
    has_told_of_cut: bool,
    /// For who wants the pictures decoded.
    drawing: Drawing,
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
            last: None,
            next: RawPicture::default(),
            next_from: String::new(),
            has_next: false,
            given_from: None,
            has_read: false,
            damaged: None,
            failed: None,
            has_told_of_cut: false,
            drawing: Drawing::default(),
        })
    }

    /// Reads the next picture, from the beginning again where the film has ended; `false` for a film without pictures.
    fn read(&mut self) -> Result<bool, CaptureError> {
        self.has_next = false;
        if !self.read_on()? {
            if let Some(first) = self.damaged.take() {
                // Begun anew, it would be read over and over without a pause.
                return Err(CaptureError::data(
                    self.film.name(),
                    format!("none of its pictures can be read; the first: {first}"),
                ));
            }
            let interval = 1e9 / self.film.fps().unwrap_or(DEFAULT_FPS);
            self.offset = self.last.map_or((0, 0), |(time, n)| {
                (time.saturating_add(interval as u64), n + 1)
            });
            if !self.film.rewind()? {
                self.film = (self.open)()?;
            }
            self.has_read = false;
            if !self.read_film()? {
                return Ok(false);
            }
        }
        self.next_from = self.film.picture();
        let next = &mut self.next;
        next.time_ns = next.time_ns.saturating_add(self.offset.0);
        next.sequence += self.offset.1;
        if let Some((time, _)) = self.last {
            next.time_ns = next.time_ns.max(time.saturating_add(LEAST_INTERVAL_NS));
        }
        self.last = Some((next.time_ns, next.sequence));
        self.has_next = true;
        Ok(true)
    }

    /// Reads the next picture; `false` where the film has ended, or was cut off after its first picture.
    fn read_on(&mut self) -> Result<bool, CaptureError> {
        match self.read_film() {
            Err(e @ CaptureError::Data { .. }) if self.last.is_some() => {
                if !std::mem::replace(&mut self.has_told_of_cut, true) {
                    tracing::warn!("the film begins anew before its end each time: {e}");
                }
                Ok(false)
            }
            read => read,
        }
    }

    /// Reads the next picture, and notes whether the film has had one since it began.
    fn read_film(&mut self) -> Result<bool, CaptureError> {
        let read = self.film.next_raw(&mut self.next);
        match &read {
            Ok(true) => (self.has_read, self.damaged) = (true, None),
            Err(e @ CaptureError::Picture { .. }) if !self.has_read && self.damaged.is_none() => {
                self.damaged = Some(e.to_string());
            }
            _ => {}
        }
        read
    }

    /// Moves the film's beginning, so that a picture that is late is due now: what cannot be read as fast as it plays
    /// would never catch up.
    fn wait_for(&mut self, picture_ns: u64) {
        let now = self.clock.now();
        if let Some((began, began_ns)) = &mut self.began {
            let late = (now - *began).saturating_sub(Duration::from_nanos(picture_ns));
            *began += late;
            *began_ns += late.as_nanos() as u64;
        }
    }
}

impl<O, C> Source for PacedSource<O, C>
where
    O: FnMut() -> Result<Box<dyn Source>, CaptureError> + Send,
    C: Clock,
{
    fn next_into(&mut self, frame: &mut Frame) -> Result<bool, CaptureError> {
        next_drawn(self, |own| &mut own.drawing, frame)
    }

    /// The newest picture that is due, of those that can be read within a step; those before it are not decoded. Where
    /// the film cannot be read as fast as it plays it goes on from there, later than it should.
    fn next_raw(&mut self, raw: &mut RawPicture) -> Result<bool, CaptureError> {
        if let Some(e) = self.failed.take() {
            return Err(e);
        }
        let start = self.clock.now();
        let (began, _) = *self
            .began
            .get_or_insert_with(|| (start, crate::camera::monotonic_ns()));
        if !self.has_next && !self.read()? {
            return Ok(false);
        }
        let mut now = self.clock.now() - began;
        let due = Duration::from_nanos(self.next.time_ns);
        if now < due {
            self.clock.sleep((due - now).min(STEP));
            now = self.clock.now() - began;
            if now < due {
                return Err(CaptureError::NoPictureYet {
                    device: self.film.name().to_owned(),
                    reason: "the next picture is not due yet".into(),
                    is_away: false,
                });
            }
        }
        let until = self.clock.now() + STEP;
        loop {
            std::mem::swap(raw, &mut self.next);
            self.given_from = Some(std::mem::take(&mut self.next_from));
            match self.read() {
                Ok(true) if Duration::from_nanos(self.next.time_ns) > now => break,
                Ok(true) if self.clock.now() >= until => {
                    self.wait_for(raw.time_ns);
                    break;
                }
                Ok(true) => {}
                Ok(false) => break,
                // The picture before it is whole; the next call tells.
                Err(e) => {
                    self.failed = Some(e);
                    break;
                }
            }
        }
        let began_ns = self.began.map_or(0, |(_, began_ns)| began_ns);
        raw.time_ns = raw.time_ns.saturating_add(began_ns);
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

    /// The film has read one picture more than it has given.
    fn picture(&self) -> String {
        let given = self.given_from.as_deref();
        given.unwrap_or(self.name()).to_owned()
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::sync::Mutex;

    use super::*;

    /// Three pictures.
    struct Film {
        count: u64,
        /// Between two pictures.
        interval_ns: u64,
        /// What reading one takes.
        reading: Duration,
        /// Those that cannot be read.
        damaged: &'static [u64],
        /// The first that is missing.
        cut: Option<u64>,
        clock: Turned,
    }

    impl Source for Film {
        fn next_into(&mut self, frame: &mut Frame) -> Result<bool, CaptureError> {
            if self.count == 3 {
                return Ok(false);
            }
            self.clock.sleep(self.reading);
            let n = self.count;
            if self.cut == Some(n) {
                return Err(CaptureError::data("film", "cut off"));
            }
            self.count += 1;
            if self.damaged.contains(&n) {
                return Err(CaptureError::Picture {
                    input: format!("picture {n}"),
                    reason: "damaged".into(),
                });
            }
            (frame.sequence, frame.time_ns) = (n, n * self.interval_ns);
            Ok(true)
        }

        fn fps(&self) -> Option<f64> {
            Some(1e9 / self.interval_ns as f64)
        }

        fn name(&self) -> &str {
            "film"
        }

        fn picture(&self) -> String {
            format!("picture {}", self.count - 1)
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

    type Opening = Box<dyn FnMut() -> Result<Box<dyn Source>, CaptureError> + Send>;

    /// A film over and over, and its clock.
    fn paced(
        interval_ns: u64,
        reading: Duration,
        damaged: &'static [u64],
    ) -> (PacedSource<Opening, Turned>, Turned) {
        let clock = Turned(Arc::new(Mutex::new(Instant::now())));
        let of_film = clock.clone();
        let open: Opening = Box::new(move || {
            Ok(Box::new(Film {
                count: 0,
                interval_ns,
                reading,
                damaged,
                cut: None,
                clock: of_film.clone(),
            }))
        });
        let paced = PacedSource::new(open, clock.clone()).unwrap();
        (paced, clock)
    }

    /// A film that is cut off before this picture.
    fn cut(at: u64) -> PacedSource<Opening, Turned> {
        let clock = Turned(Arc::new(Mutex::new(Instant::now())));
        let of_film = clock.clone();
        let open: Opening = Box::new(move || {
            Ok(Box::new(Film {
                count: 0,
                interval_ns: TENTH,
                reading: Duration::ZERO,
                damaged: &[],
                cut: Some(at),
                clock: of_film.clone(),
            }))
        });
        PacedSource::new(open, clock).unwrap()
    }

    const TENTH: u64 = 100_000_000;

    #[test]
    fn pictures_come_when_they_are_due_for_ever_and_late_ones_are_lost() {
        let (mut paced, clock) = paced(TENTH, Duration::ZERO, &[]);
        let start = clock.now();
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

    #[test]
    fn a_film_that_is_read_more_slowly_than_it_plays_goes_on_later() {
        let reading = Duration::from_millis(150);
        let (mut paced, clock) = paced(TENTH, reading, &[]);
        let mut frame = Frame::default();
        let (mut before, mut seen) = (0, 0);
        for _ in 0..100 {
            let start = clock.now();
            let given = paced.next_into(&mut frame);
            let took = clock.now() - start;
            assert!(took <= STEP + STEP + reading, "{took:?}");
            match given {
                Ok(more) => {
                    assert!(more && frame.time_ns > before);
                    (before, seen) = (frame.time_ns, seen + 1);
                }
                Err(e) => assert!(matches!(e, CaptureError::NoPictureYet { .. }), "{e}"),
            }
        }
        assert!(seen > 50, "{seen}");
        // The newest picture is of now, not of how far the film should be.
        let (began, began_ns) = paced.began.unwrap();
        let age = (clock.now() - began).as_nanos() as u64 + began_ns - before;
        assert!(age <= 500_000_000, "{age}");
    }

    #[test]
    fn a_film_that_says_it_has_billions_of_pictures_a_second_plays() {
        let (mut paced, clock) = paced(0, Duration::ZERO, &[]);
        let mut frame = Frame::default();
        for _ in 0..3 {
            clock.sleep(Duration::from_millis(100));
            assert!(paced.next_into(&mut frame).unwrap());
        }
        assert_eq!(frame.sequence, 200, "a thousand a second");
    }

    #[test]
    fn a_film_that_says_it_lasts_for_centuries_plays() {
        let half = u64::MAX / 2;
        let (mut paced, clock) = paced(half, Duration::ZERO, &[]);
        let mut frame = Frame::default();
        for sequence in 0..3 {
            assert!(paced.next_into(&mut frame).unwrap());
            assert_eq!(frame.sequence, sequence);
            clock.sleep(Duration::from_nanos(half));
        }
        // The one after its last has been read.
        assert_eq!(paced.last, Some((u64::MAX, 3)));
    }

    #[test]
    fn a_damaged_picture_is_told_once_and_none_comes_twice() {
        let (mut paced, _) = paced(TENTH, Duration::ZERO, &[1]);
        let mut frame = Frame::default();
        let mut seen = Vec::new();
        while seen.len() < 6 {
            seen.push(match paced.next_into(&mut frame) {
                Ok(more) => more.then_some(frame.sequence),
                Err(CaptureError::NoPictureYet { .. }) => continue,
                Err(e) => {
                    assert!(e.is_skippable(), "{e}");
                    None
                }
            });
        }
        assert_eq!(seen, [Some(0), None, Some(2), Some(3), None, Some(5)]);
    }

    #[test]
    fn pictures_are_named_as_they_are_given() {
        let (mut paced, _) = paced(TENTH, Duration::ZERO, &[1]);
        assert_eq!(paced.picture(), "film");
        let mut raw = RawPicture::default();
        let mut seen = Vec::new();
        while seen.len() < 4 {
            match paced.next_raw(&mut raw) {
                Ok(more) => {
                    assert!(more);
                    seen.push(paced.picture());
                }
                Err(e) => assert!(e.is_skippable(), "{e}"),
            }
        }
        assert_eq!(seen, ["picture 0", "picture 2", "picture 0", "picture 2"]);
    }

    #[test]
    fn a_film_of_which_no_picture_can_be_read_does_not_begin_anew() {
        let (mut paced, _) = paced(TENTH, Duration::ZERO, &[0, 1, 2]);
        let mut frame = Frame::default();
        for _ in 0..3 {
            let damaged = paced.next_into(&mut frame).unwrap_err();
            assert!(damaged.is_skippable(), "{damaged}");
        }
        let refused = paced.next_into(&mut frame).unwrap_err();
        assert!(!refused.is_skippable());
        assert_eq!(
            refused.to_string(),
            "film: none of its pictures can be read; the first: picture 0: damaged"
        );
    }

    #[test]
    fn a_film_that_is_cut_off_begins_anew() {
        let mut paced = cut(2);
        let mut frame = Frame::default();
        let mut seen = Vec::new();
        while seen.len() < 5 {
            match paced.next_into(&mut frame) {
                Ok(more) => seen.push(more.then_some(frame.sequence)),
                Err(e) => assert!(e.is_skippable(), "{e}"),
            }
        }
        assert_eq!(seen, [Some(0), Some(1), Some(2), Some(3), Some(4)]);
        assert!(paced.has_told_of_cut);
        // One without a picture would begin anew for ever.
        let refused = cut(0).next_into(&mut frame).unwrap_err();
        assert!(!refused.is_skippable(), "{refused}");
    }
}
