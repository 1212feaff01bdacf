//! Time as cameras stamp it, and time that tests can turn.

use std::thread;
use std::time::{Duration, Instant};

use rustix::time::{ClockId, clock_gettime};

/// Times that go back by more than this belong to another recording, nanoseconds.
pub const RESTART_NS: u64 = 500_000_000;

/// CLOCK_MONOTONIC, nanoseconds: what a camera's capture times count.
pub fn monotonic_ns() -> u64 {
    let now = clock_gettime(ClockId::Monotonic);
    now.tv_sec as u64 * 1_000_000_000 + now.tv_nsec as u64
}

/// Notices that the machine slept, which its capture times do not count.
#[derive(Debug)]
pub struct Sleep {
    /// What CLOCK_BOOTTIME was ahead of CLOCK_MONOTONIC by, nanoseconds.
    before: u64,
}

impl Default for Sleep {
    fn default() -> Self {
        Self {
            before: slept_since_boot(),
        }
    }
}

impl Sleep {
    /// Less is no sleep: the clocks are read one after the other.
    const LEAST: u64 = 100_000_000;

    /// Seconds slept since this was asked last, or began.
    pub fn seconds(&mut self) -> f64 {
        self.up_to(slept_since_boot())
    }

    fn up_to(&mut self, now: u64) -> f64 {
        let grown = now.saturating_sub(self.before);
        if grown < Self::LEAST {
            return 0.0;
        }
        self.before = now;
        grown as f64 * 1e-9
    }
}

/// What CLOCK_BOOTTIME is ahead of CLOCK_MONOTONIC by, nanoseconds: the machine's sleep since it started.
fn slept_since_boot() -> u64 {
    let boot_ns = || {
        let now = clock_gettime(ClockId::Boottime);
        now.tv_sec as u64 * 1_000_000_000 + now.tv_nsec as u64
    };
    loop {
        let (before, now, after) = (boot_ns(), monotonic_ns(), boot_ns());
        // Unless this thread was held up between the two.
        if after - before < Sleep::LEAST / 10 {
            return before.saturating_sub(now);
        }
    }
}

/// Time for the reconnecting state machine.
pub trait Clock: Send {
    /// The present.
    fn now(&self) -> Instant;
    /// Lets time pass.
    fn sleep(&self, duration: Duration);
}

/// The machine's own clock.
#[derive(Debug, Clone, Copy, Default)]
pub struct SystemClock;

impl Clock for SystemClock {
    fn now(&self) -> Instant {
        Instant::now()
    }

    fn sleep(&self, duration: Duration) {
        thread::sleep(duration);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sleep_is_told_once() {
        assert_eq!(Sleep::default().seconds(), 0.0, "awake");
        let mut sleep = Sleep { before: 5_000 };
        for (now, seconds) in [
            (5_000, 0.0),
            (4_000, 0.0),
            (90_000_000, 0.0),
            (30_000_000_000, 30.0),
            (30_000_900_000, 0.0),
        ] {
            let told = sleep.up_to(now);
            assert!((told - seconds).abs() < 1e-4, "{now}: {told} s");
        }
        assert!((sleep.up_to(30_200_000_000) - 0.2).abs() < 1e-4);
    }
}
