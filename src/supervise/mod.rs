//! Child processes under supervision: started, watched for progress, replaced when they die or hang, stopped.
//!
//! A [`Policy`] decides and has no clock and no process of its own; a [`Child`] carries out what it says. A child shows
//! that it lives by [beats](Heartbeat): bytes on its standard output, which say what a step brought. The
//! [`ServiceManager`] hears of progress only, so that it notices when the supervisor hangs.

mod child;
mod heartbeat;
mod left;
mod policy;
mod systemd;
#[allow(unsafe_code, reason = "what a child does between fork and exec")]
mod tie;

pub use child::{Child, Job, describe, handed_over, has_worked_before, restarts, stop_all};
pub use heartbeat::{Beat, Heartbeat};
pub use policy::{Activity, Policy, Verdict};
pub use systemd::{Progress, ServiceManager, is_service};
pub use tie::{is_parent, permissions, remember_permissions, tie};
