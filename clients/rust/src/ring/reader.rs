//! A reader of a ring: finds it, follows it from one publisher to the next.

use std::fs::{self, File, OpenOptions};
use std::io;
use std::marker::PhantomData;
use std::os::fd::OwnedFd;
use std::os::unix::fs::{FileExt, MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec};
use rustix::fs::{OFlags, inotify};

use super::{COUNT_AT, GONE_AFTER, Header, LOOK_EVERY, SLOTS, now, place_of, read_u64};
use crate::claim::is_at;
use crate::error::LinkError;
use crate::place::{reading_dirs, sealed};
use crate::stream::{Message, file_stem, ring_path, service_name, version_of};

/// How often a reader looks for a ring that is not there yet.
const SEARCH_EVERY: Duration = Duration::from_millis(20);

/// For how long it does so that often: at a start side by side. Later every [`LOOK_EVERY`] is soon enough.
const SEARCH_EAGERLY: Duration = Duration::from_secs(1);

/// How often it looks for a message where the kernel does not tell.
const STEP: Duration = Duration::from_millis(5);

/// Which message a reader begins with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Newest {
    /// The newest that is there: it came while the publisher was running already.
    Last,
    /// The oldest that is there: the reader was waiting when the publisher began.
    All,
}

/// Where a ring is looked for.
#[derive(Debug, Clone)]
pub(crate) enum Folders {
    /// Where readers look: a session that begins later brings another folder.
    OfReaders,
    /// In these.
    These(Vec<PathBuf>),
}

impl Folders {
    fn now(&self) -> Vec<PathBuf> {
        match self {
            Self::OfReaders => reading_dirs(),
            Self::These(folders) => folders.clone(),
        }
    }
}

/// Reads a stream's messages.
#[derive(Debug)]
pub(crate) struct RingReader<M> {
    /// The first folder whose publisher is alive is taken.
    folders: Folders,
    camera: String,
    /// Tells of messages. A user has so many of these (`/proc/sys/fs/inotify`): none where there is none left.
    watch: Option<OwnedFd>,
    open: Option<Open>,
    looked: Instant,
    /// Since when there is no ring, where there is none.
    searches_since: Instant,
    /// Another publisher is alive while messages of the open ring's dead one are unread.
    is_followed: bool,
    begin: Newest,
    _message: PhantomData<M>,
}

#[derive(Debug)]
struct Open {
    folder: PathBuf,
    path: PathBuf,
    file: File,
    life: u64,
    /// Number of the message that comes next.
    next: u64,
    /// Within the reader's `watch`; `None` where the kernel tells nothing of this file.
    watched: Option<i32>,
    is_alive: bool,
}

impl<M: Message> RingReader<M> {
    /// Looks for the stream, which need not be there.
    ///
    /// # Errors
    /// [`LinkError`], as its texts say.
    pub(crate) fn new(folders: Folders, camera: &str) -> Result<Self, LinkError> {
        let flags = inotify::CreateFlags::NONBLOCK | inotify::CreateFlags::CLOEXEC;
        let mut reader = Self {
            folders,
            camera: camera.to_owned(),
            watch: inotify::init(flags).ok(),
            open: None,
            looked: Instant::now(),
            searches_since: Instant::now(),
            is_followed: false,
            begin: Newest::Last,
            _message: PhantomData,
        };
        reader.search()?;
        reader.begin = Newest::All;
        Ok(reader)
    }

    /// Folder and life of the publisher whose messages are read.
    pub(crate) fn source(&self) -> Option<(&Path, u64)> {
        self.open.as_ref().map(|o| (&*o.folder, o.life))
    }

    /// Whether the publisher whose messages are read is alive, as far as was seen.
    pub(crate) fn is_alive(&self) -> bool {
        self.open.as_ref().is_some_and(|o| o.is_alive)
    }

    /// Whether anybody publishes the stream, as far as was seen.
    pub(crate) fn is_published(&self) -> bool {
        self.is_alive() || self.is_followed
    }

    /// As if it had been silent for too long.
    #[cfg(test)]
    pub(crate) fn take_for_dead(&mut self) {
        self.open.as_mut().expect("a ring is open").is_alive = false;
    }

    /// Number of the message that comes next.
    pub(crate) fn position(&self) -> u64 {
        self.open.as_ref().map_or(0, |o| o.next)
    }

    /// Messages that the publisher has written.
    pub(crate) fn count(&self) -> u64 {
        let count = |o: &Open| read_u64(&o.file, COUNT_AT).unwrap_or(o.next);
        self.open.as_ref().map_or(0, count)
    }

    /// Goes on after message `n`, which the caller got otherwise.
    pub(crate) fn pass(&mut self, n: u64) {
        if let Some(open) = &mut self.open {
            open.next = n + 1;
        }
    }

