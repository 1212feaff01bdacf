//! The writer of a ring, and its signs of life.

use std::fs::{self, File, Metadata, OpenOptions};
use std::io;
use std::marker::PhantomData;
use std::os::unix::fs::{FileExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;

use rustix::fs::{FallocateFlags, Gid, Mode, Timespec, Timestamps, UTIME_NOW};

use super::{ALIVE_AT, COUNT_AT, Header, LENGTH, SIGN_EVERY, SLOTS, now, place_of};
use crate::claim::{Claim, is_at};
use crate::stream::Message;

/// Writes a stream's messages.
#[derive(Debug)]
pub(crate) struct RingWriter<M> {
    file: Arc<File>,
    path: PathBuf,
    life: u64,
    count: u64,
    signs: Option<Signs>,
    _message: PhantomData<M>,
}

/// The thread that gives signs of life, until the sender is dropped.
#[derive(Debug)]
struct Signs {
    stop: Option<Sender<()>>,
    thread: Option<JoinHandle<()>>,
    lost: Arc<AtomicBool>,
}

impl<M: Message> RingWriter<M> {
    /// Bytes of a ring's file.
    pub(crate) const fn length() -> u64 {
        LENGTH as u64 + SLOTS * size_of::<M>() as u64
    }

    /// Makes the file, which nobody finds before [`show`](Self::show); its memory is reserved.
    ///
    /// # Errors
    /// The system's.
    pub(crate) fn create(path: &Path, life: u64, readers: Option<u32>) -> io::Result<Self> {
        let mut draft = path.as_os_str().to_owned();
        draft.push(format!(".{life:016x}.new"));
        let draft = PathBuf::from(draft);
        let file = OpenOptions::new()
            .read(true)
            .write(true)
            .create_new(true)
            .mode(0o600)
            .open(&draft)?;
        let ring = Self {
            file: Arc::new(file),
            path: draft,
            life,
            count: 0,
            signs: None,
            _message: PhantomData,
        };
        rustix::fs::fallocate(&ring.file, FallocateFlags::empty(), 0, Self::length())?;
        let header = Header {
            version: M::VERSION,
            size: size_of::<M>() as u32,
            life,
            count: 0,
            alive: now(),
        };
        ring.file.write_all_at(&header.to_bytes(), 0)?;
        if let Some(group) = readers {
            // A folder of a group that this process is no member of: the group of the process reads instead.
            let _ = rustix::fs::fchown(&ring.file, None, Some(Gid::from_raw(group)));
            rustix::fs::fchmod(&ring.file, Mode::RUSR | Mode::WUSR | Mode::RGRP)?;
        }
        Ok(ring)
    }

    /// Lets readers find it at `path`, and gives signs of life from now on.
    ///
    /// # Errors
    /// The system's.
    pub(crate) fn show(&mut self, path: &Path, claim: Arc<Claim>) -> io::Result<()> {
        self.file.write_all_at(&now().to_ne_bytes(), ALIVE_AT)?;
        fs::rename(&self.path, path)?;
        path.clone_into(&mut self.path);
        let lost = Arc::new(AtomicBool::new(false));
        let (stop, stopped) = channel();
        let (file, path, told) = (self.file.clone(), self.path.clone(), lost.clone());
        let thread = std::thread::Builder::new()
            .name("edgecap-alive".into())
            .spawn(move || {
                while stopped.recv_timeout(SIGN_EVERY) == Err(RecvTimeoutError::Timeout) {
                    let _ = file.write_all_at(&now().to_ne_bytes(), ALIVE_AT);
                    if !is_at(&file, &path) || !claim.stands() {
                        told.store(true, Ordering::Relaxed);
                    }
                }
            })?;
        self.signs = Some(Signs {
            stop: Some(stop),
            thread: Some(thread),
            lost,
        });
        Ok(())
    }

    /// Whether somebody removed the files under it, or cut its own short.
    pub(crate) fn is_lost(&self) -> bool {
        let lost = |s: &Signs| s.lost.load(Ordering::Relaxed);
        self.signs.as_ref().is_some_and(lost) || !self.is_whole()
    }

    /// Whether readers still find all of it: what is written into a file that was cut short brings no header back.
    fn is_whole(&self) -> bool {
        let is_long = |m: Metadata| m.len() >= Self::length();
        let is_ours = |h: Header| {
            let size = size_of::<M>() as u32;
            (h.version, h.size, h.life) == (M::VERSION, size, self.life)
        };
        let header = Header::read(&self.file).ok().flatten();
        self.file.metadata().is_ok_and(is_long) && header.is_some_and(is_ours)
    }

    /// Writes a message and wakes the readers; returns its number.
    ///
    /// # Errors
    /// The system's.
    pub(crate) fn write(&mut self, message: &M) -> io::Result<u64> {
        let n = self.count;
        self.file
            .write_all_at(message.as_bytes(), place_of(n, size_of::<M>()))?;
        self.count = n + 1;
        self.file
            .write_all_at(&self.count.to_ne_bytes(), COUNT_AT)?;
        let time = Timespec {
            tv_sec: 0,
            tv_nsec: UTIME_NOW,
        };
        let times = Timestamps {
            last_access: time,
            last_modification: time,
        };
        rustix::fs::futimens(&self.file, &times)?;
        Ok(n)
    }
}

impl Drop for Signs {
    fn drop(&mut self) {
        self.stop = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

impl<M> Drop for RingWriter<M> {
    fn drop(&mut self) {
        self.signs = None;
        let _ = self.file.write_all_at(&0_u64.to_ne_bytes(), ALIVE_AT);
        if is_at(&self.file, &self.path) {
            // Wakes those who wait, too.
            let _ = fs::remove_file(&self.path);
        }
    }
}
