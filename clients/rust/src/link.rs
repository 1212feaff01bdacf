//! A stream's services in iceoryx2: messages, and an event that wakes, so that nobody polls.

use std::rc::Rc;

use iceoryx2::node::{NodeBuilder, NodeState, NodeView};
use iceoryx2::prelude::*;
use iceoryx2::service::port_factory::{event, publish_subscribe};

use crate::domain::Domain;
use crate::error::LinkError;
use crate::ring::BUFFER;
use crate::service::FileService;
use crate::stream::{Message, service_name};

/// Most programs that get messages of one stream through iceoryx2, in place and without a copy. Any number of others
/// copies them from the stream's file.
pub const MAX_SUBSCRIBERS: usize = 16;
/// Places beyond them for our own processes.
pub(crate) const RESERVED: usize = 2;
/// Processes that may have a stream open: all of those, the writer, and as many that died and are not cleared away yet.
const MAX_NODES: usize = 2 * (MAX_SUBSCRIBERS + RESERVED) + 2;

/// A node and the two services of one stream.
#[derive(Debug)]
pub(crate) struct Link<M: Message> {
    /// Each message with its number.
    pub(crate) messages: publish_subscribe::PortFactory<FileService, M, u64>,
    pub(crate) wake: event::PortFactory<FileService>,
    pub(crate) node: Node<FileService>,
    /// Left last: what is above lies in it.
    pub(crate) domain: Rc<Domain>,
}

/// Who opens a stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Side {
    Writer,
    Reader,
}

impl<M: Message> Link<M> {
    /// Makes the services, or opens those that the writer made.
    pub(crate) fn open(domain: Domain, camera: &str, side: Side) -> Result<Self, LinkError> {
        let service = service_name::<M>(camera);
        let failed = |e: &dyn core::fmt::Display| LinkError::failed(&service, e);
        let role = match side {
            Side::Writer => "publisher",
            Side::Reader => "subscriber",
        };
        let role = NodeName::new(&format!("edgecap-{}-{role}", M::STREAM));
        let node = NodeBuilder::new()
            .name(&role.map_err(|e| failed(&e))?)
            .config(&domain.config()?)
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create::<FileService>()
            .map_err(|e| failed(&e))?;
        let named = |name: &str| ServiceName::new(name).map_err(|e| failed(&e));
        let (name, wake) = (named(&service)?, named(&format!("{service}/wake"))?);
        let messages = node
            .service_builder(&name)
            .publish_subscribe::<M>()
            .user_header::<u64>();
        let wake = node.service_builder(&wake).event();
        let (messages, wake) = match side {
            Side::Writer => (
                messages
                    .max_publishers(1)
                    .max_subscribers(MAX_SUBSCRIBERS + RESERVED)
                    .max_nodes(MAX_NODES)
                    .history_size(0)
                    .subscriber_max_buffer_size(BUFFER)
                    .subscriber_max_borrowed_samples(2)
                    .enable_safe_overflow(true)
                    .create()
                    .map_err(|e| failed(&e))?,
                wake.max_notifiers(1)
                    .max_listeners(MAX_SUBSCRIBERS + RESERVED)
                    .max_nodes(MAX_NODES)
                    .create()
                    .map_err(|e| failed(&e))?,
            ),
            Side::Reader => (
                messages.open().map_err(|e| failed(&e))?,
                wake.open().map_err(|e| failed(&e))?,
            ),
        };
        Ok(Self {
            messages,
            wake,
            node,
            domain: Rc::new(domain),
        })
    }

    /// Frees what killed processes hold in this domain. Only the writer may call it: a reader's place is lost for good
    /// if the writer connects to it while another process clears it away.
    pub(crate) fn clean_up(&self) {
        // What cannot be freed now is tried again at the next call.
        let _ = Node::<FileService>::list(self.node.config(), |state| {
            if let NodeState::Dead(dead) = state {
                self.domain.remove_unfinished(dead.id().value());
                let _ = dead.try_remove_stale_resources();
            }
            CallbackProgression::Continue
        });
    }
}
