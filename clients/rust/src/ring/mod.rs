//! A stream's newest messages in a file that one process writes and any number reads.
//!
//! A reader has the file open for reading and nothing else: it cannot hold the writer up, and nothing that it does
//! reaches it. The file lies in memory. All numbers are in this machine's byte order.
//!
//! | bytes | what |
//! |---|---|
//! | 0–8 | `EDGECAP` and the version of this layout, 1 |
//! | 8–12, 12–16 | version and size of the messages, u32 |
//! | 16–20, 20–24 | number of slots, u32; zero |
//! | 24–32 | the publisher's life, a random u64: another one is another publisher |
//! | 32–40 | messages written so far, u64 |
//! | 40–48 | last sign of life, CLOCK_MONOTONIC nanoseconds, u64; 0 once the publisher has gone |
//! | 64– | slots of one message each; message n is in slot n modulo their number |
//!
//! A writer fills a slot, then counts it, then sets the file's times, which wakes everybody who watches its attributes
//! (inotify). So a reader that copied message n has it whole if fewer than n + slots are counted after the copy.

mod open;
mod reader;
mod watch;
mod writer;

pub(crate) use reader::{Folders, RingReader};
pub(crate) use writer::RingWriter;

use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;
use std::time::Duration;

/// Messages that wait for a slow reader before the oldest is overwritten.
pub const BUFFER: usize = 16;
/// One more than can be read: it is being written.
const SLOTS: u64 = BUFFER as u64 + 1;
const MAGIC: &[u8; 8] = b"EDGECAP\x01";
const LENGTH: usize = 64;
const COUNT_AT: u64 = 32;
const ALIVE_AT: u64 = 40;
/// How often a writer gives a sign of life.
const SIGN_EVERY: Duration = Duration::from_millis(150);
/// Without one for so long it has gone. A reader looks again after [`LOOK_EVERY`]: together less than a second.
const GONE_AFTER: Duration = Duration::from_millis(700);
/// How old a reader's knowledge of the writer may be.
pub(crate) const LOOK_EVERY: Duration = Duration::from_millis(200);

/// What a ring's file begins with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Header {
    version: u32,
    size: u32,
    life: u64,
    count: u64,
    alive: u64,
}

impl Header {
    fn to_bytes(self) -> [u8; LENGTH] {
        let mut bytes = [0; LENGTH];
        bytes[..8].copy_from_slice(MAGIC);
        bytes[8..12].copy_from_slice(&self.version.to_ne_bytes());
        bytes[12..16].copy_from_slice(&self.size.to_ne_bytes());
        bytes[16..20].copy_from_slice(&(SLOTS as u32).to_ne_bytes());
        bytes[24..32].copy_from_slice(&self.life.to_ne_bytes());
        bytes[32..40].copy_from_slice(&self.count.to_ne_bytes());
        bytes[40..48].copy_from_slice(&self.alive.to_ne_bytes());
        bytes
    }

    /// The header of an open file; `None` where it is none of ours.
    fn read(file: &File) -> io::Result<Option<Self>> {
        let mut bytes = [0; LENGTH];
        match file.read_exact_at(&mut bytes, 0) {
            Err(e) if e.kind() == io::ErrorKind::UnexpectedEof => return Ok(None),
            done => done?,
        }
        let short = |at: usize| u32::from_ne_bytes(core::array::from_fn(|i| bytes[at + i]));
        let long = |at: usize| u64::from_ne_bytes(core::array::from_fn(|i| bytes[at + i]));
        let ours = bytes[..8] == *MAGIC && u64::from(short(16)) == SLOTS;
        Ok(ours.then(|| Self {
            version: short(8),
            size: short(12),
            life: long(24),
            count: long(32),
            alive: long(40),
        }))
    }
}

fn read_u64(file: &File, at: u64) -> io::Result<u64> {
    let mut bytes = [0; 8];
    file.read_exact_at(&mut bytes, at)?;
    Ok(u64::from_ne_bytes(bytes))
}

/// Where message `n` begins.
fn place_of(n: u64, size: usize) -> u64 {
    LENGTH as u64 + (n % SLOTS) * size as u64
}

/// CLOCK_MONOTONIC, nanoseconds.
fn now() -> u64 {
    let t = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
    (t.tv_sec as u64) * 1_000_000_000 + t.tv_nsec as u64
}
