//! What a local app takes: the messages of edgecap, the joint layouts, and a subscriber that waits in shared memory.

#![forbid(unsafe_code)]

pub mod joints;
pub mod message;
