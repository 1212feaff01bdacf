//! Shared-memory services: their names, capacities, and the errors of connecting to them.
//!
//! Services are called `edgecap/v<version>/<camera>/<stream>`, the version being that of the stream's message; beside each
//! lies an event service of the same name plus `/wake`, so that nobody polls. Opening creates what is not there yet: processes
//! may start in any order.

use std::path::PathBuf;
use std::thread::sleep;
use std::time::{Duration, Instant};

use iceoryx2::node::NodeBuilder;
use iceoryx2::node::NodeCreationFailure;
use iceoryx2::prelude::*;
use iceoryx2::service::builder::event::{EventCreateError, EventOpenError, EventOpenOrCreateError};
use iceoryx2::service::builder::publish_subscribe::{
    PublishSubscribeCreateError, PublishSubscribeOpenError, PublishSubscribeOpenOrCreateError,
};
use iceoryx2::service::port_factory::{event, publish_subscribe};

use crate::message::{BodyFrame, ObservationFrame};
use crate::place::Place;

/// Most readers of one stream.
pub const MAX_SUBSCRIBERS: usize = 16;
/// Places beyond them for our own processes, so that no reader can keep them out.
const RESERVED: usize = 2;
/// Processes that may have a stream open: all of those, the writer, and as many that only look, such as a reader that is
/// refused and a writer that is about to be replaced.
const MAX_NODES: usize = 2 * (MAX_SUBSCRIBERS + RESERVED) + 2;
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

/// How long others may be busy making or removing the same stream.
const PATIENCE: Duration = Duration::from_secs(2);

/// Why a stream could not be opened or used.
#[derive(Debug, thiserror::Error)]
pub enum LinkError {
    /// The camera's name cannot be part of a service name.
    #[error(
        "camera name '{0}': expected 1 to 64 of a-z, A-Z, 0-9, '-' and '_'; choose another with --name"
    )]
    Name(String),
    /// The folder of this installation cannot be used.
    #[error(
        "runtime folder {}: {cause}; make it this user's own, or name another in EDGECAP_RUNTIME_DIR",
        folder.display()
    )]
    Place {
        /// The folder.
        folder: PathBuf,
        /// What was found.
        cause: String,
    },
    /// Another process publishes this stream already.
    #[error(
        "another process already publishes {service}; stop it, or give this camera another --name"
    )]
    Busy {
        /// The service.
        service: String,
    },
    /// As many processes read this stream as may.
    #[error("too many readers of {service}: expected at most {MAX_SUBSCRIBERS}; stop one first")]
    Readers {
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
    /// This user may not use what is there.
    #[error("{service} belongs to another user; run as the user who publishes it")]
    Permission {
        /// The service.
        service: String,
    },
    /// There is no room for the messages.
    #[error("{service}: /dev/shm is full ({cause}); make room there, or mount it larger")]
    Full {
        /// The service.
        service: String,
        /// The system's words.
        cause: String,
    },
    /// What a process left that died is damaged.
    #[error(
        "{service}: what is left of an earlier run is damaged ({cause}); run 'edgecap doctor --repair'"
    )]
    Damaged {
        /// The service.
        service: String,
        /// iceoryx2's reason.
        cause: String,
    },
    /// Shared memory failed otherwise.
    #[error("shared memory of {service} failed ({cause}); 'edgecap doctor' looks closer")]
    SharedMemory {
        /// The service.
        service: String,
        /// iceoryx2's reason.
        cause: String,
    },
}

/// What a failed call to iceoryx2 means for us.
enum Cause {
    /// Somebody is making or removing it: worth another try.
    Again,
    Incompatible,
    Permission,
    Readers,
    Damaged,
    Other,
}

impl Cause {
    fn error(self, service: &str, detail: &dyn core::fmt::Debug) -> LinkError {
        let (service, cause) = (service.to_owned(), format!("{detail:?}"));
        match self {
            Self::Incompatible => LinkError::Incompatible { service, cause },
            Self::Permission => LinkError::Permission { service },
            Self::Readers => LinkError::Readers { service },
            Self::Damaged => LinkError::Damaged { service, cause },
            Self::Again | Self::Other => LinkError::SharedMemory { service, cause },
        }
    }
}

impl From<PublishSubscribeOpenOrCreateError> for Cause {
    fn from(e: PublishSubscribeOpenOrCreateError) -> Self {
        use PublishSubscribeCreateError as Create;
        use PublishSubscribeOpenError as Open;
        match e {
            PublishSubscribeOpenOrCreateError::SystemInFlux => Self::Again,
            PublishSubscribeOpenOrCreateError::PublishSubscribeOpenError(e) => match e {
                Open::DoesNotExist | Open::IsMarkedForDestruction | Open::Interrupt => Self::Again,
                Open::IncompatibleTypes
                | Open::IncompatibleMessagingPattern
                | Open::IncompatibleAttributes
                | Open::IncompatibleOverflowBehavior
                | Open::DoesNotSupportRequestedMinBufferSize
                | Open::DoesNotSupportRequestedMinHistorySize
                | Open::DoesNotSupportRequestedMinSubscriberBorrowedSamples
                | Open::DoesNotSupportRequestedAmountOfPublishers
                | Open::DoesNotSupportRequestedAmountOfSubscribers
                | Open::DoesNotSupportRequestedAmountOfNodes
                | Open::VersionMismatch => Self::Incompatible,
                Open::InsufficientPermissions => Self::Permission,
                Open::ExceedsMaxNumberOfNodes => Self::Readers,
                Open::ServiceInCorruptedState | Open::HangsInCreation => Self::Damaged,
                _ => Self::Other,
            },
            PublishSubscribeOpenOrCreateError::PublishSubscribeCreateError(e) => match e {
                Create::AlreadyExists
                | Create::IsBeingCreatedByAnotherInstance
                | Create::Interrupt => Self::Again,
                Create::InsufficientPermissions => Self::Permission,
                Create::ServiceInCorruptedState | Create::HangsInCreation => Self::Damaged,
                _ => Self::Other,
            },
        }
    }
}

