//! What a supervisor hands to a child: one serialised value in place of the child's command line.

use std::sync::Arc;

use serde::de::DeserializeOwned;

use crate::supervise::{self, Heartbeat, Job};

/// A job as the command line holds it.
pub type Parsed<T> = Arc<Job<T>>;

/// Reads a job.
///
/// # Errors
/// What is wrong with the text.
pub fn parse<T: DeserializeOwned>(text: &str) -> Result<Parsed<T>, String> {
    let text = supervise::handed_over(text).map_err(|e| e.to_string())?;
    serde_json::from_str(&text)
        .map(Arc::new)
        .map_err(|e| e.to_string())
}

/// What to do, and whom to show that it goes on.
pub struct Supervised<T> {
    /// The options.
    pub task: T,
    /// Silent without a supervisor.
    pub heart: Heartbeat,
}

/// The job's task, if there is one: then this process ends with its supervisor. Else what the user typed.
///
/// # Errors
/// If the supervisor is another process than this one's parent.
pub fn supervised<T: Clone>(job: Option<Parsed<T>>, typed: T) -> anyhow::Result<Supervised<T>> {
    let Some(job) = job else {
        return Ok(Supervised {
            task: typed,
            heart: Heartbeat::default(),
        });
    };
    anyhow::ensure!(
        supervise::is_parent(job.supervisor),
        "the supervising process has gone"
    );
    // It was started as /proc/self/exe, which says nothing in a list of processes.
    let _ = std::fs::write("/proc/self/comm", "edgecap");
    Ok(Supervised {
        task: job.options.clone(),
        heart: Heartbeat::to_supervisor()?,
    })
}
