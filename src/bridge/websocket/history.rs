//! The past that is kept for clients that come later: of running cameras the newest, of a record all of it, thinned out
//! evenly where it is too much to hold.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use tungstenite::Bytes;

/// Most bytes that are kept, whatever the time.
const MOST: usize = 64 << 20;

/// Frames, oldest first.
#[derive(Debug)]
pub struct History {
    frames: VecDeque<Kept>,
    bytes: usize,
    most: usize,
    keep: Duration,
    /// Frames that came.
    count: u64,
    /// Of a record every so-manieth frame is kept, and the last.
    every: u64,
}

#[derive(Debug)]
struct Kept {
    camera: String,
    number: u64,
    at: Instant,
    bytes: Bytes,
}

impl Kept {
    fn is_old(&self, now: Instant, keep: Duration) -> bool {
        now.saturating_duration_since(self.at) > keep
    }
}

impl History {
    /// Keeps frames for so long; zero: none, [`Duration::MAX`]: a record's, from its first to its last.
    pub fn new(keep: Duration) -> Self {
        Self {
            frames: VecDeque::new(),
            bytes: 0,
            most: MOST,
            keep,
            count: 0,
            every: 1,
        }
    }

    /// For how long.
    pub fn keep(&self) -> Duration {
        self.keep
    }

    /// Of a record every so-manieth frame is kept: 1 where all are.
    pub fn every(&self) -> u64 {
        self.every
    }

    /// What is kept of so long a time before `now`, of a record all of it, of one camera or of all, oldest first.
    pub fn frames(
        &self,
        now: Instant,
        within: Duration,
        camera: Option<&str>,
    ) -> impl Iterator<Item = &Bytes> {
        let past = self.frames.iter();
        // When a record was read says nothing about its frames.
        let within = match self.keep {
            Duration::MAX => Duration::MAX,
            keep => within.min(keep),
        };
        past.filter(move |kept| !kept.is_old(now, within))
            .filter(move |kept| camera.is_none_or(|wanted| wanted == kept.camera))
            .map(|kept| &kept.bytes)
    }

    /// Keeps a camera's frame that came `now`.
    pub fn remember(&mut self, now: Instant, camera: &str, bytes: Bytes) {
        if self.keep.is_zero() {
            return;
        }
        if let Some(last) = self.frames.back()
            && last.number % self.every != 0
        {
            self.bytes -= last.bytes.len();
            self.frames.pop_back();
        }
        self.bytes += bytes.len();
        let number = self.count;
        self.count += 1;
        let kept = Kept {
            camera: camera.to_owned(),
            number,
            at: now,
            bytes,
        };
        self.frames.push_back(kept);
        if self.keep == Duration::MAX {
            self.thin_out();
        } else {
            self.forget(now);
        }
    }

    fn thin_out(&mut self) {
        while self.bytes > self.most && self.frames.len() > 2 {
            self.every *= 2;
            let (every, last) = (self.every, self.count - 1);
            self.frames
                .retain(|k| k.number % every == 0 || k.number == last);
            self.bytes = self.frames.iter().map(|k| k.bytes.len()).sum();
        }
    }

    fn forget(&mut self, now: Instant) {
        while let Some(oldest) = self.frames.front()
            && (oldest.is_old(now, self.keep) || self.bytes > self.most)
        {
            self.bytes -= oldest.bytes.len();
            self.frames.pop_front();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is kept of `count` frames of 100 bytes, each of which holds its number, where there is room for 12.
    fn kept_of(count: u16, keep: Duration) -> (Vec<u16>, u64) {
        let mut history = History {
            most: 1200,
            ..History::new(keep)
        };
        let now = Instant::now();
        for n in 0..count {
            history.remember(now, "hall", n.to_le_bytes().repeat(50).into());
            assert!(history.bytes <= 1200);
            let newest = history.frames(now, keep, None).last().unwrap();
            assert_eq!(newest[..2], n.to_le_bytes());
        }
        let number = |b: &Bytes| u16::from_le_bytes([b[0], b[1]]);
        (
            history.frames(now, keep, None).map(number).collect(),
            history.every(),
        )
    }

    #[test]
    fn a_record_is_kept_from_its_first_frame_to_its_last() {
        assert_eq!(kept_of(12, Duration::MAX), ((0..12).collect(), 1));
        let (kept, every) = kept_of(100, Duration::MAX);
        assert_eq!(every, 16);
        assert_eq!(kept, [0, 16, 32, 48, 64, 80, 96, 99]);
    }

    #[test]
    fn of_running_cameras_the_newest_is_kept() {
        let minute = Duration::from_secs(3600);
        assert_eq!(kept_of(100, minute), ((88..100).collect(), 1));
        let mut none = History::new(Duration::ZERO);
        let now = Instant::now();
        none.remember(now, "hall", Bytes::from_static(b"frame"));
        assert_eq!(none.frames(now, Duration::MAX, None).count(), 0);
    }

    #[test]
    fn who_asks_for_the_last_seconds_gets_all_of_a_record() {
        let [second, hour] = [1, 3600].map(Duration::from_secs);
        let now = Instant::now();
        for (keep, kept) in [(2 * hour, 0), (Duration::MAX, 1)] {
            let mut history = History::new(keep);
            history.remember(now, "hall", Bytes::from_static(b"frame"));
            assert_eq!(history.frames(now + hour, second, None).count(), kept);
        }
    }
}
