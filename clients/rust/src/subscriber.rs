//! Reading a stream: waits in the kernel, wakes within microseconds of a message.
//!
//! Every reader follows the stream's file. A program of the same user also joins the publisher's iceoryx2 domain and
//! gets the messages there in place; the file gives it what came before it had joined and what does not reach it there,
//! and tells it when the publisher has gone.

use core::cell::RefCell;
use core::ops::Deref;
use core::time::Duration;
use std::path::Path;
use std::rc::Rc;
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use iceoryx2::port::listener::{Listener, ListenerCreateError, ListenerWaitError};
use iceoryx2::port::subscriber::Subscriber as Port;
use iceoryx2::prelude::PortFactory;
use iceoryx2::sample::Sample;

use crate::domain::{Domain, reserve_for_a_moment};
use crate::error::LinkError;
use crate::link::{Link, MAX_SUBSCRIBERS, Side};
use crate::message::{FLAG_END_OF_STREAM, FLAG_FILE_TIME};
use crate::place;
use crate::ring::{BUFFER, Folders, LOOK_EVERY, RingReader};
use crate::service::FileService;
use crate::stream::{Message, check_camera, service_name};

/// The kernel counts waits in microseconds and takes none for a wait without end: shorter ones only look.
const SHORTEST_WAIT: Duration = Duration::from_micros(10);

/// How long after a reader joined, or found no place, it tries again where it has none: by then the publisher has freed
/// those of killed readers.
const TRY_AGAIN: Duration = Duration::from_secs(10);

/// What must be free for a reader to join, bytes: several times what it writes into its own files there.
const ROOM_TO_JOIN: u64 = 256 << 10;

/// What the last message of a file says.
const END_OF_FILE: u32 = FLAG_END_OF_STREAM | FLAG_FILE_TIME;

/// Held while a socket is bound. iceoryx2 then sets the process's umask to 0177 and back to what it found: a thread
/// that finds what another has set leaves it for good.
static BINDING: Mutex<()> = Mutex::new(());

/// Where a reader looks, and which places it may take.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Priority {
    /// Any program: it looks in this user's folder and in the service's, and takes one of [`MAX_SUBSCRIBERS`] places.
    #[default]
    Reader,
    /// One of edgecap's own processes: it looks in this user's folder only, and has a place kept.
    Reserved,
}

/// A reader of a stream; any process on the machine may have several.
#[derive(Debug)]
pub struct Subscriber<M: Message>(RefCell<Inner<M>>);

#[derive(Debug)]
struct Inner<M: Message> {
    camera: String,
    priority: Priority,
    ring: RingReader<M>,
    /// The publisher's life that was joined at `tried`, or could not be.
    life: Option<u64>,
    tried: Instant,
    joined: Option<Joined<M>>,
}

/// A connection through iceoryx2.
#[derive(Debug)]
struct Joined<M: Message> {
    port: Port<FileService, M, u64>,
    listener: Listener<FileService>,
    link: Link<M>,
    /// Messages before this number are in the file.
    from: u64,
    /// The last message, where the file gave it before it was sent.
    unsent: Option<u64>,
}

/// A message, read-only. Drop it before taking the third one.
#[derive(Debug)]
pub struct Received<M: Message>(Memory<M>);

#[derive(Debug)]
enum Memory<M: Message> {
    Shared {
        sample: Sample<FileService, M, u64>,
        /// Where the sample lies.
        _domain: Rc<Domain>,
    },
    Copied(Box<M>),
}

impl<M: Message> Deref for Received<M> {
    type Target = M;
    fn deref(&self) -> &M {
        match &self.0 {
            Memory::Shared { sample, .. } => sample.payload(),
            Memory::Copied(message) => message,
        }
    }
}

impl<M: Message> Received<M> {
    /// In memory of its own.
    fn copied(self) -> Self {
        Self(Memory::Copied(Box::new(*self)))
    }
}

