//! Stopping on SIGINT and SIGTERM, and with the supervisor.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use rustix::process::{Pid, Signal, getppid, set_parent_process_death_signal};

/// Set by SIGINT or SIGTERM; a second SIGINT ends the process at once.
#[derive(Debug, Clone)]
pub struct Stop(Arc<AtomicBool>);

impl Stop {
    /// Takes over the two signals.
    ///
    /// # Errors
    /// If the operating system refuses the handlers.
    pub fn on_signals() -> anyhow::Result<Self> {
        let flag = Arc::new(AtomicBool::new(false));
        for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
            signal_hook::flag::register_conditional_default(signal, Arc::clone(&flag))?;
            signal_hook::flag::register(signal, Arc::clone(&flag))?;
        }
        Ok(Self(flag))
    }

    /// Whether it is time to stop.
    pub fn requested(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// Makes the kernel send SIGTERM to this process when process `supervisor` dies, however it dies.
///
/// # Errors
/// If the kernel refuses, or the supervisor is gone already.
pub fn with_supervisor(supervisor: i32) -> anyhow::Result<()> {
    set_parent_process_death_signal(Some(Signal::TERM))?;
    anyhow::ensure!(
        getppid().map(Pid::as_raw_pid) == Some(supervisor),
        "the supervising process has gone"
    );
    Ok(())
}
