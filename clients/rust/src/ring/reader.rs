//! A reader of a ring: finds it, follows it from one publisher to the next.

use std::marker::PhantomData;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use super::open::{Open, is_damage};
use super::watch::Watch;
use super::{LOOK_EVERY, SLOTS};
use crate::error::LinkError;
use crate::place::reading_dirs;
use crate::stream::{Message, service_name};

/// How often a reader looks for a ring that is not there yet.
const SEARCH_EVERY: Duration = Duration::from_millis(20);

/// For how long it does so that often: at a start side by side. Later every [`LOOK_EVERY`] is soon enough.
const SEARCH_EAGERLY: Duration = Duration::from_secs(1);

/// How often a reader of a later folder looks whether somebody publishes in one before it again.
const RETURN_EVERY: Duration = Duration::from_secs(1);

/// How often it looks for a message where the kernel does not tell.
const STEP: Duration = Duration::from_millis(5);

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
    watch: Watch,
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

impl<M: Message> RingReader<M> {
    /// Looks for the stream, which need not be there.
    ///
    /// # Errors
    /// [`LinkError`], as its texts say.
    pub(crate) fn new(folders: Folders, camera: &str) -> Result<Self, LinkError> {
        let mut reader = Self {
            folders,
            camera: camera.to_owned(),
            watch: Watch::new(),
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
        self.open.as_ref().map_or(0, Open::count)
    }

    /// Goes on after message `n`, which the caller got otherwise.
    pub(crate) fn pass(&mut self, n: u64) {
        if let Some(open) = &mut self.open {
            open.next = n.saturating_add(1);
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
            if open.look() {
                self.watch_again();
                self.return_to_those_before();
                return Ok(());
            }
            if open.count() > open.next {
                self.look_past(leaves);
                return Ok(());
            }
        }
        self.search()
    }

    /// Watches the open ring where the kernel refused it: others may have given theirs back since.
    fn watch_again(&mut self) {
        if let Some(open) = &mut self.open
            && open.watched.is_none()
        {
            open.watched = self.watch.add(&open.path);
        }
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
            Ok(Some(found)) => self.watch.remove(found.watched),
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
            self.watch.remove(found.watched);
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
            // Somebody cut it short, or wrote into it: as good as not there.
            Err(e) if is_damage(&e) => {
                self.close();
                Ok(None)
            }
            Err(e) => Err(LinkError::failed(&service_name::<M>(&self.camera), e)),
        }
    }

    /// Goes over to the newest message, so that [`read`](Self::read) gives that.
    pub(crate) fn skip(&mut self) {
        if let Some(open) = &mut self.open {
            open.next = open.next.max(open.count().saturating_sub(1));
        }
    }

    /// Waits for a message, for a publisher, or until it is time to look again; `false` where a signal ended the wait.
    pub(crate) fn wait(&self, timeout: Duration) -> bool {
        let step = match &self.open {
            // In what the dead left nothing comes.
            Some(open) if open.watched.is_none() && open.is_alive => STEP,
            _ => self.look_every(),
        };
        self.watch.wait(step.min(timeout))
    }

    /// The next wait waits for what comes after this.
    pub(crate) fn forget_events(&self) {
        self.watch.forget();
    }

    fn close(&mut self) {
        if let Some(open) = self.open.take() {
            self.left = Some((open.life, open.next));
            self.watch.remove(open.watched);
            self.searches_since = Instant::now();
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
        let count = open.count();
        let oldest = count.saturating_sub(SLOTS - 1);
        // A publisher in another folder may have been there for long.
        let goes_over = |from: &Open| from.folder != open.folder;
        let may_be_old = self.begin == Newest::Last || self.open.as_ref().is_some_and(goes_over);
        let is_stale = may_be_old && count > 0 && open.is_stale::<M>(count - 1);
        open.next = match (self.left, self.begin) {
            // Nobody knows how old the last words of the dead are.
            _ if is_stale || !open.is_alive => count,
            (Some((life, next)), _) if life == open.life => next.max(oldest).min(count),
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
                        self.watch.remove(old.watched);
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
        Open::find::<M>(folder, &self.camera, &self.watch)
    }
}

#[cfg(test)]
mod tests;