impl<M: Message> Subscriber<M> {
    /// Connects to `camera`'s stream, which need not exist yet. Where it does, the newest message comes first; of those
    /// that tell what is so at a moment, as bodies do, the next one where that is more than two seconds old and does
    /// not end the stream.
    ///
    /// # Errors
    /// [`LinkError`], as its texts say.
    pub fn open(camera: &str) -> Result<Self, LinkError> {
        Self::open_with(camera, Priority::Reader)
    }

    /// As [`open`](Self::open), with a priority.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    pub fn open_with(camera: &str, priority: Priority) -> Result<Self, LinkError> {
        let folders = match priority {
            Priority::Reader => Folders::OfReaders,
            Priority::Reserved => Folders::These(vec![place::runtime_dir()]),
        };
        Self::open_in(folders, camera, priority)
    }

    /// As [`open`](Self::open), in another installation's folder.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    pub fn open_at(folder: &Path, camera: &str) -> Result<Self, LinkError> {
        let folders = Folders::These(vec![place::from_here(folder)]);
        Self::open_in(folders, camera, Priority::Reader)
    }

    fn open_in(folders: Folders, camera: &str, priority: Priority) -> Result<Self, LinkError> {
        check_camera(camera)?;
        let mut inner = Inner {
            camera: camera.to_owned(),
            priority,
            ring: RingReader::new(folders, camera)?,
            life: None,
            tried: Instant::now(),
            joined: None,
        };
        inner.join();
        Ok(Self(RefCell::new(inner)))
    }

    /// The oldest message not yet read, waiting up to `timeout` for one; `None` when none came. A signal that this
    /// process handles ends the wait early, so that the caller can look at its stop flag.
    ///
    /// # Errors
    /// [`LinkError::SharedMemory`]; [`LinkError::Version`] and [`LinkError::Permission`] of a publisher that has come
    /// since.
    pub fn next(&self, timeout: Duration) -> Result<Option<Received<M>>, LinkError> {
        let began = Instant::now();
        let mut inner = self.0.borrow_mut();
        loop {
            // Also where there always is a message: a publisher in an earlier folder would never be seen.
            inner.look()?;
            if let Some(m) = inner.receive()? {
                return Ok(Some(m));
            }
            // SYNC POINT: a message is sent before its wake-up, so after a wake-up there is something to receive,
            // unless the wake-up belongs to a message that was read before it was waited for: then the wait goes on.
            let left = timeout.saturating_sub(began.elapsed());
            if left < SHORTEST_WAIT {
                inner.forget_wake_ups();
                return inner.receive();
            }
            if !inner.wait(left)? {
                return inner.receive();
            }
        }
    }

    /// The newest message, discarding older unread ones, and all of a publisher that another one has followed; waits up
    /// to `timeout` if there is none.
    ///
    /// # Errors
    /// As [`next`](Self::next).
    pub fn newest(&self, timeout: Duration) -> Result<Option<Received<M>>, LinkError> {
        self.0.borrow_mut().leave_the_dead()?;
        let mut newest = self.next(timeout)?;
        let mut inner = self.0.borrow_mut();
        if inner.joined.is_none() {
            inner.ring.skip();
        }
        while inner.has_more() {
            // iceoryx2 lends two: the caller may hold one, and the next is another.
            newest = newest.map(Received::copied);
            match inner.receive()? {
                Some(m) => newest = Some(m),
                None => break,
            }
        }
        Ok(newest)
    }

    /// Every message, oldest unread first, until a file ends; waits where nobody publishes, also for a camera's run
    /// that was stopped. Drop each before taking the third one.
    ///
    /// # Errors
    /// As [`next`](Self::next).
    pub fn messages(&self) -> impl Iterator<Item = Result<Received<M>, LinkError>> + '_ {
        let mut has_ended = false;
        std::iter::from_fn(move || {
            while !has_ended {
                let message = self.next(LOOK_EVERY).transpose();
                if let Some(message) = message {
                    has_ended = match &message {
                        Ok(m) => m.flags() & END_OF_FILE == END_OF_FILE,
                        Err(_) => true,
                    };
                    return Some(message);
                }
            }
            None
        })
    }

    /// Writers there are now: 0 or 1. One that died is gone within a second.
    pub fn publisher_count(&self) -> usize {
        let mut inner = self.0.borrow_mut();
        // What cannot be read is no writer of this stream; `next` tells why.
        let _ = inner.ring.look_now();
        inner.join();
        usize::from(inner.ring.is_published())
    }
}

