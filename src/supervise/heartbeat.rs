//! A child's sign of life to its supervisor.

use std::cell::Cell;
use std::io;
use std::time::{Duration, Instant};

use rustix::fs::{OFlags, fcntl_getfl, fcntl_setfl};

/// More signs of life than these tell nothing.
const EVERY: Duration = Duration::from_millis(100);

/// Writes signs of life to standard output, if there is a supervisor.
#[derive(Debug, Default)]
pub struct Heartbeat {
    supervised: bool,
    last: Cell<Option<Instant>>,
}

impl Heartbeat {
    /// To the supervisor that reads this process's standard output.
    ///
    /// # Errors
    /// If standard output is none.
    pub fn to_supervisor() -> io::Result<Self> {
        let stdout = io::stdout();
        // A supervisor that is busy must not make its child wait.
        fcntl_setfl(&stdout, fcntl_getfl(&stdout)? | OFlags::NONBLOCK)?;
        Ok(Self {
            supervised: true,
            last: Cell::new(None),
        })
    }

    /// This process has made a step.
    pub fn beat(&self) {
        let now = Instant::now();
        if self.supervised && self.last.get().is_none_or(|t| now - t >= EVERY) {
            self.last.set(Some(now));
            // A full pipe is full of signs of life; a broken one ends this process by signal.
            let _ = rustix::io::write(io::stdout(), b".");
        }
    }
}
