//! When bodies are published: with every observation, or at a rate of their own.

use std::time::{Duration, Instant};

use edgecap_client::message::{BodyFrame, FLAG_FILE_TIME, ObservationFrame};

use crate::camera::monotonic_ns;
use crate::counted::counted;

/// What was seen longer ago is history, not news: it waited while a process stood still. Nor is it extrapolated
/// further.
const STALE: Duration = Duration::from_secs(1);
/// Where nothing but history has come for so long it is no queue that empties.
const NO_NEWS: Duration = Duration::from_secs(5);

/// Leaves out observations that waited somewhere until they were no news any more.
#[derive(Debug, Default)]
pub struct Fresh {
    /// Camera that sends them, where there are several.
    camera: Option<String>,
    stale: u64,
    /// When the first of them came, nanoseconds of the monotonic clock.
    since: u64,
    /// It was said that nothing else comes.
    said: bool,
}

/// What is to be said of observations that were left out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Word {
    /// So many, before the first that is news again.
    LeftOut(u64),
    /// Nothing else has come for [`NO_NEWS`].
    NoNews,
}

impl Fresh {
    /// Of one of several cameras, which what is said names.
    pub fn of(camera: &str) -> Self {
        Self {
            camera: Some(camera.to_owned()),
            ..Self::default()
        }
    }

    /// What a line of the log begins with.
    fn whose(&self) -> String {
        let camera = self.camera.as_ref();
        camera.map_or_else(String::new, |name| format!("{name}: "))
    }

    /// Whether an observation is news; says how many were not, or that none is. One of a file has a time of its own.
    pub fn is_news(&mut self, frame: &ObservationFrame) -> bool {
        let (is_news, word) = self.look(frame, monotonic_ns());
        let whose = self.whose();
        match word {
            Some(Word::LeftOut(stale)) => {
                let stale = counted(stale, "observation", "observations");
                tracing::warn!("{whose}{stale} of more than {STALE:?} ago left out");
            }
            Some(Word::NoNews) => tracing::warn!(
                "{whose}nothing but observations of more than {STALE:?} ago for {NO_NEWS:?}, all left out: expected times of this machine's monotonic clock, and pictures no older; look at what publishes them"
            ),
            None => {}
        }
        is_news
    }

    /// The same at `now`, nanoseconds of the monotonic clock, and what is to be said.
    fn look(&mut self, frame: &ObservationFrame, now: u64) -> (bool, Option<Word>) {
        let newest = frame.publish_ns.max(frame.capture_ns);
        let age = Duration::from_nanos(now.saturating_sub(newest));
        if frame.flags & FLAG_FILE_TIME != 0 || age <= STALE {
            self.said = false;
            let stale = std::mem::take(&mut self.stale);
            return (true, (stale > 0).then_some(Word::LeftOut(stale)));
        }
        if self.stale == 0 {
            self.since = now;
        }
        self.stale += 1;
        let lasts = Duration::from_nanos(now.saturating_sub(self.since));
        if self.said || lasts < NO_NEWS {
            return (false, None);
        }
        self.said = true;
        (false, Some(Word::NoNews))
    }
}

/// When bodies are due.
#[derive(Debug)]
pub struct Pace {
    period: Option<Duration>,
    next: Instant,
    /// When bodies were fitted last; not those of a file, whose clock is not ours to extrapolate on.
    fitted: Option<Instant>,
}

impl Pace {
    /// So many times a second, or with every observation.
    pub fn new(rate: Option<u16>) -> Self {
        Self {
            period: rate.map(|hz| Duration::from_secs(1) / u32::from(hz)),
            next: Instant::now(),
            fitted: None,
        }
    }

    /// How long an observation may be waited for, `longest` at most: as long where no bodies are due without one.
    pub fn patience(&self, longest: Duration, now: Instant) -> Duration {
        if self.period.is_none() || !self.is_known(now) {
            return longest;
        }
        self.next.saturating_duration_since(now).min(longest)
    }

    /// Bodies have been fitted; whether they are published as they are.
    pub fn fitted(&mut self, bodies: &BodyFrame, now: Instant) -> bool {
        let of_file = bodies.flags & FLAG_FILE_TIME != 0;
        self.fitted = (!of_file).then_some(now);
        self.period.is_none() || of_file
    }

    /// Whether it is time to extrapolate the bodies fitted last. What was missed is not made up for.
    pub fn is_due(&mut self, now: Instant) -> bool {
        let Some(period) = self.period else {
            return false;
        };
        if now < self.next || !self.is_known(now) {
            return false;
        }
        self.next += period;
        if self.next <= now {
            self.next = now + period;
        }
        true
    }

