//! A connection of which no more is heard at a time than is wanted, and that says when it has room.

use std::io::{self, ErrorKind, Read, Write};
use std::net::TcpStream;
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::net::sockopt;

use crate::http::take_leave;

/// Bytes that are heard in one turn: hundreds of pings. Who has more to say is not heard to the end at once, so that
/// nobody can keep a thread busy by talking.
const MOST_A_TURN: usize = 16 << 10;
/// Turns one after the other in which a client may have more to say. A client that was not listened to for a while has
/// a few.
const MOST_TURNS: u32 = 5;

/// A client's connection.
#[derive(Debug)]
pub struct Ear {
    stream: TcpStream,
    /// Bytes that may still be heard in this turn.
    left: usize,
    /// Turns so far in which nothing was left.
    full: u32,
}

impl Ear {
    pub fn new(stream: TcpStream) -> Self {
        Self {
            stream,
            left: 0,
            full: 0,
        }
    }

    /// Begins a turn, in which reading does not wait.
    ///
    /// # Errors
    /// The system's.
    pub fn open(&mut self) -> io::Result<()> {
        self.left = MOST_A_TURN;
        self.stream.set_nonblocking(true)
    }

    /// Ends it; `false` for a client that talks without end.
    ///
    /// # Errors
    /// The system's.
    pub fn close(&mut self) -> io::Result<bool> {
        self.full = match self.left {
            0 => self.full + 1,
            _ => 0,
        };
        self.stream.set_nonblocking(false)?;
        Ok(self.full < MOST_TURNS)
    }

    /// Whether a third of the kernel's buffer is free; waits up to `patience` for it.
    pub fn has_room(&self, patience: Duration) -> bool {
        let patience = Timespec::try_from(patience).unwrap_or_default();
        let mut polled = [PollFd::new(&self.stream, PollFlags::OUT)];
        // A connection that is broken says so when it is written to.
        poll(&mut polled, Some(&patience)).is_ok_and(|ready| ready > 0)
    }

    /// Keeps of what is sent from now on so many bytes in the kernel; it doubles them for its own needs.
    pub fn hold(&self, bytes: usize) {
        // Without it what is sent comes later, no more.
        let _ = sockopt::set_socket_send_buffer_size(&self.stream, bytes);
    }

    /// Ends the connection so that what was sent last is heard.
    pub fn leave(&mut self) {
        // Who has gone hears nothing.
        let _ = take_leave(&mut self.stream);
    }
}

impl Read for Ear {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let most = buffer.len().min(self.left);
        if most == 0 && !buffer.is_empty() {
            return Err(ErrorKind::WouldBlock.into());
        }
        let read = self.stream.read(&mut buffer[..most])?;
        self.left -= read;
        Ok(read)
    }
}

impl Write for Ear {
    fn write(&mut self, buffer: &[u8]) -> io::Result<usize> {
        self.stream.write(buffer)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.stream.flush()
    }
}
