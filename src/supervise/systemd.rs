//! What the service manager is told: ready, alive, stopping. Without one, nothing happens.

use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use sd_notify::NotifyState;

/// Variables of the service manager, which are for the supervisor alone.
pub(super) const VARIABLES: [&str; 3] = ["NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID"];
/// Signs of life within the time that the manager allows. What is left of it after one that was due and did not come
/// has to do for a child that starts.
const FEEDS: u32 = 8;
/// How often the status line is renewed.
const STATUS_EVERY: Duration = Duration::from_secs(2);

/// Whether this process is a service, which nobody watches.
pub fn is_service() -> bool {
    std::env::var_os(VARIABLES[0]).is_some()
}

/// What goes on at a camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Progress {
    /// Bodies are published.
    Bodies,
    /// The camera is away, and looked for; or what it sends is of no use.
    Waiting,
    /// Its next picture has not come yet, or was damaged: what was said before still holds.
    Still,
}

/// The service manager, if this process is a service of type `notify`. It hears of life only where every camera shows
/// some: one that goes well must not hide another that is stuck.
#[derive(Debug)]
pub struct ServiceManager {
    feed_every: Option<Duration>,
    told: Mutex<Told>,
}

#[derive(Debug)]
struct Told {
    cameras: Vec<Camera>,
    is_ready: bool,
    is_stopping: bool,
    fed: Option<Instant>,
    said: Option<Instant>,
}

#[derive(Debug)]
struct Camera {
    name: String,
    newest: Option<Progress>,
    /// Whether something went on since the manager was fed.
    is_fresh: bool,
    is_over: bool,
}

/// What the manager is to hear now.
#[derive(Debug, Default, PartialEq, Eq)]
struct News {
    ready: bool,
    alive: bool,
    status: Option<String>,
}

