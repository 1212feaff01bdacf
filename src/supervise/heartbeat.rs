//! A child's sign of life to its supervisor.

use std::cell::Cell;
use std::io;
use std::time::{Duration, Instant};

use rustix::fs::{OFlags, fcntl_getfl, fcntl_setfl};

/// More signs of life of one kind than these tell nothing.
const EVERY: Duration = Duration::from_millis(100);

/// A sign of life.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Beat {
    /// A result was published.
    Step,
    /// There was nothing to do.
    Idle,
    /// No picture has come yet, or a damaged one; to ask a device again may take a while.
    Waiting,
    /// The input is away, and looked for, which may take a while; or nothing that it sends is of use.
    Away,
}

impl Beat {
    const fn byte(self) -> u8 {
        match self {
            Self::Step => b'.',
            Self::Idle => b'-',
            Self::Waiting => b'?',
            Self::Away => b'!',
        }
    }

    /// What a byte on the pipe says.
    pub(super) fn of(byte: u8) -> Option<Self> {
        [Self::Step, Self::Idle, Self::Waiting, Self::Away]
            .into_iter()
            .find(|b| b.byte() == byte)
    }
}

/// Writes signs of life to standard output, if there is a supervisor.
#[derive(Debug, Default)]
pub struct Heartbeat {
    supervised: bool,
    last: Cell<Option<(Instant, Beat)>>,
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

    /// Whether there is a supervisor.
    pub fn is_supervised(&self) -> bool {
        self.supervised
    }

    /// This process has made a step.
    pub fn beat(&self, kind: Beat) {
        let now = Instant::now();
        let is_news = |(t, last): (Instant, Beat)| last != kind || now - t >= EVERY;
        if self.supervised && self.last.get().is_none_or(is_news) {
            self.last.set(Some((now, kind)));
            // A full pipe is full of signs of life; a broken one ends this process by signal.
            let _ = rustix::io::write(io::stdout(), &[kind.byte()]);
        }
    }
}
