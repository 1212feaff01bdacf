//! Time as cameras stamp it, and time that tests can turn.

use std::thread;
use std::time::{Duration, Instant};

/// CLOCK_MONOTONIC, nanoseconds: what [`Frame::time_ns`](crate::capture::Frame::time_ns) of a camera counts.
pub fn monotonic_ns() -> u64 {
    let mut now = libc::timespec {
        tv_sec: 0,
        tv_nsec: 0,
    };
    // SAFETY: `now` is one writable timespec, which is all that the call writes. It cannot fail for this clock on Linux; if it
    // did, `now` would stay 0, which is a valid value.
    unsafe {
        libc::clock_gettime(libc::CLOCK_MONOTONIC, &mut now);
    }
    now.tv_sec as u64 * 1_000_000_000 + now.tv_nsec as u64
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
