//! Child processes under supervision: started, watched for progress, replaced when they die or hang, stopped.
//!
//! A [`Policy`] decides and has no clock and no process of its own; a [`Child`] carries out what it says. A child shows that it
//! lives by [beats](Heartbeat): bytes on its standard output, written once a step whether or not a picture came.

mod child;
mod heartbeat;
mod policy;

pub use child::{Child, Job, describe, stop_all};
pub use heartbeat::Heartbeat;
pub use policy::{Policy, Verdict};