    /// Whether bodies were fitted so recently that they may be extrapolated.
    fn is_known(&self, now: Instant) -> bool {
        self.fitted
            .is_some_and(|t| now.saturating_duration_since(t) < STALE)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LONGEST: Duration = Duration::from_millis(200);

    #[test]
    fn whoever_is_late_publishes_once_and_goes_on_from_there() {
        let bodies = BodyFrame::default();
        let mut pace = Pace::new(Some(100));
        let start = pace.next;
        let at = |ms: u64| start + Duration::from_millis(ms);
        pace.fitted(&bodies, at(0));
        assert!(pace.is_due(at(0)));
        assert!(!pace.is_due(at(9)));
        // A little late: the pace stays.
        assert!(pace.is_due(at(14)));
        assert_eq!(pace.patience(LONGEST, at(14)), Duration::from_millis(6));
        // By more than a period.
        assert!(pace.is_due(at(45)));
        assert!(!pace.is_due(at(45)) && !pace.is_due(at(54)));
        assert_eq!(pace.patience(LONGEST, at(45)), Duration::from_millis(10));
        assert!(pace.is_due(at(55)));
    }

    #[test]
    fn without_a_recent_fit_an_observation_is_waited_for() {
        let bodies = BodyFrame::default();
        let mut pace = Pace::new(Some(100));
        let start = pace.next;
        let later = start + Duration::from_secs(5);
        assert_eq!(pace.patience(LONGEST, later), LONGEST);
        assert!(!pace.is_due(later));
        pace.fitted(&bodies, later);
        assert!(pace.is_due(later));
        let silent = later + STALE;
        assert_eq!(pace.patience(LONGEST, silent), LONGEST);
        assert!(!pace.is_due(silent));
    }

    #[test]
    fn nothing_is_due_between_bodies_of_a_file() {
        let film = BodyFrame {
            flags: FLAG_FILE_TIME,
            ..BodyFrame::default()
        };
        let mut pace = Pace::new(Some(100));
        let start = pace.next;
        let at = |ms: u64| start + Duration::from_millis(ms);
        assert!(pace.fitted(&film, at(0)), "published as they are");
        assert_eq!(pace.patience(LONGEST, at(50)), LONGEST);
        assert!(!pace.is_due(at(50)));
        // A camera's after a file's.
        assert!(!pace.fitted(&BodyFrame::default(), at(60)));
        assert_eq!(pace.patience(LONGEST, at(60)), Duration::ZERO);
        assert!(pace.is_due(at(60)));
    }

    /// An observation of `captured` seconds, of a file or a camera.
    fn captured(captured: u64, flags: u32) -> ObservationFrame {
        ObservationFrame {
            capture_ns: captured * 1_000_000_000,
            flags,
            ..ObservationFrame::default()
        }
    }

    #[test]
    fn what_is_said_names_the_camera_where_there_are_several() {
        assert_eq!(Fresh::default().whose(), "");
        let mut fresh = Fresh::of("hall");
        // Before and after observations that were no news.
        for (second, of) in [(100, 100), (200, 150), (201, 201)] {
            fresh.look(&captured(of, 0), second * 1_000_000_000);
            assert_eq!(fresh.whose(), "hall: ");
        }
    }

    #[test]
    fn where_nothing_but_history_comes_that_is_said_once() {
        let mut fresh = Fresh::default();
        let mut look = |frame, second: u64| fresh.look(&frame, second * 1_000_000_000);
        // A clock that lags by a minute.
        for second in 100..105 {
            assert_eq!(look(captured(second - 60, 0), second), (false, None));
        }
        let said = (false, Some(Word::NoNews));
        assert_eq!(look(captured(45, 0), 105), said);
        for second in 106..200 {
            assert_eq!(look(captured(second - 60, 0), second), (false, None));
        }
        assert_eq!(
            look(captured(200, 0), 200),
            (true, Some(Word::LeftOut(100)))
        );
        assert_eq!(look(captured(201, 0), 201), (true, None));
        // A queue that empties is counted, and what lasts again is said again.
        assert_eq!(look(captured(198, 0), 202), (false, None));
        assert_eq!(look(captured(202, 0), 202), (true, Some(Word::LeftOut(1))));
        assert_eq!(look(captured(150, 0), 210), (false, None));
        assert_eq!(look(captured(155, 0), 215), said);
        // A file's times are its own.
        assert_eq!(
            look(captured(1, FLAG_FILE_TIME), 216),
            (true, Some(Word::LeftOut(2)))
        );
    }
}
