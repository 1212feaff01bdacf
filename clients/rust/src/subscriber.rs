//! Reading a stream: waits in the kernel, wakes within microseconds of a message.

use core::cell::Cell;
use core::ops::Deref;
use core::time::Duration;
use std::time::Instant;

use iceoryx2::port::listener::{Listener, ListenerCreateError, ListenerWaitError};
use iceoryx2::port::subscriber::{Subscriber as Port, SubscriberCreateError};
use iceoryx2::prelude::*;
use iceoryx2::sample::Sample;

use crate::link::{BUFFER, Link, LinkError, MAX_SUBSCRIBERS, Message};

/// The kernel counts waits in microseconds and takes none for a wait without end: shorter ones only look.
const SHORTEST_WAIT: Duration = Duration::from_micros(10);

/// How old knowledge of who has died may be.
const LOOK_EVERY: Duration = Duration::from_millis(250);

/// Which places a reader may take.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Priority {
    /// One of [`MAX_SUBSCRIBERS`].
    #[default]
    Reader,
    /// Also one of those kept for edgecap's own processes.
    Reserved,
}

/// A reader of a stream; any process on the machine may have several.
#[derive(Debug)]
pub struct Subscriber<M: Message> {
    port: Port<ipc::Service, M, ()>,
    listener: Listener<ipc::Service>,
    link: Link<M>,
    looked: Cell<Option<Instant>>,
}

/// A message, in place in shared memory (read-only). Drop it before taking the third one.
#[derive(Debug)]
pub struct Received<M: Message>(Sample<ipc::Service, M, ()>);

impl<M: Message> Deref for Received<M> {
    type Target = M;
    fn deref(&self) -> &M {
        self.0.payload()
    }
}

impl<M: Message> Subscriber<M> {
    /// Connects to `camera`'s stream, which need not exist yet.
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
        let link = Link::<M>::open(camera, &format!("edgecap-{}-subscriber", M::STREAM))?;
        let readers = || link.messages.dynamic_config().number_of_subscribers();
        if priority == Priority::Reader && readers() >= MAX_SUBSCRIBERS {
            // Those that were killed do not count.
            let _ = link.node.try_cleanup_dead_nodes();
            if readers() >= MAX_SUBSCRIBERS {
                return Err(link.too_many_readers());
            }
        }
        let listener = link.wake.listener_builder().create().map_err(|e| match e {
            ListenerCreateError::ExceedsMaxSupportedListeners => link.too_many_readers(),
            e => link.failed(e),
        })?;
        let port = link
            .messages
            .subscriber_builder()
            .buffer_size(BUFFER)
            .create();
        let port = port.map_err(|e| match e {
            SubscriberCreateError::ExceedsMaxSupportedSubscribers => link.too_many_readers(),
            e => link.failed(e),
        })?;
        Ok(Self {
            port,
            listener,
            link,
            looked: Cell::new(None),
        })
    }

    /// The oldest message not yet read, waiting up to `timeout` for one; `None` when none came. A signal that this process
    /// handles ends the wait early, so that the caller can look at its stop flag.
    ///
    /// # Errors
    /// [`LinkError::SharedMemory`].
    pub fn next(&self, timeout: Duration) -> Result<Option<Received<M>>, LinkError> {
        let began = Instant::now();
        loop {
            if let Some(m) = self.receive()? {
                return Ok(Some(m));
            }
            // SYNC POINT: a message is sent before its wake-up, so after a wake-up there is something to receive, unless the
            // wake-up belongs to a message that was read before it was waited for: then the wait goes on.
            let left = timeout.saturating_sub(began.elapsed());
            let woken = if left < SHORTEST_WAIT {
                self.listener.try_wait(|_| {})
            } else {
                self.listener.timed_wait(|_| {}, left)
            };
            match woken {
                Ok(_) if left < SHORTEST_WAIT => return self.receive(),
                Ok(_) => {}
                Err(ListenerWaitError::InterruptSignal) => return self.receive(),
                Err(e) => return Err(self.link.failed(e)),
            }
        }
    }

    /// The newest message, discarding older unread ones; waits up to `timeout` if there is none.
    ///
    /// # Errors
    /// [`LinkError::SharedMemory`].
    pub fn newest(&self, timeout: Duration) -> Result<Option<Received<M>>, LinkError> {
        let mut newest = self.next(timeout)?;
        while let Some(m) = self.receive()? {
            newest = Some(m);
        }
        Ok(newest)
    }

    /// Writers connected now: 0 or 1. One that was killed is gone within a quarter of a second of asking.
    pub fn publisher_count(&self) -> usize {
        let now = Instant::now();
        if self.looked.get().is_none_or(|t| now - t > LOOK_EVERY) {
            self.clean_up();
            self.looked.set(Some(now));
        }
        self.link.messages.dynamic_config().number_of_publishers()
    }

    /// Frees what killed processes left behind; call it every few seconds in a process that runs for weeks.
    pub fn clean_up(&self) {
        let _ = self.link.node.try_cleanup_dead_nodes();
    }

    fn receive(&self) -> Result<Option<Received<M>>, LinkError> {
        Ok(self
            .port
            .receive()
            .map_err(|e| self.link.failed(e))?
            .map(Received))
    }
}
