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
use crate::message::FLAG_END_OF_STREAM;
use crate::place::{reading_dirs, sealed};
use crate::stream::{Message, file_stem, ring_path, service_name, version_of};

/// How often a reader looks for a ring that is not there yet.
const SEARCH_EVERY: Duration = Duration::from_millis(20);

/// For how long it does so that often: at a start side by side. Later every [`LOOK_EVERY`] is soon enough.
const SEARCH_EAGERLY: Duration = Duration::from_secs(1);

/// How often a reader of a later folder looks whether somebody publishes in one before it again.
const RETURN_EVERY: Duration = Duration::from_secs(1);

/// How often it looks for a message where the kernel does not tell.
const STEP: Duration = Duration::from_millis(5);

/// A message of what was so for so long ago may be all that a camera that is away has left.
const STALE_AFTER: Duration = Duration::from_secs(2);

/// Which message a reader begins with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Newest {
    /// The newest that is there, or the next where that is stale: it came while the publisher was running already.
    Last,
    /// The oldest that is there: the reader was waiting when the publisher began.
    All,
}

/// Where a ring is looked for, the folder that comes first before the others.
#[derive(Debug, Clone)]
pub(crate) enum Folders {
    /// Where readers look: a session that begins later brings another folder.
    OfReaders,
    /// In these.
    These(Vec<PathBuf>),
}

impl Folders {
    pub(crate) fn now(&self) -> Vec<PathBuf> {
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
    /// Life of the publisher that was read before, and number of its message that comes next.
    left: Option<(u64, u64)>,
    looked: Instant,
    /// When it looked into the folders before that of the open ring.
    looked_before: Instant,
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
            left: None,
            looked: Instant::now(),
            looked_before: Instant::now(),
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

    /// As if its last look, also into the folders before, was long ago.
    #[cfg(test)]
    pub(crate) fn has_not_looked_for_long(&mut self) {
        let long_ago = Instant::now().checked_sub(RETURN_EVERY).unwrap();
        (self.looked, self.looked_before) = (long_ago, long_ago);
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
                self.return_to_those_before();
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

    /// Goes over to a publisher in a folder before that of the open ring, whose own is alive.
    fn return_to_those_before(&mut self) {
        if self.looked_before.elapsed() < RETURN_EVERY {
            return;
        }
        self.looked_before = Instant::now();
        let Some((folder, life)) = self.source() else {
            return;
        };
        let folders = self.folders.now().into_iter();
        let before: Vec<_> = folders.take_while(|f| f != folder).collect();
        match self.find_in(before) {
            // The open one by another path, watched under the same number.
            Ok(Some(found)) if found.life == life => {}
            Ok(Some(found)) if found.is_alive => self.follow(found),
            Ok(Some(found)) => self.unwatch(found.watched),
            // What is wrong with one of them is told where nothing else can be read.
            Ok(None) | Err(_) => {}
        }
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
            self.left = Some((open.life, open.next));
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
        let oldest = count.saturating_sub(SLOTS - 1);
        // A publisher in another folder may have been there for long.
        let goes_over = |from: &Open| from.folder != open.folder;
        let may_be_old = self.begin == Newest::Last || self.open.as_ref().is_some_and(goes_over);
        let is_stale = may_be_old && count > 0 && open.is_stale::<M>(count - 1);
        open.next = match (self.left, self.begin) {
            // Nobody knows how old the last words of the dead are.
            _ if is_stale || !open.is_alive => count,
            (Some((life, next)), _) if life == open.life => next.max(oldest),
            (_, Newest::All) => oldest,
            (_, Newest::Last) => count.saturating_sub(1),
        };
        self.close();
        self.open = Some(open);
    }

    /// Opens the first ring whose publisher is alive, else the first that is there.
    fn find(&self) -> Result<Option<Open>, LinkError> {
        self.find_in(self.folders.now())
    }

    fn find_in(&self, folders: Vec<PathBuf>) -> Result<Option<Open>, LinkError> {
        let mut found: Option<Open> = None;
        let mut refused = Ok(None);
        let known = self.open.as_ref().and_then(|o| o.watched);
        for folder in folders {
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
            // A pipe would be waited for.
            let flags = OFlags::NOFOLLOW | OFlags::NONBLOCK;
            let opened = OpenOptions::new()
                .read(true)
                .custom_flags(flags.bits().cast_signed())
                .open(entry.path());
            let is_other = found != M::VERSION && alive(&opened.ok()?);
            is_other.then(|| LinkError::Version {
                service: service_name::<M>(&self.camera),
                expected: M::VERSION,
                found,
            })
        })
    }
}

impl Open {
    /// Whether message `n` tells what was so a while ago and may not be any more. The end of a stream stays one.
    fn is_stale<M: Message>(&self, n: u64) -> bool {
        let mut message = Box::<M>::default();
        let at = place_of(n, size_of::<M>());
        let read = self.file.read_exact_at(message.as_mut_bytes(), at);
        let is_old = |told: u64| now().saturating_sub(told) > STALE_AFTER.as_nanos() as u64;
        read.is_ok()
            && message.flags() & FLAG_END_OF_STREAM == 0
            && message.told_ns().is_some_and(is_old)
    }

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
    use rustix::fs::Mode;