impl ServiceManager {
    /// As the environment says, for these cameras.
    pub fn from_env<'a>(cameras: impl IntoIterator<Item = &'a str>) -> Self {
        Self {
            feed_every: sd_notify::watchdog_enabled().map(|allowed| allowed / FEEDS),
            told: Mutex::new(Told::of(cameras)),
        }
    }

    /// Something went on at a camera, by its place among all: call it only then. The service is ready once it has at
    /// all.
    pub fn progress(&self, camera: usize, what: Progress) {
        let news = self
            .told()
            .progress(Instant::now(), self.feed_every, camera, what);
        let status = news.status.as_deref();
        let news = [
            news.ready.then_some(NotifyState::Ready),
            news.alive.then_some(NotifyState::Watchdog),
            status.map(NotifyState::Status),
        ];
        tell(&news.into_iter().flatten().collect::<Vec<_>>());
    }

    /// A camera has ended for good; no sign of life is expected of it any more.
    pub fn over(&self, camera: usize) {
        self.told().over(camera);
    }

    /// Whether it has heard that the service is ready.
    #[cfg(test)]
    pub(crate) fn is_ready(&self) -> bool {
        self.told().is_ready
    }

    /// The end begins.
    pub fn stopping(&self) {
        if !std::mem::replace(&mut self.told().is_stopping, true) {
            tell(&[NotifyState::Stopping]);
        }
    }

    fn told(&self) -> std::sync::MutexGuard<'_, Told> {
        // It is whole between any two statements.
        self.told.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Told {
    fn of<'a>(cameras: impl IntoIterator<Item = &'a str>) -> Self {
        let camera = |name: &str| Camera {
            name: name.to_owned(),
            newest: None,
            is_fresh: false,
            is_over: false,
        };
        Self {
            cameras: cameras.into_iter().map(camera).collect(),
            is_ready: false,
            is_stopping: false,
            fed: None,
            said: None,
        }
    }

    fn over(&mut self, camera: usize) {
        self.cameras[camera].is_over = true;
        // What was said of it no longer holds.
        self.said = None;
    }

    fn progress(
        &mut self,
        now: Instant,
        feed_every: Option<Duration>,
        camera: usize,
        what: Progress,
    ) -> News {
        let its = &mut self.cameras[camera];
        if what != Progress::Still {
            its.newest = Some(what);
        }
        its.is_fresh = true;
        let due = |last: Option<Instant>, every| last.is_none_or(|t| now - t >= every);
        let mut news = News::default();
        let mut going = self.cameras.iter().filter(|c| !c.is_over);
        if going.all(|c| c.is_fresh) {
            news.ready = !std::mem::replace(&mut self.is_ready, true);
            if feed_every.is_some_and(|every| due(self.fed, every)) {
                news.alive = true;
                self.fed = Some(now);
                self.cameras.iter_mut().for_each(|c| c.is_fresh = false);
            }
        }
        if due(self.said, STATUS_EVERY) || news.ready {
            news.status = Some(self.status());
            self.said = Some(now);
        }
        news
    }

    /// What `systemctl status` shows.
    fn status(&self) -> String {
        let words = |c: &Camera| match c.newest {
            _ if c.is_over => "ended",
            None => "starting",
            Some(Progress::Bodies) => "bodies are published",
            Some(Progress::Waiting | Progress::Still) => "waiting for the camera",
        };
        match &self.cameras[..] {
            [one] => words(one).to_owned(),
            all => {
                let each = all.iter().map(|c| format!("{}: {}", c.name, words(c)));
                each.collect::<Vec<_>>().join("; ")
            }
        }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::supervise::policy::STARTING;

    const EVERY: Duration = Duration::from_secs(5);

    const UNITS: [&str; 2] = [
        include_str!("../../deploy/edgecap.service"),
        include_str!("../../deploy/edgecap-user.service"),
    ];

    /// What a unit sets this key to.
    fn setting<'a>(unit: &'a str, key: &str) -> &'a str {
        let mut lines = unit.lines().filter_map(|line| line.split_once('='));
        let found = lines.find(|(name, _)| *name == key);
        found.unwrap_or_else(|| panic!("no {key}= in a unit")).1
    }

    /// Whoever ends the service for it would have it start from the beginning, again and again on a slow machine.
    #[test]
    fn the_units_wait_for_a_child_that_starts() {
        for unit in UNITS {
            let allowed = setting(unit, "WatchdogSec").parse();
            let allowed = Duration::from_secs(allowed.unwrap());
            // The newest sign of life may be as old as one was due.
            assert!(allowed - allowed / FEEDS > STARTING, "{allowed:?}");
        }
    }

    /// Systemd's default ends all of them.
    #[test]
    fn a_process_that_is_killed_for_its_memory_takes_no_other_camera_with_it() {
        for unit in UNITS {
            assert_eq!(setting(unit, "OOMPolicy"), "continue");
        }
    }

    #[test]
    fn the_units_have_room_for_the_files_of_32_cameras() {
        // Open in `run` for each with pictures on the page, and readers of the page besides.
        let (of_camera, of_readers) = (53, 1024);
        for unit in UNITS {
            let most: u32 = setting(unit, "LimitNOFILE").parse().unwrap();
            assert!(most >= 32 * of_camera + of_readers, "{most}");
        }
    }

    /// How often the manager is fed in a minute, where these cameras show progress ten times a second.
    fn fed(told: &mut Told, from: Instant, moving: &[usize]) -> usize {
        (0..600)
            .flat_map(|t| moving.iter().map(move |c| (t, *c)))
            .filter(|(t, camera)| {
                let now = from + Duration::from_millis(100 * t);
                let news = told.progress(now, Some(EVERY), *camera, Progress::Bodies);
                news.alive
            })
            .count()
    }

    #[test]
    fn one_camera_feeds_by_itself() {
        let mut told = Told::of(["hall"]);
        assert_eq!(fed(&mut told, Instant::now(), &[0]), 12);
    }

    #[test]
    fn a_slow_camera_lives_and_is_not_said_to_be_away() {
        let (mut told, now) = (Told::of(["hall"]), Instant::now());
        let after = |seconds| now + Duration::from_secs(seconds);
        told.progress(now, Some(EVERY), 0, Progress::Bodies);
        let slow = told.progress(after(6), Some(EVERY), 0, Progress::Still);
        assert!(slow.alive);
        assert_eq!(slow.status.as_deref(), Some("bodies are published"));
        let away = told.progress(after(12), Some(EVERY), 0, Progress::Waiting);
        assert_eq!(away.status.as_deref(), Some("waiting for the camera"));
    }

    #[test]
    fn a_stuck_camera_is_not_hidden_by_others() {
        let (mut told, now) = (Told::of(["hall", "yard", "gate"]), Instant::now());
        let minute = Duration::from_secs(60);
        assert_eq!(fed(&mut told, now, &[0, 1]), 0, "one has never come");
        assert_eq!(fed(&mut told, now + minute, &[0, 1, 2]), 12);
        assert!(fed(&mut told, now + 2 * minute, &[0, 2]) <= 1);
        told.over(1);
        assert_eq!(fed(&mut told, now + 3 * minute, &[0, 2]), 12);
    }

    #[test]
    fn the_service_is_ready_without_a_camera_that_has_ended_and_says_so_at_once() {
        let (mut told, now) = (Told::of(["hall", "yard"]), Instant::now());
        assert!(!told.progress(now, Some(EVERY), 0, Progress::Bodies).ready);
        told.over(1);
        let news = told.progress(now, Some(EVERY), 0, Progress::Bodies);
        assert!(news.ready && news.alive);
        let status = Some("hall: bodies are published; yard: ended");
        assert_eq!(news.status.as_deref(), status);
    }

    #[test]
    fn the_service_is_ready_once_when_all_are() {
        let (mut told, now) = (Told::of(["hall", "yard"]), Instant::now());
        let first = told.progress(now, None, 0, Progress::Bodies);
        assert!(!first.ready);
        assert_eq!(
            first.status.as_deref(),
            Some("hall: bodies are published; yard: starting")
        );
        let second = told.progress(now, None, 1, Progress::Waiting);
        assert!(second.ready && !second.alive);
        assert_eq!(
            second.status.as_deref(),
            Some("hall: bodies are published; yard: waiting for the camera")
        );
        assert_eq!(
            told.progress(now, None, 1, Progress::Bodies),
            News::default()
        );
    }
}
