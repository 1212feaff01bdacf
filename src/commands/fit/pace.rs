//! When bodies are published: with every observation, or at a rate of their own.

use std::time::{Duration, Instant};

use edgecap_client::message::{BodyFrame, FLAG_FILE_TIME, ObservationFrame};

use crate::camera::monotonic_ns;
use crate::counted::counted;

/// What was seen longer ago is history, not news: it waited while a process stood still. Nor is it extrapolated
/// further.
const STALE: Duration = Duration::from_secs(1);

/// Leaves out observations that waited somewhere until they were no news any more.
#[derive(Debug, Default)]
pub struct Fresh {
    stale: u64,
}

impl Fresh {
    /// Whether an observation is news; says how many were not. One of a file has a time of its own.
    pub fn is_news(&mut self, frame: &ObservationFrame) -> bool {
        let newest = frame.publish_ns.max(frame.capture_ns);
        let age = Duration::from_nanos(monotonic_ns().saturating_sub(newest));
        if frame.flags & FLAG_FILE_TIME == 0 && age > STALE {
            self.stale += 1;
            return false;
        }
        if self.stale > 0 {
            let stale = std::mem::take(&mut self.stale);
            let stale = counted(stale, "observation", "observations");
            tracing::warn!("{stale} of more than {STALE:?} ago left out");
        }
        true
    }
}

/// When bodies are due.
#[derive(Debug)]
pub struct Pace {
    period: Option<Duration>,
    next: Instant,
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

    /// Bodies have been fitted; whether they are published as they are. A file's clock is not ours to extrapolate on.
    pub fn fitted(&mut self, bodies: &BodyFrame, now: Instant) -> bool {
        self.fitted = Some(now);
        self.period.is_none() || bodies.flags & FLAG_FILE_TIME != 0
    }

    /// Whether it is time to extrapolate the bodies fitted last. What was missed is not made up for.
    pub fn is_due(&mut self, bodies: &BodyFrame, now: Instant) -> bool {
        let Some(period) = self.period else {
            return false;
        };
        if now < self.next || !self.is_known(now) || bodies.flags & FLAG_FILE_TIME != 0 {
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
        assert!(pace.is_due(&bodies, at(0)));
        assert!(!pace.is_due(&bodies, at(9)));
        // A little late: the pace stays.
        assert!(pace.is_due(&bodies, at(14)));
        assert_eq!(pace.patience(LONGEST, at(14)), Duration::from_millis(6));
        // By more than a period.
        assert!(pace.is_due(&bodies, at(45)));
        assert!(!pace.is_due(&bodies, at(45)) && !pace.is_due(&bodies, at(54)));
        assert_eq!(pace.patience(LONGEST, at(45)), Duration::from_millis(10));
        assert!(pace.is_due(&bodies, at(55)));
    }

    #[test]
    fn without_a_recent_fit_an_observation_is_waited_for() {
        let bodies = BodyFrame::default();
        let mut pace = Pace::new(Some(100));
        let start = pace.next;
        let later = start + Duration::from_secs(5);
        assert_eq!(pace.patience(LONGEST, later), LONGEST);
        assert!(!pace.is_due(&bodies, later));
        pace.fitted(&bodies, later);
        assert!(pace.is_due(&bodies, later));
        let silent = later + STALE;
        assert_eq!(pace.patience(LONGEST, silent), LONGEST);
        assert!(!pace.is_due(&bodies, silent));
    }
}