    use super::*;
    use crate::message::{BodyFrame, EventFrame, PictureFrame};
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

    #[test]
    fn a_reader_returns_to_the_folder_that_comes_first() {
        let [own, service] = [(); 2].map(|()| tempfile::tempdir().unwrap());
        let open = |folder: &Path| Publisher::<BodyFrame>::open_at(folder, "camera0").unwrap();
        let _service = open(service.path());
        let folders = [&own, &service].map(|f| f.path().to_owned());
        let folders = Folders::These(folders.to_vec());
        let mut reader = RingReader::<BodyFrame>::new(folders, "camera0").unwrap();
        assert_eq!(reader.source().unwrap().0, service.path());
        let _own = open(own.path());
        // On a busy machine signs of life may come late.
        let returns = (0..1000).any(|n| {
            std::thread::sleep(Duration::from_millis(10 * n.min(1)));
            reader.looked_before = Instant::now().checked_sub(RETURN_EVERY).unwrap();
            reader.look_now().unwrap();
            reader.source().unwrap().0 == own.path()
        });
        assert!(returns);
    }

    #[test]
    fn another_path_to_what_is_read_is_no_other_publisher() {
        let [all, real] = [(); 2].map(|()| tempfile::tempdir().unwrap());
        let (own, path) = (all.path().join("own"), real.path().join("run"));
        let _publisher = Publisher::<BodyFrame>::open_at(&path, "camera0").unwrap();
        let folders = Folders::These(vec![own.join("run"), path.clone()]);
        let mut reader = RingReader::<BodyFrame>::new(folders, "camera0").unwrap();
        std::os::unix::fs::symlink(real.path(), &own).unwrap();
        assert!(reader.open_in(&own.join("run")).unwrap().is_some());
        reader.looked_before = Instant::now().checked_sub(RETURN_EVERY).unwrap();
        reader.return_to_those_before();
        assert_eq!(reader.source().unwrap().0, path);
    }

    /// Two publishers, and a reader that waits for a third.
    fn two() -> (
        [tempfile::TempDir; 2],
        [Publisher<BodyFrame>; 2],
        RingReader<BodyFrame>,
    ) {
        let folders = [(); 2].map(|()| tempfile::tempdir().unwrap());
        let publishers = folders
            .each_ref()
            .map(|f| Publisher::open_at(f.path(), "camera0").unwrap());
        let reader = RingReader::new(Folders::These(Vec::new()), "camera0").unwrap();
        (folders, publishers, reader)
    }

    fn go_over(reader: &mut RingReader<BodyFrame>, folder: &Path) {
        let mut found = reader.open_in(folder).unwrap().unwrap();
        // On a busy machine signs of life may come late.
        found.is_alive = true;
        reader.follow(found);
    }

    fn publish(publisher: &mut Publisher<BodyFrame>, sequence: u64, publish_ns: u64) {
        let message = BodyFrame {
            sequence,
            publish_ns,
            ..BodyFrame::default()
        };
        publisher.publish(&message).unwrap();
    }

    fn unread(reader: &mut RingReader<BodyFrame>) -> Vec<u64> {
        std::iter::from_fn(|| reader.read().unwrap().map(|m| m.sequence)).collect()
    }

