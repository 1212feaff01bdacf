//! Bodies, events and how cameras are doing over WebSocket, as JSON or compact binary.
//!
//! A client opens `/bodies` and gets every camera's frames as they are published, or only its newest where it is too
//! slow: what it has not taken is replaced, never queued. Parameters: `format=json` (default) or `binary` ([`binary`]),
//! `camera=NAME` for one camera, `history=1` for the kept past first (binary only), of which `seconds=` are the last so
//! many (not of a record) and `mark=1` ends with the text `now`, `token=` where the server wants one.
//!
//! At `/events` it gets what happens, of a record all that has happened, in the same two forms. Events are queued: only
//! a client that is behind by a thousand loses the oldest.
//!
//! At `/health` it gets how each camera is doing, as JSON: at every change of its state, and about once a second.

mod access;
pub mod binary;
mod client;
mod ear;
mod history;
mod hub;
mod mailbox;
mod packet;
mod report;
mod sink;

pub use access::Access;
pub use hub::{APART, Hub};
pub use packet::Packet;
pub use sink::{HealthSink, HubSink};
