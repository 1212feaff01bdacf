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

    /// How long an observation may be waited for, `longest` at most.
    pub fn patience(&self, longest: Duration) -> Duration {
        match self.period {
            Some(_) => self
                .next
                .saturating_duration_since(Instant::now())
                .min(longest),
            None => longest,
        }
    }

    /// Bodies have been fitted; whether they are published as they are. A file's clock is not ours to extrapolate on.
    pub fn fitted(&mut self, bodies: &BodyFrame) -> bool {
        self.fitted = Some(Instant::now());
        self.period.is_none() || bodies.flags & FLAG_FILE_TIME != 0
    }

    /// Whether it is time to extrapolate the bodies fitted last.
    pub fn is_due(&mut self, bodies: &BodyFrame) -> bool {
        let Some(period) = self.period else {
            return false;
        };
        if Instant::now() < self.next {
            return false;
        }
        self.next = (self.next + period).max(Instant::now());
        let is_known = self.fitted.is_some_and(|t| t.elapsed() < STALE);
        is_known && bodies.flags & FLAG_FILE_TIME == 0
    }
}
