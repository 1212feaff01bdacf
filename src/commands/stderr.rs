//! Standard error that makes nobody wait: where whoever reads it has stopped reading, lines are lost, not time. A
//! supervisor that hung with its log would hang everything.

use std::io::{self, Write};
use std::os::fd::AsFd;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, Timespec, poll};

/// What a pipe with any room takes at once.
const PIECE: usize = 4096;
/// So long may a reader that is busy make a line wait, …
const PATIENCE: Duration = Duration::from_millis(100);
/// … and the last line of a process.
pub const LAST_PATIENCE: Duration = Duration::from_secs(2);

/// Whether the last line found no room: then the next one does not wait.
static IS_FULL: AtomicBool = AtomicBool::new(false);

/// Standard error.
#[derive(Debug, Clone, Copy)]
pub struct Stderr {
    patience: Duration,
}

impl Stderr {
    /// For a line among many.
    pub const fn new() -> Self {
        Self { patience: PATIENCE }
    }

    /// For the last line of a process.
    pub const fn last() -> Self {
        Self {
            patience: LAST_PATIENCE,
        }
    }
}

impl Write for Stderr {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let stderr = io::stderr();
        let waits = !IS_FULL.load(Ordering::Relaxed) || self.patience > PATIENCE;
        let patience = if waits { self.patience } else { Duration::ZERO };
        let has_room = has_room(&stderr, patience);
        IS_FULL.store(!has_room, Ordering::Relaxed);
        if has_room {
            return stderr.lock().write(&bytes[..bytes.len().min(PIECE)]);
        }
        // Lost.
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Whether something can be written at once, or after a wait.
fn has_room(to: impl AsFd, patience: Duration) -> bool {
    let patience = Timespec::try_from(patience).unwrap_or_default();
    let mut polled = [PollFd::new(&to, PollFlags::OUT)];
    let found = poll(&mut polled, Some(&patience)).or_else(|_| {
        // A signal came.
        poll(&mut polled, Some(&Timespec::default()))
    });
    // A broken pipe says so when it is written to.
    found.is_ok_and(|ready| ready > 0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_pipe_has_no_room_until_somebody_reads() {
        let (mut reader, mut writer) = io::pipe().unwrap();
        let flags = rustix::fs::fcntl_getfl(&writer).unwrap();
        rustix::fs::fcntl_setfl(&writer, flags | rustix::fs::OFlags::NONBLOCK).unwrap();
        assert!(has_room(&writer, Duration::ZERO));
        while writer.write(&[b'.'; PIECE]).is_ok() {}
        assert!(!has_room(&writer, Duration::from_millis(10)));
        io::Read::read_exact(&mut reader, &mut [0; PIECE]).unwrap();
        assert!(has_room(&writer, Duration::ZERO));
        drop(reader);
        assert!(
            has_room(&writer, Duration::ZERO),
            "nobody reads: an error, no wait"
        );
    }
}