impl<M: Message> Inner<M> {
    /// Follows the stream to the publisher that is alive.
    fn look(&mut self) -> Result<(), LinkError> {
        self.ring.look()?;
        self.join();
        Ok(())
    }

    /// As [`look`](Self::look), and leaves what the dead left where somebody else publishes.
    fn leave_the_dead(&mut self) -> Result<(), LinkError> {
        self.ring.leave_the_dead()?;
        self.join();
        Ok(())
    }

    /// Joins the publisher's domain if it is this user's. Where that fails, the file is enough.
    fn join(&mut self) {
        let source = self.ring.source();
        if !self.ring.is_alive() {
            // All of it is read: the dead's memory is let go. One that was only silent is joined again when it is back.
            if self.ring.position() >= self.ring.count() {
                (self.life, self.joined) = (None, None);
            }
            return;
        }
        let waits = self.joined.is_some() || self.tried.elapsed() < TRY_AGAIN;
        if source.map(|(_, life)| life) == self.life && waits {
            return;
        }
        let Some((folder, life)) = source else {
            return;
        };
        let folder = folder.to_owned();
        (self.life, self.joined, self.tried) = (Some(life), None, Instant::now());
        // Nothing may be written into memory that is not there: first a look, then what is there is reserved.
        if reserve_for_a_moment(&folder, ROOM_TO_JOIN).is_ok()
            && let Ok(Some(domain)) = Domain::join(&folder, life)
        {
            let joined = Joined::new(domain, &self.camera, self.priority);
            self.joined = joined
                .ok()
                .filter(|joined| joined.link.domain.reserve().is_ok());
        }
        if let Some(joined) = &mut self.joined {
            // SYNC POINT: a message is in the file before it is sent, so what is not in the file by now is sent to us.
            joined.from = self.ring.count();
        }
    }

    fn receive(&mut self) -> Result<Option<Received<M>>, LinkError> {
        let copied = |m| Received(Memory::Copied(m));
        let Some(joined) = &mut self.joined else {
            return Ok(self.ring.read()?.map(copied));
        };
        if self.ring.position() < joined.from
            && let Some(m) = self.ring.read()?
        {
            return Ok(Some(copied(m)));
        }
        // SYNC POINT: a message is sent before the next one is written, and this is read before what was sent: of those
        // that are in the file by now, at most the last is still to come.
        let written = self.ring.count();
        let failed = |e| LinkError::failed(&service_name::<M>(&self.camera), e);
        while let Some(sample) = joined.port.receive().map_err(failed)? {
            joined.unsent = None;
            let number = *sample.user_header();
            if number >= self.ring.position() {
                self.ring.pass(number);
                let _domain = joined.link.domain.clone();
                return Ok(Some(Received(Memory::Shared { sample, _domain })));
            }
        }
        let next = self.ring.position();
        if next >= written {
            return Ok(None);
        }
        // About to be sent; or never, by a publisher that has died, or one that took this reader for dead.
        if written > joined.unsent.unwrap_or(next) + 1 {
            // The place is lost: as where none was found, the file is enough until it is time to try again.
            self.joined = None;
        } else {
            joined.unsent = Some(next);
        }
        Ok(self.ring.read()?.map(copied))
    }

    /// Whether a message may be there to be received.
    fn has_more(&self) -> bool {
        self.ring.position() < self.ring.count()
    }

    /// Waits for a wake-up, or until it is time to look; `false` where a signal ended the wait.
    fn wait(&self, timeout: Duration) -> Result<bool, LinkError> {
        let Some(joined) = &self.joined else {
            return Ok(self.ring.wait(timeout));
        };
        match joined.listener.timed_wait(|_| {}, timeout.min(LOOK_EVERY)) {
            Ok(_) => Ok(true),
            Err(ListenerWaitError::InterruptSignal) => Ok(false),
            Err(e) => Err(LinkError::failed(&service_name::<M>(&self.camera), e)),
        }
    }

