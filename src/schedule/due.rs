//! When something that may be done so many times a second is due: times go in, no clock of its own.

/// Cameras do not count as evenly as we do.
const UNEVEN_NS: u64 = 5_000_000;

/// Is due every `interval` nanoseconds.
#[derive(Debug, Clone, Copy)]
pub struct Due {
    interval: u64,
    next: u64,
}

impl Due {
    /// At once, and every `interval` nanoseconds from then on.
    pub fn new(interval: u64) -> Self {
        Self { interval, next: 0 }
    }

    /// Every `interval` nanoseconds from the next time on.
    pub fn every(self, interval: u64) -> Self {
        Self { interval, ..self }
    }

    /// From when on it is due, nanoseconds.
    pub fn at_ns(&self) -> u64 {
        self.next.saturating_sub(self.slack())
    }

    /// It was done at `now`. What is late does not put off what comes after it, unless it is later than one interval.
    pub fn done(&mut self, now: u64) {
        let next = self.next.saturating_add(self.interval);
        let latest = now.saturating_add(self.interval + self.slack());
        self.next = next.clamp(now, latest);
    }

    fn slack(&self) -> u64 {
        UNEVEN_NS.min(self.interval / 8)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_time_is_too_late() {
        for late in [u64::MAX - 1, u64::MAX] {
            let mut due = Due::new(66_666_666);
            due.done(late);
            due.done(late);
            assert!(due.at_ns() >= late - UNEVEN_NS);
        }
    }

    #[test]
    fn it_comes_as_often_as_it_may_whatever_the_camera_does() {
        for (camera, most, expected) in [
            (30, 15, 15),
            (25, 15, 15),
            (20, 15, 15),
            (60, 15, 15),
            (10, 15, 10),
        ] {
            let mut due = Due::new(1_000_000_000 / most);
            let times = (0..20 * camera).map(|k| k * 1_000_000_000 / camera);
            let mut done = 0;
            for now in times.filter(|now| *now >= 1_000_000_000) {
                if now >= due.at_ns() {
                    due.done(now);
                    done += 1;
                }
            }
            let expected = 19 * expected;
            assert!(
                (expected - 2..=expected + 2).contains(&done),
                "{camera}: {done}"
            );
        }
    }
}
