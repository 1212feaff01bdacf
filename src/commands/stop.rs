//! Stopping on SIGINT and SIGTERM, and on SIGHUP where nobody wants it ignored.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use signal_hook::consts::{SIGCHLD, SIGHUP, SIGINT, SIGTERM, SIGUSR1};
use signal_hook::iterator::Signals;
use signal_hook::low_level::emulate_default_handler;

/// Who asks again within this time means the same: `timeout` asks a program and then its group, systemd a supervisor
/// and its children, a terminal all of them.
const AT_ONCE: Duration = Duration::from_millis(500);

/// Set by SIGINT, SIGTERM or SIGHUP; another that comes half a second later or more ends the process at once.
#[derive(Debug, Clone)]
pub struct Stop(Arc<AtomicBool>);

impl Stop {
    /// Takes over the signals. A terminal that is closed sends SIGHUP; `nohup` has it ignored.
    ///
    /// # Errors
    /// If the operating system refuses the handlers or a thread.
    pub fn on_signals() -> anyhow::Result<Self> {
        let flag = Arc::new(AtomicBool::new(false));
        let mut stopping = vec![SIGINT, SIGTERM];
        if !is_ignored(SIGHUP) {
            stopping.push(SIGHUP);
        }
        for signal in &stopping {
            signal_hook::flag::register(*signal, Arc::clone(&flag))?;
        }
        // Who asks a service for its last minute sends it to every process of it.
        signal_hook::flag::register(SIGUSR1, Arc::default())?;
        let mut signals = Signals::new(stopping)?;
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

/// Whether this process was started with a signal ignored.
fn is_ignored(signal: i32) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|l| l.strip_prefix("SigIgn:"));
    let mask = mask.and_then(|m| u64::from_str_radix(m.trim(), 16).ok());
    mask.is_some_and(|m| m & (1 << (signal - 1)) != 0)
}
