//! In: the path of recorded observations, or '-'. Out: their bytes, which end as well where the user stops: a pipe may
//! be quiet for as long as it likes.

use std::fs::File;
use std::io::{self, BufRead, BufReader, ErrorKind, Read};
use std::os::fd::AsFd;
use std::path::Path;

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{Mode, OFlags, open};
use rustix::io::Errno;

use super::STEP;
use crate::commands::exit::Failure;
use crate::commands::stop::Stop;
use crate::record;

/// Bytes that are asked for at a time.
const BUFFER: usize = 1 << 16;

/// Recorded observations.
pub struct Lines {
    /// Their bytes.
    pub from: Box<dyn BufRead>,
    /// Whether they end by themselves, as a file does. Of a pipe nobody knows.
    pub has_end: bool,
}

impl Lines {
    /// Opens them.
    ///
    /// # Errors
    /// If there are none, or this user may not read them.
    pub fn open(input: &Path, stop: &Stop) -> anyhow::Result<Self> {
        let no_input = |e: io::Error| Failure::no_input(input, &e);
        let is_stdin = input.as_os_str() == "-";
        // A handle of its own: what the shared one has taken into its buffer no wait would see.
        let file = match is_stdin {
            true => io::stdin().as_fd().try_clone_to_owned().map(File::from),
            // Whoever is to write to a pipe may not have come yet, and opening would wait for that.
            false => open(input, OFlags::NONBLOCK | OFlags::CLOEXEC, Mode::empty())
                .map(File::from)
                .map_err(io::Error::from),
        };
        let file = file.map_err(no_input)?;
        let found = file.metadata().map_err(no_input)?;
        record::expect_no_folder(&found).map_err(no_input)?;
        let stop = stop.clone();
        Ok(Self {
            from: Box::new(BufReader::with_capacity(BUFFER, UntilStop { file, stop })),
            has_end: found.is_file(),
        })
    }
}

/// A file or pipe that ends where the user stops.
struct UntilStop {
    file: File,
    stop: Stop,
}

impl Read for UntilStop {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let patience = Timespec::try_from(STEP).unwrap_or_default();
        while !self.stop.requested() {
            let mut polled = [PollFd::new(&self.file, PollFlags::IN)];
            match poll(&mut polled, Some(&patience)) {
                Ok(0) | Err(Errno::INTR) => {}
                // Its end, or an error, shows when it is read; others may have read it empty.
                Ok(_) => match self.file.read(into) {
                    Err(e) if e.kind() == ErrorKind::WouldBlock => {}
                    read => return read,
                },
                Err(e) => return Err(e.into()),
            }
        }
        Ok(0)
    }
}
