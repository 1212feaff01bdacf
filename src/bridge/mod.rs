//! Bodies for programs that do not read shared memory. Off by default; each bridge takes published frames and speaks
//! one protocol.

pub mod osc;
mod outcome;
mod udp;
pub mod vmc;
pub mod websocket;

pub use udp::expect_port;