    #[test]
    fn who_goes_over_to_another_folder_and_returns_reads_nothing_twice() {
        let ([own, service], [mut first, mut second], mut reader) = two();
        go_over(&mut reader, own.path());
        publish(&mut first, 1, u64::MAX);
        publish(&mut second, 11, u64::MAX);
        assert_eq!(unread(&mut reader), [1]);
        go_over(&mut reader, service.path());
        assert_eq!(unread(&mut reader), [11]);
        publish(&mut first, 2, u64::MAX);
        go_over(&mut reader, own.path());
        assert_eq!(unread(&mut reader), [2]);
        go_over(&mut reader, service.path());
        assert!(unread(&mut reader).is_empty());
        for sequence in 0..2 * SLOTS {
            publish(&mut first, sequence, u64::MAX);
        }
        go_over(&mut reader, own.path());
        let newest: Vec<_> = (SLOTS + 1..2 * SLOTS).collect();
        assert_eq!(unread(&mut reader), newest);
    }

    #[test]
    fn nobody_who_was_seen_long_ago_is_shown_to_who_goes_over_to_another_folder() {
        let ([own, service], [_first, mut second], mut reader) = two();
        let long_ago = now().saturating_sub(10_000_000_000).max(1);
        go_over(&mut reader, own.path());
        publish(&mut second, 11, long_ago);
        go_over(&mut reader, service.path());
        assert!(unread(&mut reader).is_empty());
        publish(&mut second, 12, u64::MAX);
        assert_eq!(unread(&mut reader), [12]);
        // Left before it was read.
        publish(&mut second, 13, long_ago);
        go_over(&mut reader, own.path());
        go_over(&mut reader, service.path());
        assert!(unread(&mut reader).is_empty());
    }

    /// The first message that a reader gets who comes after one of `sent` was published.
    fn first<M: Message>(sent: &M) -> Option<Box<M>> {
        let folder = tempfile::tempdir().unwrap();
        let mut publisher = Publisher::<M>::open_at(folder.path(), "camera0").unwrap();
        publisher.publish(sent).unwrap();
        let open = |_| {
            let folders = Folders::These(vec![folder.path().to_owned()]);
            let reader = RingReader::<M>::new(folders, "camera0").unwrap();
            // On a busy machine signs of life may come late.
            reader.is_alive().then_some(reader)
        };
        let reader = (0..100_000).find_map(open);
        reader.expect("it publishes").read().unwrap()
    }

    #[test]
    fn nobody_who_was_seen_long_ago_is_shown_to_a_new_reader() {
        let long_ago = now().saturating_sub(10_000_000_000).max(1);
        let seen = |publish_ns, flags| BodyFrame {
            publish_ns,
            flags,
            ..BodyFrame::default()
        };
        assert!(first(&seen(long_ago, 0)).is_none());
        // Published in the future: nothing takes so long that it is stale.
        assert!(first(&seen(u64::MAX, 0)).is_some());
        assert!(first(&seen(0, 0)).is_some(), "nobody knows how old it is");
        assert!(first(&seen(long_ago, FLAG_END_OF_STREAM)).is_some());
        let happened = EventFrame {
            publish_ns: long_ago,
            ..EventFrame::default()
        };
        assert!(first(&happened).is_some(), "it has happened");
        let picture = PictureFrame {
            publish_ns: long_ago,
            ..PictureFrame::default()
        };
        assert!(first(&picture).is_some(), "it holds until the next");
    }

    #[test]
    fn a_pipe_in_the_place_of_a_stream_is_not_waited_for() {
        let folder = tempfile::tempdir().unwrap();
        let (said, hears) = std::sync::mpsc::channel();
        for (camera, version) in [("camera0", 999), ("camera1", BodyFrame::VERSION)] {
            let path = folder.path().join(format!("{camera}.bodies.v{version}"));
            let (kind, mode) = (rustix::fs::FileType::Fifo, Mode::RUSR | Mode::WUSR);
            rustix::fs::mknodat(rustix::fs::CWD, &path, kind, mode, 0).unwrap();
            let folders = Folders::These(vec![folder.path().to_owned()]);
            let said = said.clone();
            std::thread::spawn(move || {
                let opened = RingReader::<BodyFrame>::new(folders, camera);
                said.send(opened.is_ok()).unwrap();
            });
        }
        let mut heard = [(); 2].map(|()| hears.recv_timeout(Duration::from_secs(20)).unwrap());
        heard.sort_unstable();
        assert_eq!(
            heard,
            [false, true],
            "nothing is published, and what is no stream is refused"
        );
    }
}