    /// Looks whether the publisher is alive and where its file is, if that was not done lately.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub(crate) fn look(&mut self) -> Result<(), LinkError> {
        if self.looked.elapsed() < self.look_every() {
            return Ok(());
        }
        self.look_now()
    }

    /// As [`look`](Self::look), whenever that was done.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub(crate) fn look_now(&mut self) -> Result<(), LinkError> {
        self.look_at_all(false)
    }

    /// As [`look`](Self::look), and leaves what the dead left where somebody else publishes.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub(crate) fn leave_the_dead(&mut self) -> Result<(), LinkError> {
        if !self.is_followed && self.looked.elapsed() < self.look_every() {
            return Ok(());
        }
        self.look_at_all(true)
    }

    fn look_every(&self) -> Duration {
        let is_new = self.searches_since.elapsed() < SEARCH_EAGERLY;
        if self.open.is_none() && is_new {
            SEARCH_EVERY
        } else {
            LOOK_EVERY
        }
    }

    fn look_at_all(&mut self, leaves: bool) -> Result<(), LinkError> {
        self.looked = Instant::now();
        self.is_followed = false;
        if let Some(open) = &mut self.open {
            // Alive only where others find it: what was cleaned away is made anew elsewhere.
            let stands = is_at(&open.file, &open.path);
            open.is_alive = stands && alive(&open.file);
            if open.is_alive {
                return Ok(());
            }
            let unread = read_u64(&open.file, COUNT_AT).is_ok_and(|n| n > open.next);
            if unread {
                self.look_past(leaves);
                return Ok(());
            }
        }
        self.search()
    }

    /// Looks whether somebody else publishes while messages of the dead are unread.
    fn look_past(&mut self, leaves: bool) {
        // What is wrong with it is told once those are read.
        let Ok(Some(found)) = self.find() else {
            return;
        };
        if self.source().is_some_and(|(_, life)| life == found.life) {
            if let Some(known) = &mut self.open {
                known.is_alive = found.is_alive;
            }
        } else if found.is_alive && leaves {
            self.follow(found);
        } else {
            self.is_followed = found.is_alive;
            self.unwatch(found.watched);
        }
    }

    /// The oldest message not yet read.
    ///
    /// # Errors
    /// [`LinkError::SharedMemory`].
    pub(crate) fn read(&mut self) -> Result<Option<Box<M>>, LinkError> {
        let Some(open) = &mut self.open else {
            return Ok(None);
        };
        let mut message = Box::<M>::default();
        match open.read(message.as_mut_bytes()) {
            Ok(true) => Ok(Some(message)),
            Ok(false) => Ok(None),
            // Somebody cut it short: as good as not there.
            Err(e) if e.kind() == io::ErrorKind::UnexpectedEof => {
                self.close();
                Ok(None)
            }
            Err(e) => Err(LinkError::failed(&service_name::<M>(&self.camera), e)),
        }
    }

    /// Goes over to the newest message, so that [`read`](Self::read) gives that.
    pub(crate) fn skip(&mut self) {
        if let Some(open) = &mut self.open {
            let count = read_u64(&open.file, COUNT_AT).unwrap_or(open.next);
            open.next = open.next.max(count.saturating_sub(1));
        }
    }

    /// Waits for a message, for a publisher, or until it is time to look again; `false` where a signal ended the wait.
    pub(crate) fn wait(&self, timeout: Duration) -> bool {
        let step = match &self.open {
            Some(open) if open.watched.is_none() => STEP,
            _ => self.look_every(),
        };
        let step = step.min(timeout);
        let timeout = Timespec {
            tv_sec: step.as_secs() as i64,
            tv_nsec: i64::from(step.subsec_nanos()),
        };
        let watch = self.watch.as_ref();
        let mut fds: Vec<_> = watch
            .map(|watch| PollFd::new(watch, PollFlags::IN))
            .into_iter()
            .collect();
        let woken = rustix::event::poll(&mut fds, Some(&timeout));
        if matches!(woken, Ok(n) if n > 0) {
            self.forget_events();
        }
        woken != Err(rustix::io::Errno::INTR)
    }

    /// The next wait waits for what comes after this.
    pub(crate) fn forget_events(&self) {
        let Some(watch) = &self.watch else {
            return;
        };
        let mut events = [0_u8; 4096];
        while rustix::io::read(watch, &mut events).is_ok_and(|n| n > 0) {}
    }

    fn close(&mut self) {
        if let Some(open) = self.open.take() {
            self.unwatch(open.watched);
            self.searches_since = Instant::now();
        }
    }

    fn watch(&self, path: &Path) -> Option<i32> {
        let watch = self.watch.as_ref()?;
        inotify::add_watch(watch, path, inotify::WatchFlags::ATTRIB).ok()
    }

    fn unwatch(&self, watched: Option<i32>) {
        if let (Some(watch), Some(watched)) = (&self.watch, watched) {
            let _ = inotify::remove_watch(watch, watched);
        }
    }

    /// Goes over to the first ring whose publisher is alive, else to the first that is there.
    fn search(&mut self) -> Result<(), LinkError> {
        match self.find()? {
            // The one that is open already: nothing new in it.
            Some(open) if self.source().is_some_and(|(_, life)| life == open.life) => {
                if let Some(known) = &mut self.open {
                    known.is_alive = open.is_alive;
                }
            }
            Some(open) => self.follow(open),
            None => {}
        }
        Ok(())
    }

    fn follow(&mut self, mut open: Open) {
        let count = read_u64(&open.file, COUNT_AT).unwrap_or(0);
        // Nobody knows how old the last words of the dead are.
        open.next = match self.begin {
            Newest::All => count.saturating_sub(SLOTS - 1),
            Newest::Last => count.saturating_sub(1),
        };
        if !open.is_alive {
            open.next = count;
        }
        self.close();
        self.open = Some(open);
    }

    /// Opens the first ring whose publisher is alive, else the first that is there.
    fn find(&self) -> Result<Option<Open>, LinkError> {
        let mut found: Option<Open> = None;
        let mut refused = Ok(None);
        let known = self.open.as_ref().and_then(|o| o.watched);
        for folder in self.folders.now() {
            match self.open_in(&folder) {
                Ok(Some(open)) => {
                    let better = open.is_alive || found.is_none();
                    // One that is open already has the same number as here.
                    if better
                        && let Some(old) = found.replace(open)
                        && old.watched != known
                    {
                        self.unwatch(old.watched);
                    }
                }
                Ok(None) => {}
                Err(e) => refused = Err(e),
            }
            if found.as_ref().is_some_and(|o| o.is_alive) {
                break;
            }
        }
        if found.is_some() { Ok(found) } else { refused }
    }

    fn open_in(&self, folder: &Path) -> Result<Option<Open>, LinkError> {
        let (path, service) = (
            ring_path::<M>(folder, &self.camera),
            service_name::<M>(&self.camera),
        );
        let failed = |e: io::Error| LinkError::failed(&service, e);
        let owner = match sealed(folder) {
            Ok(meta) => meta.uid(),
            Err(_) if !folder.exists() => return Ok(None),
            Err(e) => return Err(e),
        };
        let flags = OFlags::NOFOLLOW | OFlags::NONBLOCK;
        let opened = OpenOptions::new()
            .read(true)
            .custom_flags(flags.bits().cast_signed())
            .open(&path);
        let file = match opened {
            Ok(file) => file,
            Err(e) if e.kind() == io::ErrorKind::NotFound => {
                return self.other_version(folder).map_or(Ok(None), Err);
            }
            Err(e) if e.kind() == io::ErrorKind::PermissionDenied => {
                let group = fs::metadata(&path).or_else(|_| fs::metadata(folder));
                return Err(LinkError::Permission {
                    service,
                    owner,
                    group: group.map_or(owner, |m| m.gid()),
                    user: rustix::process::geteuid().as_raw(),
                });
            }
            Err(e) => return Err(failed(e)),
        };
        let meta = file.metadata().map_err(failed)?;
        // Only the folder's owner can have put it there; a file that somebody else may write holds what somebody else
        // says.
        if !meta.is_file() || meta.uid() != owner || meta.mode() & 0o022 != 0 {
            return Err(LinkError::place(
                folder,
                format!("{} is not its owner's alone", path.display()),
            ));
        }
        let header = Header::read(&file).map_err(failed)?;
        let Some(header) = header.filter(|h| h.size as usize == size_of::<M>()) else {
            // Cut short, or never finished.
            return Ok(None);
        };
        if header.version != M::VERSION {
            return Ok(None);
        }
        let watched = self.watch(&path);
        if !is_at(&file, &path) {
            self.unwatch(watched);
            return Ok(None);
        }
        Ok(Some(Open {
            folder: folder.to_owned(),
            is_alive: alive(&file),
            life: header.life,
            next: 0,
            path,
            file,
            watched,
        }))
    }

    /// Tells when the stream is published with messages that this program cannot read.
    fn other_version(&self, folder: &Path) -> Option<LinkError> {
        let stem = file_stem::<M>(&self.camera);
        fs::read_dir(folder).ok()?.flatten().find_map(|entry| {
            let found = version_of(entry.file_name().to_str()?, &stem)?;
            let is_other = found != M::VERSION && alive(&File::open(entry.path()).ok()?);
            is_other.then(|| LinkError::Version {
                service: service_name::<M>(&self.camera),
                expected: M::VERSION,
                found,
            })
        })
    }
}

