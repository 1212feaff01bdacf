//! A small server of HTTP for this machine: requests go in, answers come out, and a connection may become a stream.
//!
//! Anybody who reaches the address may connect: every connection has a thread for a moment only, there are never more
//! than a few, and nothing is kept between them. A stream lasts until either side ends it.

mod request;
mod server;

pub use request::Request;
pub use server::{Answer, Ends, Server, take_leave};