impl From<EventOpenOrCreateError> for Cause {
    fn from(e: EventOpenOrCreateError) -> Self {
        use EventCreateError as Create;
        use EventOpenError as Open;
        match e {
            EventOpenOrCreateError::SystemInFlux => Self::Again,
            EventOpenOrCreateError::EventOpenError(e) => match e {
                Open::DoesNotExist | Open::IsMarkedForDestruction | Open::Interrupt => Self::Again,
                Open::IncompatibleMessagingPattern
                | Open::IncompatibleAttributes
                | Open::IncompatibleDeadline
                | Open::IncompatibleNotifierCreatedEvent
                | Open::IncompatibleNotifierDroppedEvent
                | Open::IncompatibleNotifierDeadEvent
                | Open::DoesNotSupportRequestedAmountOfNotifiers
                | Open::DoesNotSupportRequestedAmountOfListeners
                | Open::DoesNotSupportRequestedMaxEventId
                | Open::DoesNotSupportRequestedAmountOfNodes
                | Open::VersionMismatch => Self::Incompatible,
                Open::InsufficientPermissions => Self::Permission,
                Open::ExceedsMaxNumberOfNodes => Self::Readers,
                Open::ServiceInCorruptedState | Open::HangsInCreation => Self::Damaged,
                _ => Self::Other,
            },
            EventOpenOrCreateError::EventCreateError(e) => match e {
                Create::AlreadyExists
                | Create::IsBeingCreatedByAnotherInstance
                | Create::Interrupt => Self::Again,
                Create::InsufficientPermissions => Self::Permission,
                Create::ServiceInCorruptedState => Self::Damaged,
                _ => Self::Other,
            },
        }
    }
}

/// Calls `open` until it succeeds or fails for another reason than that somebody is making or removing the same.
fn patiently<T, E: Copy + core::fmt::Debug + Into<Cause>>(
    service: &str,
    open: impl Fn() -> Result<T, E>,
) -> Result<T, LinkError> {
    let began = Instant::now();
    loop {
        match open() {
            Ok(opened) => return Ok(opened),
            Err(e) => match e.into() {
                Cause::Again if began.elapsed() < PATIENCE => sleep(Duration::from_millis(10)),
                cause => return Err(cause.error(service, &e)),
            },
        }
    }
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
    /// Left last: what is above is of it.
    pub(crate) place: Place,
}

impl<M: Message> Link<M> {
    pub(crate) fn open(camera: &str, role: &str) -> Result<Self, LinkError> {
        let ok = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
        if camera.is_empty() || camera.len() > 64 || !camera.chars().all(ok) {
            return Err(LinkError::Name(camera.to_owned()));
        }
        let service = service_name::<M>(camera);
        let place = Place::enter()?;
        let config = place.config()?;
        let other = |e: &dyn core::fmt::Debug| Cause::Other.error(&service, e);
        let role = NodeName::new(role).map_err(|e| other(&e))?;
        let node = NodeBuilder::new()
            .name(&role)
            .config(&config)
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create::<ipc::Service>();
        let node = node.map_err(|e| match e {
            NodeCreationFailure::InsufficientPermissions => Cause::Permission.error(&service, &e),
            NodeCreationFailure::SystemCorrupted => Cause::Damaged.error(&service, &e),
            e => other(&e),
        })?;
        place.close_to_others();
        let (messages, wake) = Self::services(&node, &service)?;
        Ok(Self {
            messages,
            wake,
            node,
            service,
            place,
        })
    }

    fn services(node: &Node<ipc::Service>, service: &str) -> Result<Pair<M>, LinkError> {
        let named =
            |name: &str| ServiceName::new(name).map_err(|e| Cause::Other.error(service, &e));
        let (name, wake) = (named(service)?, named(&format!("{service}/wake"))?);
        let messages = patiently(service, || {
            node.service_builder(&name)
                .publish_subscribe::<M>()
                .max_publishers(1)
                .max_subscribers(MAX_SUBSCRIBERS + RESERVED)
                .max_nodes(MAX_NODES)
                .history_size(1)
                .subscriber_max_buffer_size(BUFFER)
                .subscriber_max_borrowed_samples(2)
                .enable_safe_overflow(true)
                .open_or_create()
        })?;
        let wake = patiently(service, || {
            node.service_builder(&wake)
                .event()
                .max_notifiers(2)
                .max_listeners(MAX_SUBSCRIBERS + RESERVED)
                .max_nodes(MAX_NODES)
                .open_or_create()
        })?;
        Ok((messages, wake))
    }

    pub(crate) fn failed(&self, cause: impl core::fmt::Debug) -> LinkError {
        Cause::Other.error(&self.service, &cause)
    }

    pub(crate) fn too_many_readers(&self) -> LinkError {
        LinkError::Readers {
            service: self.service.clone(),
        }
    }
}
