//! The newest frames of a stream: how often they come, and how old they were.

use std::collections::VecDeque;
use std::time::Duration;

/// Frames that rates and latency are taken from.
const MOST: usize = 128;

/// A frame as it came.
#[derive(Debug, Clone, Copy)]
pub struct Came {
    /// When, counted from an instant that all frames have in common.
    pub at: Duration,
    /// From capture to publication, seconds; `None` where the times are a file's.
    pub age: Option<f64>,
    /// Number of its picture.
    pub sequence: u64,
    /// When that was taken, nanoseconds.
    pub capture_ns: u64,
    /// Whether the network looked at it.
    pub is_looked_at: bool,
}

/// The newest of them.
#[derive(Debug, Clone, Default)]
pub struct Recent(VecDeque<Came>);

impl Recent {
    /// Takes one in, in place of the oldest where there are enough.
    pub fn take(&mut self, came: Came) {
        if self.0.len() == MOST {
            self.0.pop_front();
        }
        self.0.push_back(came);
    }

    /// What came before says nothing of what comes.
    pub fn forget(&mut self) {
        self.0.clear();
    }

    /// When the newest came.
    pub fn newest(&self) -> Option<Duration> {
        self.0.back().map(|c| c.at)
    }

    /// Frames a second; 0 where they tell nothing.
    pub fn hz(&self) -> f64 {
        self.each_second(self.0.len().saturating_sub(1))
    }

    /// Frames a second that the network looked at.
    pub fn look_hz(&self) -> f64 {
        let looked_at = self.0.iter().skip(1).filter(|c| c.is_looked_at);
        self.each_second(looked_at.count())
    }

    /// Pictures a second that were taken, by their own numbers and times; 0 where these tell nothing.
    pub fn source_hz(&self) -> f64 {
        let rate = self.ends().and_then(|(first, last)| {
            let count = last.sequence.checked_sub(first.sequence)?;
            let time = last.capture_ns.checked_sub(first.capture_ns)?;
            (time > 0).then(|| count as f64 / (time as f64 * 1e-9))
        });
        rate.unwrap_or(0.0)
    }

    /// How old frames were, seconds: more than this `part` of them, 0.5 for the median. `None` where no age is known.
    pub fn age(&self, part: f64) -> Option<f64> {
        let mut ages: Vec<f64> = self.0.iter().filter_map(|c| c.age).collect();
        ages.sort_by(f64::total_cmp);
        let at = (part * ages.len() as f64) as usize;
        ages.get(at.min(ages.len().saturating_sub(1))).copied()
    }

    fn ends(&self) -> Option<(&Came, &Came)> {
        Some((self.0.front()?, self.0.back()?))
    }

    fn each_second(&self, count: usize) -> f64 {
        let span = self
            .ends()
            .map(|(first, last)| last.at.saturating_sub(first.at));
        match span.filter(|span| !span.is_zero()) {
            Some(span) => count as f64 / span.as_secs_f64(),
            None => 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_are_those_of_frames_looks_and_the_camera() {
        let mut recent = Recent::default();
        assert_eq!(
            (recent.hz(), recent.source_hz(), recent.age(0.5)),
            (0.0, 0.0, None)
        );
        // Every third picture of a camera of 30, and a look at every second of these.
        for k in 0..1000_u64 {
            recent.take(Came {
                at: Duration::from_millis(100 * k),
                age: Some(0.02 + 0.01 * (k % 3) as f64),
                sequence: 3 * k,
                capture_ns: 100_000_000 * k,
                is_looked_at: k % 2 == 0,
            });
        }
        let near = |found: f64, expected: f64| (found - expected).abs() < 0.05;
        assert!(near(recent.hz(), 10.0) && near(recent.source_hz(), 30.0));
        assert!(near(recent.look_hz(), 5.0), "{}", recent.look_hz());
        assert!((recent.age(0.5).unwrap() - 0.03).abs() < 1e-9);
        assert!((recent.age(0.99).unwrap() - 0.04).abs() < 1e-9);
        assert_eq!(recent.newest(), Some(Duration::from_millis(99_900)));
        // Numbers and times of another source.
        recent.take(Came {
            at: Duration::from_secs(101),
            age: None,
            sequence: 0,
            capture_ns: 0,
            is_looked_at: true,
        });
        assert_eq!(recent.source_hz(), 0.0);
        recent.forget();
        assert_eq!((recent.newest(), recent.hz()), (None, 0.0));
    }
}
