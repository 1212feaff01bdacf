//! What the service manager is told: ready, alive, stopping. Without one, nothing happens.

use std::time::{Duration, Instant};

use sd_notify::NotifyState;

/// Variables of the service manager, which are for the supervisor alone.
pub(super) const VARIABLES: [&str; 3] = ["NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID"];
/// Signs of life within the time that the manager allows.
const FEEDS: u32 = 4;
/// How often the status line is renewed.
const STATUS_EVERY: Duration = Duration::from_secs(2);

/// The service manager, if this process is a service of type `notify`.
#[derive(Debug)]
pub struct ServiceManager {
    feed_every: Option<Duration>,
    fed: Option<Instant>,
    said: Option<Instant>,
    is_ready: bool,
}

impl ServiceManager {
    /// As the environment says.
    pub fn from_env() -> Self {
        Self {
            feed_every: sd_notify::watchdog_enabled().map(|allowed| allowed / FEEDS),
            fed: None,
            said: None,
            is_ready: false,
        }
    }

    /// Something went on: call it only then. The first time, the service is ready.
    pub fn progress(&mut self, status: &str) {
        let now = Instant::now();
        let due = |last: Option<Instant>, every| last.is_none_or(|t| now - t >= every);
        let mut news = Vec::new();
        if !self.is_ready {
            news.push(NotifyState::Ready);
        }
        if self.feed_every.is_some_and(|every| due(self.fed, every)) {
            news.push(NotifyState::Watchdog);
            self.fed = Some(now);
        }
        if due(self.said, STATUS_EVERY) || !self.is_ready {
            news.push(NotifyState::Status(status));
            self.said = Some(now);
        }
        self.is_ready = true;
        tell(&news);
    }

    /// The end begins.
    pub fn stopping(&self) {
        tell(&[NotifyState::Stopping]);
    }
}

fn tell(news: &[NotifyState<'_>]) {
    if news.is_empty() {
        return;
    }
    // A manager that does not listen is no reason to stop working.
    if let Err(e) = sd_notify::notify(news) {
        tracing::debug!("the service manager does not listen: {e}");
    }
}
