//! Whether a stream has fallen silent: the times at which its frames come go in.

use std::time::{Duration, Instant};

/// Without a frame for so long nobody is shown any more.
const QUIET: Duration = Duration::from_secs(2);
/// Frames that are further apart are those of a stream that was interrupted.
const SLOWEST: Duration = Duration::from_secs(60);

/// How often frames come.
#[derive(Debug, Clone, Default)]
pub struct Rhythm {
    heard: Option<Instant>,
    /// Between the last two frames.
    last: Option<Duration>,
    /// That, or the one before it where it is shorter: one pause makes no slow stream.
    interval: Duration,
}

impl Rhythm {
    /// A frame came.
    pub fn hear(&mut self, now: Instant) {
        if let Some(before) = self.heard.replace(now) {
            let passed = now.saturating_duration_since(before).min(SLOWEST);
            let earlier = self.last.replace(passed);
            self.interval = earlier.map_or(passed, |earlier| earlier.min(passed));
        }
    }

    /// Whether no frame has come for longer than `usual`, or than twice the time between frames, where that is longer;
    /// `None` before the first.
    pub fn is_silent(&self, usual: Duration, now: Instant) -> Option<bool> {
        let patience = usual.max(2 * self.interval);
        let heard = self.heard?;
        Some(now.saturating_duration_since(heard) > patience)
    }
}

/// Notices that a stream which shows people has fallen silent.
#[derive(Debug, Default)]
pub struct Silence {
    rhythm: Rhythm,
    told: bool,
}

impl Silence {
    /// A frame came.
    pub fn hear(&mut self, now: Instant) {
        self.rhythm.hear(now);
        self.told = false;
    }

    /// Whether a silence has begun: told once of each, of none before the first frame.
    pub fn begins(&mut self, now: Instant) -> bool {
        let is_news = !self.told && self.rhythm.is_silent(QUIET, now) == Some(true);
        self.told |= is_news;
        is_news
    }
}

#[cfg(test)]
mod tests {
    use std::ops::Range;

    use super::*;

    /// When a silence begins, in tenths of a second, at each of which it is looked.
    fn looks(silence: &mut Silence, start: Instant, tenths: Range<u64>) -> Vec<u64> {
        let begins = |t: &u64| silence.begins(start + Duration::from_millis(100 * t));
        tenths.filter(begins).collect()
    }

    #[test]
    fn a_silence_is_told_once_and_the_next_one_again() {
        let (mut silence, start) = (Silence::default(), Instant::now());
        let before = looks(&mut silence, start, 0..100);
        assert!(before.is_empty(), "nobody was shown");
        let frame = |tenth: u64| start + Duration::from_millis(100 * tenth);
        silence.hear(frame(100));
        silence.hear(frame(103));
        assert_eq!(looks(&mut silence, start, 103..500), [124]);
        // The pause itself is no reason to wait for longer.
        silence.hear(frame(500));
        assert_eq!(looks(&mut silence, start, 500..900), [521]);
        // An empty place has three frames a second.
        for tenth in (900..1000).step_by(3) {
            silence.hear(frame(tenth));
            assert!(looks(&mut silence, start, tenth..tenth + 3).is_empty());
        }
    }

    #[test]
    fn a_slow_stream_is_not_silent_between_its_frames() {
        let (mut silence, start) = (Silence::default(), Instant::now());
        silence.hear(start);
        silence.hear(start + Duration::from_secs(10));
        assert_eq!(looks(&mut silence, start, 100..1000), [301]);
    }
}
