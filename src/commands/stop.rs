//! Stopping on SIGINT and SIGTERM.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use signal_hook::consts::{SIGCHLD, SIGINT, SIGTERM};
use signal_hook::iterator::Signals;
use signal_hook::low_level::emulate_default_handler;

/// Who asks again within this time means the same: `timeout` asks a program and then its group, systemd a supervisor
/// and its children, a terminal all of them.
const AT_ONCE: Duration = Duration::from_millis(500);

/// Set by SIGINT or SIGTERM; another that comes half a second later or more ends the process at once.
#[derive(Debug, Clone)]
pub struct Stop(Arc<AtomicBool>);

impl Stop {
    /// Takes over the two signals.
    ///
    /// # Errors
    /// If the operating system refuses the handlers or a thread.
    pub fn on_signals() -> anyhow::Result<Self> {
        let flag = Arc::new(AtomicBool::new(false));
        for signal in [SIGINT, SIGTERM] {
            signal_hook::flag::register(signal, Arc::clone(&flag))?;
        }
        let mut signals = Signals::new([SIGINT, SIGTERM])?;
        thread::Builder::new()
            .name("signals".into())
            .spawn(move || {
                let mut first = None;
                for signal in signals.forever() {
                    let waited = first.get_or_insert_with(Instant::now).elapsed();
                    if waited >= AT_ONCE {
                        // Fails for signals alone that have no default.
                        let _ = emulate_default_handler(signal);
                    }
                }
            })?;
        Ok(Self(flag))
    }

    /// One that never comes.
    #[cfg(test)]
    pub fn never() -> Self {
        Self(Arc::default())
    }

    /// Lets the end of a child wake this process from its waits.
    ///
    /// # Errors
    /// If the operating system refuses the handler.
    pub fn wake_when_children_end() -> anyhow::Result<()> {
        // Nobody reads the flag: that a handler runs ends the wait.
        signal_hook::flag::register(SIGCHLD, Arc::default())?;
        Ok(())
    }

    /// Whether it is time to stop.
    pub fn requested(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}