impl Open {
    /// Copies the next message, whole; `false` where there is none.
    fn read(&mut self, message: &mut [u8]) -> io::Result<bool> {
        loop {
            let count = read_u64(&self.file, COUNT_AT)?;
            if self.next >= count {
                return Ok(false);
            }
            self.next = self.next.max(count.saturating_sub(SLOTS - 1));
            self.file
                .read_exact_at(message, place_of(self.next, message.len()))?;
            // SYNC POINT: each of these reads enters the kernel and takes the page's reference count, which orders
            // them.
            if self.next + SLOTS > read_u64(&self.file, COUNT_AT)? {
                self.next += 1;
                return Ok(true);
            }
        }
    }
}

/// Whether its writer gave a sign of life lately.
fn alive(file: &File) -> bool {
    match Header::read(file) {
        Ok(Some(header)) if header.alive > 0 => {
            now().abs_diff(header.alive) < GONE_AFTER.as_nanos() as u64
        }
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::message::BodyFrame;
    use crate::publisher::Publisher;

    fn silent() -> (
        tempfile::TempDir,
        Publisher<BodyFrame>,
        RingReader<BodyFrame>,
    ) {
        let folder = tempfile::tempdir().unwrap();
        let publisher = Publisher::open_at(folder.path(), "camera0").unwrap();
        let reader =
            RingReader::new(Folders::These(vec![folder.path().to_owned()]), "camera0").unwrap();
        (folder, publisher, reader)
    }

    #[test]
    fn a_message_wakes_who_waits_for_it() {
        let (_folder, mut publisher, mut reader) = silent();
        let mut took = Vec::new();
        for sequence in 0..10 {
            let message = BodyFrame {
                sequence,
                ..BodyFrame::default()
            };
            took.push(std::thread::scope(|s| {
                let waits = s.spawn(|| {
                    let begin = Instant::now();
                    while reader.read().unwrap().is_none() {
                        reader.wait(Duration::from_secs(5));
                    }
                    begin.elapsed()
                });
                std::thread::sleep(Duration::from_millis(10));
                publisher.publish(&message).unwrap();
                waits.join().unwrap()
            }));
        }
        // The shortest: any of them may have waited for the processor.
        let shortest = took.into_iter().min().unwrap();
        assert!(shortest < LOOK_EVERY / 2, "{shortest:?}");
    }

    #[test]
    fn a_short_wait_for_a_silent_publisher_is_short() {
        let (_folder, _publisher, reader) = silent();
        let wait = |_| {
            let begin = Instant::now();
            reader.wait(Duration::from_millis(1));
            begin.elapsed()
        };
        let shortest = (0..10).map(wait).min().unwrap();
        assert!(shortest < LOOK_EVERY / 2, "{shortest:?}");
    }

    #[test]
    fn a_run_is_searched_for_seldom_once_the_wait_is_long() {
        let folder = tempfile::tempdir().unwrap();
        let folders = Folders::These(vec![folder.path().to_owned()]);
        let mut reader = RingReader::<BodyFrame>::new(folders, "camera0").unwrap();
        assert_eq!(reader.look_every(), SEARCH_EVERY);
        reader.searches_since = Instant::now().checked_sub(SEARCH_EAGERLY).unwrap();
        let begin = Instant::now();
        assert!(reader.wait(Duration::from_secs(5)));
        assert!(begin.elapsed() >= LOOK_EVERY, "{:?}", begin.elapsed());
        let _publisher = Publisher::<BodyFrame>::open_at(folder.path(), "camera0").unwrap();
        reader.look().unwrap();
        assert!(reader.source().is_some());
        reader.close();
        assert_eq!(reader.look_every(), SEARCH_EVERY, "it is new again");
    }

    #[test]
    fn a_user_who_has_no_inotify_left_reads_too() {
        // None at all, and one that takes no file more.
        let refuses = || OwnedFd::from(File::open("/dev/null").unwrap());
        for watch in [None, Some(refuses())] {
            let folder = tempfile::tempdir().unwrap();
            let folders = Folders::These(vec![folder.path().to_owned()]);
            let mut reader = RingReader::<BodyFrame>::new(folders, "camera0").unwrap();
            reader.watch = watch;
            let mut publisher = Publisher::<BodyFrame>::open_at(folder.path(), "camera0").unwrap();
            for sequence in 3..6 {
                let message = BodyFrame {
                    sequence,
                    ..BodyFrame::default()
                };
                publisher.publish(&message).unwrap();
                let read = (0..1000).find_map(|_| {
                    reader.look_now().unwrap();
                    reader.wait(STEP);
                    reader.read().unwrap()
                });
                assert_eq!(read.map(|m| m.sequence), Some(sequence));
            }
            assert!(reader.is_alive());
        }
    }
}
