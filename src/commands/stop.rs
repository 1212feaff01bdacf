//! Stopping on SIGINT and SIGTERM.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

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

    /// Lets the end of a child wake this process from its waits.
    ///
    /// # Errors
    /// If the operating system refuses the handler.
    pub fn wake_when_children_end() -> anyhow::Result<()> {
        // Nobody reads the flag: that a handler runs ends the wait.
        signal_hook::flag::register(signal_hook::consts::SIGCHLD, Arc::default())?;
        Ok(())
    }

    /// Whether it is time to stop.
    pub fn requested(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}
