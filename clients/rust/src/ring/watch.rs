//! Waiting for the next message: the kernel tells of what is written into a ring's file (inotify).

use std::os::fd::OwnedFd;
use std::path::Path;
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, Timespec};
use rustix::fs::inotify;

/// Tells of messages. A user has so many of these (`/proc/sys/fs/inotify`): where there is none left, time ends a wait.
#[derive(Debug)]
pub(super) struct Watch(pub(super) Option<OwnedFd>);

impl Watch {
    pub(super) fn new() -> Self {
        let flags = inotify::CreateFlags::NONBLOCK | inotify::CreateFlags::CLOEXEC;
        Self(inotify::init(flags).ok())
    }

    /// Begins to tell of a file's messages; its number here, `None` where the kernel refuses.
    pub(super) fn add(&self, path: &Path) -> Option<i32> {
        let watch = self.0.as_ref()?;
        inotify::add_watch(watch, path, inotify::WatchFlags::ATTRIB).ok()
    }

    /// Tells of that file no more.
    pub(super) fn remove(&self, watched: Option<i32>) {
        if let (Some(watch), Some(watched)) = (&self.0, watched) {
            let _ = inotify::remove_watch(watch, watched);
        }
    }

    /// Waits for a message, for so long at most; `false` where a signal ended the wait.
    pub(super) fn wait(&self, at_most: Duration) -> bool {
        let at_most = Timespec {
            tv_sec: at_most.as_secs() as i64,
            tv_nsec: i64::from(at_most.subsec_nanos()),
        };
        let watch = self.0.as_ref();
        let mut fds: Vec<_> = watch
            .map(|watch| PollFd::new(watch, PollFlags::IN))
            .into_iter()
            .collect();
        let woken = rustix::event::poll(&mut fds, Some(&at_most));
        if matches!(woken, Ok(n) if n > 0) {
            self.forget();
        }
        woken != Err(rustix::io::Errno::INTR)
    }

    /// The next wait waits for what comes after this.
    pub(super) fn forget(&self) {
        let Some(watch) = &self.0 else {
            return;
        };
        let mut events = [0_u8; 4096];
        while rustix::io::read(watch, &mut events).is_ok_and(|n| n > 0) {}
    }
}
