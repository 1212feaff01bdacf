//! Shared-memory services: their names, capacities, and the errors of connecting to them.
//!
//! Services are called `edgecap/v<version>/<camera>/<stream>`, the version being that of the stream's message; beside each lies an event service of the same name plus `/wake`, so
//! that nobody polls. Opening creates what is not there yet: processes may start in any order.

use iceoryx2::node::NodeBuilder;
use iceoryx2::prelude::*;
use iceoryx2::service::port_factory::{event, publish_subscribe};

use crate::message::{BodyFrame, ObservationFrame};

/// Most processes that may read one stream.
pub const MAX_SUBSCRIBERS: usize = 16;
/// Messages that wait for a slow reader before the oldest is overwritten.
pub const BUFFER: usize = 16;

/// A message type with a stream of its own.
pub trait Message: ZeroCopySend + Copy + Default + core::fmt::Debug + 'static {
    /// Last part of the service's name.
    const STREAM: &'static str;
    /// Version of its layout; part of the service's name, so that readers of another version never see it.
    const VERSION: u32;
}

/// Name of a camera's stream of `M`.
pub fn service_name<M: Message>(camera: &str) -> String {
    format!("edgecap/v{}/{camera}/{}", M::VERSION, M::STREAM)
}

impl Message for ObservationFrame {
    const STREAM: &'static str = "observations";
    const VERSION: u32 = 1;
}

impl Message for BodyFrame {
    const STREAM: &'static str = "bodies";
    const VERSION: u32 = 2;
}

/// Why a stream could not be opened or used.
#[derive(Debug, thiserror::Error)]
pub enum LinkError {
    /// The camera's name cannot be part of a service name.
    #[error(
        "camera name '{0}': expected 1 to 64 of a-z, A-Z, 0-9, '-' and '_'; choose another with --name"
    )]
    Name(String),
    /// Another process publishes this stream already.
    #[error(
        "another process already publishes {service}; stop it, or give this camera another --name"
    )]
    Busy {
        /// The service.
        service: String,
    },
    /// The service exists with other message types or capacities.
    #[error(
        "{service} was made by another version of edgecap ({cause}); stop all its processes and readers, then start again"
    )]
    Incompatible {
        /// The service.
        service: String,
        /// iceoryx2's reason.
        cause: String,
    },
    /// Shared memory failed otherwise.
    #[error("shared memory of {service}: {cause}; is /dev/shm writable and not full?")]
    SharedMemory {
        /// The service.
        service: String,
        /// iceoryx2's reason.
        cause: String,
    },
}

type Pair<M> = (
    publish_subscribe::PortFactory<ipc::Service, M, ()>,
    event::PortFactory<ipc::Service>,
);

/// A node and the two services of one stream.
#[derive(Debug)]
pub(crate) struct Link<M: Message> {
    pub(crate) messages: publish_subscribe::PortFactory<ipc::Service, M, ()>,
    pub(crate) wake: event::PortFactory<ipc::Service>,
    pub(crate) node: Node<ipc::Service>,
    pub(crate) service: String,
}

impl<M: Message> Link<M> {
    pub(crate) fn open(camera: &str, role: &str) -> Result<Self, LinkError> {
        let ok = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
        if camera.is_empty() || camera.len() > 64 || !camera.chars().all(ok) {
            return Err(LinkError::Name(camera.to_owned()));
        }
        set_log_level(LogLevel::Fatal);
        let service = service_name::<M>(camera);
        let failed = |cause: String| LinkError::SharedMemory {
            service: service.clone(),
            cause,
        };
        let role = NodeName::new(role).map_err(|e| failed(format!("{e:?}")))?;
        let node = NodeBuilder::new()
            .name(&role)
            .config(&Config::default())
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create::<ipc::Service>()
            .map_err(|e| failed(format!("{e:?}")))?;
        let (messages, wake) = Self::services(&node, &service)?;
        Ok(Self {
            messages,
            wake,
            node,
            service,
        })
    }

    fn services(node: &Node<ipc::Service>, service: &str) -> Result<Pair<M>, LinkError> {
        let incompatible = |cause: String| LinkError::Incompatible {
            service: service.to_owned(),
            cause,
        };
        let failed = |cause: String| LinkError::SharedMemory {
            service: service.to_owned(),
            cause,
        };
        let name = ServiceName::new(service).map_err(|e| failed(format!("{e:?}")))?;
        let wake =
            ServiceName::new(&format!("{service}/wake")).map_err(|e| failed(format!("{e:?}")))?;
        let messages = node
            .service_builder(&name)
            .publish_subscribe::<M>()
            .max_publishers(1)
            .max_subscribers(MAX_SUBSCRIBERS)
            .history_size(1)
            .subscriber_max_buffer_size(BUFFER)
            .subscriber_max_borrowed_samples(2)
            .enable_safe_overflow(true)
            .open_or_create()
            .map_err(|e| {
                let cause = format!("{e:?}");
                if cause.contains("Incompatible") || cause.contains("DoesNotSupport") {
                    incompatible(cause)
                } else {
                    failed(cause)
                }
            })?;
        let wake = node
            .service_builder(&wake)
            .event()
            .max_notifiers(2)
            .max_listeners(MAX_SUBSCRIBERS)
            .open_or_create()
            .map_err(|e| failed(format!("{e:?}")))?;
        Ok((messages, wake))
    }

    pub(crate) fn failed(&self, cause: impl core::fmt::Debug) -> LinkError {
        LinkError::SharedMemory {
            service: self.service.clone(),
            cause: format!("{cause:?}"),
        }
    }
}