    /// So that waits of no length do not pile them up.
    fn forget_wake_ups(&self) {
        match &self.joined {
            Some(joined) => {
                let _ = joined.listener.try_wait(|_| {});
            }
            None => self.ring.forget_events(),
        }
    }
}

impl<M: Message> Joined<M> {
    fn new(domain: Domain, camera: &str, priority: Priority) -> Result<Self, LinkError> {
        let service = service_name::<M>(camera);
        let failed = |e: &dyn core::fmt::Display| LinkError::failed(&service, e);
        let link = Link::<M>::open(domain, camera, Side::Reader)?;
        let readers = link.messages.dynamic_config().number_of_subscribers();
        if priority == Priority::Reader && readers >= MAX_SUBSCRIBERS {
            return Err(failed(&"no place left"));
        }
        let listener = listener(&link).map_err(|e| failed(&e))?;
        let port = link
            .messages
            .subscriber_builder()
            .buffer_size(BUFFER)
            .create();
        Ok(Self {
            port: port.map_err(|e| failed(&e))?,
            listener,
            link,
            from: 0,
            unsent: None,
        })
    }
}

/// What is woken by a stream's messages, which has a socket of its own. No other is bound meanwhile in this process.
fn listener<M: Message>(link: &Link<M>) -> Result<Listener<FileService>, ListenerCreateError> {
    let _alone = BINDING.lock().unwrap_or_else(PoisonError::into_inner);
    link.wake.listener_builder().create()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::message::BodyFrame;
    use crate::publisher::Publisher;

    /// The permissions that this process keeps back, as the kernel tells them while no socket is bound.
    fn kept_back() -> String {
        let _alone = BINDING.lock().unwrap_or_else(PoisonError::into_inner);
        let status = std::fs::read_to_string("/proc/self/status").unwrap();
        let line = status.lines().find(|line| line.starts_with("Umask:"));
        line.unwrap().to_owned()
    }

    #[test]
    fn threads_that_join_at_once_leave_the_process_the_permissions_of_its_files() {
        let folder = tempfile::tempdir().unwrap();
        let _publisher = Publisher::<BodyFrame>::open_at(folder.path(), "camera0").unwrap();
        let before = kept_back();
        std::thread::scope(|threads| {
            for _ in 0..4 {
                threads.spawn(|| {
                    let reader = Subscriber::<BodyFrame>::open_at(folder.path(), "camera0");
                    let mut inner = reader.unwrap().0.into_inner();
                    assert!(joins(&mut inner));
                    let link = &inner.joined.as_ref().unwrap().link;
                    for _ in 0..500 {
                        drop(listener(link).unwrap());
                    }
                });
            }
        });
        assert_eq!(kept_back(), before);
    }

    /// Looks until the publisher is joined: on a busy machine it may give its signs of life late.
    fn joins(inner: &mut Inner<BodyFrame>) -> bool {
        (0..1000).any(|_| {
            inner.ring.look_now().unwrap();
            inner.join();
            if inner.joined.is_none() {
                std::thread::sleep(Duration::from_millis(10));
            }
            inner.joined.is_some()
        })
    }

    #[test]
    fn a_reader_without_a_place_takes_one_that_is_freed() {
        let folder = tempfile::tempdir().unwrap();
        let mut publisher = Publisher::<BodyFrame>::open_at(folder.path(), "camera0").unwrap();
        let open = || Subscriber::<BodyFrame>::open_at(folder.path(), "camera0").unwrap();
        let mut others: Vec<_> = (0..MAX_SUBSCRIBERS).map(|_| open()).collect();
        assert_eq!(publisher.subscriber_count(), MAX_SUBSCRIBERS);
        let mut inner = open().0.into_inner();
        others.pop();
        inner.join();
        assert!(inner.joined.is_none());
        publisher.publish(&BodyFrame::default()).unwrap();
        assert!(inner.receive().unwrap().is_some());
        inner.tried = Instant::now().checked_sub(TRY_AGAIN).unwrap();
        inner.join();
        assert!(inner.joined.is_some());
        assert!(inner.receive().unwrap().is_none());
        publisher.publish(&BodyFrame::default()).unwrap();
        assert!(inner.receive().unwrap().is_some());
    }

    #[test]
    fn the_newest_is_there_while_the_one_before_is_held() {
        let folder = tempfile::tempdir().unwrap();
        let mut publisher = Publisher::<BodyFrame>::open_at(folder.path(), "camera0").unwrap();
        let reader = Subscriber::<BodyFrame>::open_at(folder.path(), "camera0").unwrap();
        assert!(joins(&mut reader.0.borrow_mut()));
        let mut publish = |sequence| {
            let message = BodyFrame {
                sequence,
                ..BodyFrame::default()
            };
            publisher.publish(&message).unwrap();
        };
        publish(0);
        let held = reader.next(Duration::from_secs(20)).unwrap().unwrap();
        (1..5).for_each(&mut publish);
        let newest = reader.newest(Duration::from_secs(20)).unwrap().unwrap();
        assert_eq!((held.sequence, newest.sequence), (0, 4));
        assert!(reader.newest(Duration::ZERO).unwrap().is_none());
    }

    fn numbered(sequence: u64) -> BodyFrame {
        BodyFrame {
            sequence,
            ..BodyFrame::default()
        }
    }

    /// Number of the message that comes next, and whether it came in place.
    fn received(inner: &mut Inner<BodyFrame>) -> Option<(u64, bool)> {
        let got = inner.receive().unwrap()?;
        Some((got.sequence, matches!(got.0, Memory::Shared { .. })))
    }

    fn publish(publisher: &mut Publisher<BodyFrame>, sequence: u64) {
        publisher.publish(&numbered(sequence)).unwrap();
    }

    /// Looks until somebody publishes: on a busy machine signs of life may come late.
    fn is_published(reader: &Subscriber<BodyFrame>) -> bool {
        (0..1000).any(|n| {
            std::thread::sleep(Duration::from_millis(10 * n.min(1)));
            reader.publisher_count() == 1
        })
    }

    #[test]
    fn a_publisher_that_came_back_is_counted_before_the_messages_of_the_dead_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let open = || Publisher::<BodyFrame>::open_at(folder.path(), "camera0").unwrap();
        let mut first = open();
        let reader = Subscriber::<BodyFrame>::open_at(folder.path(), "camera0").unwrap();
        publish(&mut first, 1);
        publish(&mut first, 2);
        drop(first);
        assert_eq!(reader.publisher_count(), 0);
        let mut second = open();
        publish(&mut second, 3);
        assert!(is_published(&reader));
        for n in 1..4 {
            let got = reader.next(Duration::from_secs(20)).unwrap().unwrap();
            assert_eq!(got.sequence, n, "nothing is left out");
        }
    }

    #[test]
    fn the_newest_is_of_who_publishes_and_not_of_the_dead() {
        let folder = tempfile::tempdir().unwrap();
        let open = || Publisher::<BodyFrame>::open_at(folder.path(), "camera0").unwrap();
        for asks in [true, false] {
            let mut first = open();
            let reader = Subscriber::<BodyFrame>::open_at(folder.path(), "camera0").unwrap();
            publish(&mut first, 1);
            drop(first);
            assert_eq!(reader.publisher_count(), 0);
            let mut second = open();
            publish(&mut second, 2);
            if asks {
                assert!(is_published(&reader));
            } else {
                std::thread::sleep(LOOK_EVERY + LOOK_EVERY / 4);
                let other = Subscriber::<BodyFrame>::open_at(folder.path(), "camera0").unwrap();
                assert!(is_published(&other));
            }
            let newest = reader.newest(Duration::from_secs(20)).unwrap().unwrap();
            assert_eq!(newest.sequence, 2);
            assert!(reader.newest(Duration::ZERO).unwrap().is_none());
        }
    }

    #[test]
    fn a_reader_that_always_has_a_message_returns_to_the_folder_that_comes_first() {
        let [own, service] = [(); 2].map(|()| tempfile::tempdir().unwrap());
        let open = |folder: &Path| Publisher::<BodyFrame>::open_at(folder, "camera0").unwrap();
        let mut second = open(service.path());
        let folders = [&own, &service].map(|f| f.path().to_owned());
        let folders = Folders::These(folders.to_vec());
        let reader =
            Subscriber::<BodyFrame>::open_in(folders, "camera0", Priority::Reader).unwrap();
        let mut first = open(own.path());
        // On a busy machine signs of life may come late.
        let returns = (0..1000).any(|n| {
            std::thread::sleep(Duration::from_millis(10 * n.min(1)));
            publish(&mut second, n);
            reader.0.borrow_mut().ring.has_not_looked_for_long();
            reader.next(Duration::ZERO).unwrap();
            let inner = reader.0.borrow();
            inner.ring.source().unwrap().0 == own.path()
        });
        assert!(returns);
        publish(&mut first, 1000);
        let got = reader.next(Duration::from_secs(20)).unwrap().unwrap();
        assert_eq!(got.sequence, 1000);
    }

    #[test]
    fn a_publisher_that_was_silent_for_a_while_is_joined_again() {
        let folder = tempfile::tempdir().unwrap();
        let mut publisher = Publisher::<BodyFrame>::open_at(folder.path(), "camera0").unwrap();
        let reader = Subscriber::<BodyFrame>::open_at(folder.path(), "camera0").unwrap();
        let mut inner = reader.0.into_inner();
        let is_shared =
            |m: &Option<Received<BodyFrame>>| matches!(m, Some(Received(Memory::Shared { .. })));
        assert!(joins(&mut inner));
        publisher.publish(&BodyFrame::default()).unwrap();
        assert!(is_shared(&inner.receive().unwrap()));
        inner.ring.take_for_dead();
        inner.join();
        assert!(inner.joined.is_none());
        assert!(joins(&mut inner));
        publisher.publish(&BodyFrame::default()).unwrap();
        assert!(is_shared(&inner.receive().unwrap()));
    }

    #[test]
    fn a_message_that_is_read_before_it_is_sent_comes_once() {
        let folder = tempfile::tempdir().unwrap();
        let mut publisher = Publisher::<BodyFrame>::open_at(folder.path(), "camera0").unwrap();
        let reader = Subscriber::<BodyFrame>::open_at(folder.path(), "camera0").unwrap();
        let mut inner = reader.0.into_inner();
        assert!(joins(&mut inner));
        for n in [0, 2, 4] {
            let number = publisher.write(&numbered(n)).unwrap();
            assert!(inner.has_more());
            assert_eq!(received(&mut inner), Some((n, false)));
            publisher.send(number, &numbered(n)).unwrap();
            assert_eq!(received(&mut inner), None);
            publish(&mut publisher, n + 1);
            assert_eq!(received(&mut inner), Some((n + 1, true)));
        }
    }

    #[test]
    fn a_reader_that_nothing_is_sent_to_reads_the_file_and_joins_anew() {
        let folder = tempfile::tempdir().unwrap();
        let mut publisher = Publisher::<BodyFrame>::open_at(folder.path(), "camera0").unwrap();
        // Read one by one, and all at once.
        for all in [false, true] {
            let reader = Subscriber::<BodyFrame>::open_at(folder.path(), "camera0").unwrap();
            let mut inner = reader.0.into_inner();
            assert!(joins(&mut inner));
            while received(&mut inner).is_some() {}
            publish(&mut publisher, 0);
            assert_eq!(received(&mut inner), Some((0, true)));
            for n in 1..3 {
                publisher.write(&numbered(n)).unwrap();
                if !all {
                    assert_eq!(received(&mut inner), Some((n, false)));
                }
            }
            if all {
                assert_eq!(received(&mut inner), Some((1, false)));
                assert_eq!(received(&mut inner), Some((2, false)));
            }
            assert!(inner.joined.is_none(), "the place is lost");
            publish(&mut publisher, 3);
            assert_eq!(received(&mut inner), Some((3, false)));
            inner.tried = Instant::now().checked_sub(TRY_AGAIN).unwrap();
            assert!(joins(&mut inner));
            publish(&mut publisher, 4);
            assert_eq!(received(&mut inner), Some((4, true)));
            assert_eq!(received(&mut inner), None);
        }
    }
}
