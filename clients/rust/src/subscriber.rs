//! Reading a stream: waits in the kernel, wakes within microseconds of a message.

use core::ops::Deref;
use core::time::Duration;

use iceoryx2::port::listener::{Listener, ListenerWaitError};
use iceoryx2::port::subscriber::Subscriber as Port;
use iceoryx2::prelude::*;
use iceoryx2::sample::Sample;

use crate::link::{BUFFER, Link, LinkError, Message};

/// The kernel counts waits in microseconds and takes none for a wait without end: shorter ones only look.
const SHORTEST_WAIT: Duration = Duration::from_micros(10);

/// A reader of a stream; any process on the machine may have several.
#[derive(Debug)]
pub struct Subscriber<M: Message> {
    port: Port<ipc::Service, M, ()>,
    listener: Listener<ipc::Service>,
    link: Link<M>,
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
        let link = Link::<M>::open(camera, &format!("edgecap-{}-subscriber", M::STREAM))?;
        let listener = link
            .wake
            .listener_builder()
            .create()
            .map_err(|e| link.failed(e))?;
        let port = link
            .messages
            .subscriber_builder()
            .buffer_size(BUFFER)
            .create()
            .map_err(|e| link.failed(e))?;
        Ok(Self {
            port,
            listener,
            link,
        })
    }

    /// The oldest message not yet read, waiting up to `timeout` for one; `None` when none came.
    ///
    /// # Errors
    /// [`LinkError::SharedMemory`].
    pub fn next(&self, timeout: Duration) -> Result<Option<Received<M>>, LinkError> {
        if let Some(m) = self.receive()? {
            return Ok(Some(m));
        }
        // SYNC POINT: a message is sent before its wake-up, so after a wake-up there is something to receive. A wake-up that
        // belongs to a message read above ends this wait early; the caller sees `None` and comes back.
        let woken = if timeout < SHORTEST_WAIT {
            self.listener.try_wait(|_| {})
        } else {
            self.listener.timed_wait(|_| {}, timeout)
        };
        match woken {
            // A signal handler ran: the caller looks at its stop flag and comes back.
            Ok(_) | Err(ListenerWaitError::InterruptSignal) => {}
            Err(e) => return Err(self.link.failed(e)),
        }
        self.receive()
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

    /// Writers connected now: 0 or 1.
    pub fn publisher_count(&self) -> usize {
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
