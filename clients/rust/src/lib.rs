//! What a local app takes: the messages of edgecap, the joint layouts, and a subscriber that waits in shared memory.
//!
//! ```no_run
//! use edgecap_client::{message::BodyFrame, Subscriber};
//! let bodies = Subscriber::<BodyFrame>::open("camera0")?;
//! for frame in bodies.messages() {
//!     for body in frame?.bodies() {
//!         println!("{body}, right wrist at {:?}", body.joint("r_wrist"));
//!     }
//! }
//! # Ok::<(), edgecap_client::LinkError>(())
//! ```
//!
//! [`Subscriber::next`] and [`Subscriber::newest`] take one message and wait no longer than they are told;
//! [`Subscriber::publisher_count`] says whether anybody publishes.
//!
//! iceoryx2 logs to stderr as `IOX2_LOG_LEVEL` says; the level is the program's and never changed here.

#![forbid(unsafe_code)]

mod cameras;
mod claim;
mod domain;
mod error;
pub mod joints;
mod link;
pub mod message;
mod named;
pub mod place;
mod publisher;
mod ring;
mod service;
mod stream;
mod subscriber;
mod world;

pub use cameras::cameras;
pub use error::LinkError;
pub use link::MAX_SUBSCRIBERS;
pub use publisher::Publisher;
pub use ring::BUFFER;
pub use stream::{Message, service_name};
pub use subscriber::{Priority, Received, Subscriber};
pub use world::WorldBody;
