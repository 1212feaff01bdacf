//! Writing a stream: a message goes in, readers are woken.

use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::{Publisher as Port, PublisherCreateError};
use iceoryx2::prelude::*;

use crate::link::{Link, LinkError, Message};

/// The one writer of a stream.
#[derive(Debug)]
pub struct Publisher<M: Message> {
    port: Port<ipc::Service, M, ()>,
    notifier: Notifier<ipc::Service>,
    link: Link<M>,
}

impl<M: Message> Publisher<M> {
    /// Becomes the writer of `camera`'s stream.
    ///
    /// # Errors
    /// [`LinkError::Busy`] if there is one already; the other kinds as their texts say.
    pub fn open(camera: &str) -> Result<Self, LinkError> {
        let link = Link::<M>::open(camera, &format!("edgecap-{}-publisher", M::STREAM))?;
        let port = match link
            .messages
            .publisher_builder()
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            .create()
        {
            Ok(port) => port,
            Err(PublisherCreateError::ExceedsMaxSupportedPublishers) => {
                return Err(LinkError::Busy {
                    service: link.service,
                });
            }
            Err(e) => return Err(link.failed(e)),
        };
        link.place.reserve().map_err(|e| LinkError::Full {
            service: link.service.clone(),
            cause: e.to_string(),
        })?;
        let notifier = link
            .wake
            .notifier_builder()
            .create()
            .map_err(|e| link.failed(e))?;
        Ok(Self {
            port,
            notifier,
            link,
        })
    }

    /// Copies `message` into shared memory and wakes the readers. Never waits: a reader that is too slow loses its oldest.
    ///
    /// # Errors
    /// [`LinkError::SharedMemory`].
    pub fn publish(&self, message: &M) -> Result<(), LinkError> {
        let slot = self.port.loan_uninit().map_err(|e| self.link.failed(e))?;
        slot.write_payload(*message)
            .send()
            .map_err(|e| self.link.failed(e))?;
        // A reader that died without cleaning up makes this fail; the message itself has been delivered.
        let _ = self.notifier.notify();
        Ok(())
    }

    /// Readers connected now.
    pub fn subscriber_count(&self) -> usize {
        self.link.messages.dynamic_config().number_of_subscribers()
    }

    /// Frees what killed processes left behind; call it every few seconds in a process that runs for weeks.
    pub fn clean_up(&self) {
        let _ = self.link.node.try_cleanup_dead_nodes();
    }
}
