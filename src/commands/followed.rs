//! The cameras that a page shows, each followed in a thread of its own: from when somebody publishes it until nobody
//! has for a while, so that a page that is left open keeps nothing of runs that have ended.

use std::collections::BTreeMap;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use edgecap_client::message::{BodyFrame, FLAG_END_OF_STREAM};
use edgecap_client::{LinkError, Priority, Subscriber};

use super::exit::told;
use super::relay::{EventRelay, HealthRelay, PictureRelay, is_of_now};
use super::stop::Stop;
use crate::bridge::websocket::Hub;
use crate::camera::monotonic_ns;
use crate::sink::Silence;

/// How long to wait for a message before looking at the signals again.
const LOOK_UP: Duration = Duration::from_millis(200);
/// How soon a camera that cannot be followed is tried again.
const TRY_EVERY: Duration = Duration::from_secs(5);

/// A camera that is followed.
struct Thread {
    began: Instant,
    handle: JoinHandle<anyhow::Result<()>>,
}

/// Cameras by name.
pub struct Followed {
    hub: Hub,
    stop: Stop,
    /// How long nobody may publish; `None` where cameras are waited for, however long.
    patience: Option<Duration>,
    threads: BTreeMap<String, Thread>,
    /// What was said of those that cannot be followed, and when they are tried again.
    failed: BTreeMap<String, (String, Instant)>,
}

impl Followed {
    /// None yet. Frames go to `hub` until the user stops it.
    pub fn new(hub: &Hub, stop: &Stop, patience: Option<Duration>) -> Self {
        Self {
            hub: hub.clone(),
            stop: stop.clone(),
            patience,
            threads: BTreeMap::new(),
            failed: BTreeMap::new(),
        }
    }

    /// Follows those of these cameras that are published, and lets go of those that are no more. What cannot be
    /// followed is said once, and tried again.
    pub fn look(&mut self, names: &[String]) {
        let ended = self
            .threads
            .extract_if(.., |_, thread| thread.handle.is_finished());
        let ended: Vec<_> = ended.collect();
        for (name, thread) in ended {
            let lived = thread.began.elapsed();
            self.ended(&name, lived, joined(thread.handle));
        }
        self.failed.retain(|name, _| names.contains(name));
        for name in names {
            let is_to_wait = |(_, again): &(String, Instant)| Instant::now() < *again;
            if self.threads.contains_key(name) || self.failed.get(name).is_some_and(is_to_wait) {
                continue;
            }
            if let Err(e) = self.try_follow(name) {
                self.fail(name, &e);
            }
        }
    }

    /// Waits until all have ended, which the user has asked for.
    pub fn end(self) {
        for (name, thread) in self.threads {
            if let Err(e) = joined(thread.handle) {
                tracing::debug!("{name}: {}", told(&e));
            }
        }
    }

    fn try_follow(&mut self, name: &str) -> anyhow::Result<()> {
        // What a killed run has left is there, too.
        if self.patience.is_some() && !is_published(name)? {
            return Ok(());
        }
        let (hub, stop, patience) = (self.hub.clone(), self.stop.clone(), self.patience);
        let camera = name.to_owned();
        let began = Instant::now();
        let handle = std::thread::Builder::new()
            .name("camera".into())
            .spawn(move || follow(&camera, &hub, &stop, patience))?;
        self.threads
            .insert(name.to_owned(), Thread { began, handle });
        Ok(())
    }

    /// A camera was followed for so long. What it failed of after it was followed well is news, whatever it failed of
    /// before; whether it is, and was said.
    fn ended(&mut self, name: &str, lived: Duration, outcome: anyhow::Result<()>) -> bool {
        if outcome.is_ok() || lived > TRY_EVERY {
            self.failed.remove(name);
        }
        outcome.is_err_and(|e| self.fail(name, &e))
    }

    /// Has it tried again later; whether the reason is news, which is said.
    fn fail(&mut self, name: &str, error: &anyhow::Error) -> bool {
        let why = told(error);
        let is_news = self.failed.get(name).is_none_or(|(said, _)| *said != why);
        if is_news {
            tracing::warn!("{name}: not shown, and tried on: {why}");
        }
        self.failed
            .insert(name.to_owned(), (why, Instant::now() + TRY_EVERY));
        is_news
    }
}

fn joined(thread: JoinHandle<anyhow::Result<()>>) -> anyhow::Result<()> {
    thread
        .join()
        .unwrap_or_else(|_| Err(anyhow::anyhow!("its thread ended unexpectedly")))
}

fn is_published(camera: &str) -> Result<bool, LinkError> {
    Ok(Subscriber::<BodyFrame>::open(camera)?.publisher_count() > 0)
}

/// Hands on a camera's frames until the user stops it, or nobody has published any for as long as `patience` says; the
/// same camera may end and come back.
fn follow(camera: &str, hub: &Hub, stop: &Stop, patience: Option<Duration>) -> anyhow::Result<()> {
    let bodies = Subscriber::<BodyFrame>::open(camera)?;
    let mut events = EventRelay::to_page(camera, hub)?;
    let mut health = HealthRelay::to_page(camera, hub)?;
    let mut pictures = PictureRelay::to_page(camera, camera, Some(hub), Priority::Reader)?;
    let mut told = false;
    let mut published = Instant::now();
    let (mut silence, mut newest) = (Silence::default(), Box::<BodyFrame>::default());
    // What is there at once may be all that a run of hours ago has left.
    let left = bodies.next(Duration::ZERO)?;
    let mut left = left.filter(|frame| is_of_now(frame.publish_ns, monotonic_ns()));
    while !stop.requested() {
        let next = match left.take() {
            Some(frame) => Some(frame),
            None => bodies.next(LOOK_UP)?,
        };
        // Every frame belongs into the last minute, not the newest only.
        match next {
            Some(frame) => {
                hub.publish(camera, &frame);
                silence.hear(Instant::now());
                *newest = *frame;
                if frame.flags & FLAG_END_OF_STREAM != 0 {
                    tracing::info!("{camera}: the input has ended");
                }
                published = Instant::now();
            }
            None if bodies.publisher_count() > 0 => published = Instant::now(),
            None if patience.is_some_and(|p| published.elapsed() >= p) => return Ok(()),
            None => {}
        }
        let is_silent = silence.begins(Instant::now());
        if is_silent {
            hub.quiet(camera, &mut newest);
        }
        events.look()?;
        health.look();
        if let Some(pictures) = &mut pictures {
            if is_silent {
                pictures.quiet();
            }
            pictures.look()?;
            if !told && bodies.publisher_count() > 0 && pictures.is_missing() {
                tracing::warn!("{camera} publishes no pictures: 'edgecap run --show-picture' does");
                told = true;
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use edgecap_client::Publisher;

    use super::*;

    /// Files of this process, open or mapped, whose name holds this.
    fn held(name: &str) -> usize {
        let open = std::fs::read_dir("/proc/self/fd").unwrap().flatten();
        let links = open.filter_map(|e| std::fs::read_link(e.path()).ok());
        let maps = std::fs::read_to_string("/proc/self/maps").unwrap();
        links.filter(|l| l.to_string_lossy().contains(name)).count()
            + maps.lines().filter(|l| l.contains(name)).count()
    }

    #[test]
    fn who_was_published_more_than_two_seconds_ago_is_not_of_now() {
        for (now, wanted) in [
            (6, true),
            (7, true),
            (9, true),
            (10, false),
            (40_000, false),
        ] {
            assert_eq!(
                is_of_now(7_000_000_000, now * 1_000_000_000),
                wanted,
                "at {now} s"
            );
        }
    }

    fn looked_until(followed: &mut Followed, names: &[String], what: impl Fn(&Followed) -> bool) {
        let start = Instant::now();
        while !what(followed) {
            assert!(start.elapsed() < Duration::from_secs(60));
            followed.look(names);
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    #[test]
    fn cameras_that_have_gone_are_let_go_of_and_followed_again_when_they_are_back() {
        let stem = format!("test-followed-{}", std::process::id());
        let names: Vec<String> = (0..10).map(|n| format!("{stem}-{n}")).collect();
        let publish = |name: &String| {
            let mut publisher = Publisher::<BodyFrame>::open(name).unwrap();
            publisher.publish(&BodyFrame::default()).unwrap();
            publisher
        };
        let hub = Hub::new(Duration::from_secs(60), false);
        let patience = Some(Duration::from_millis(300));
        let mut followed = Followed::new(&hub, &Stop::never(), patience);
        for _ in 0..2 {
            let publishers: Vec<_> = names.iter().map(publish).collect();
            looked_until(&mut followed, &names, |f| f.threads.len() == names.len());
            assert!(held(&stem) > 0);
            drop(publishers);
            looked_until(&mut followed, &names, |f| f.threads.is_empty());
            assert_eq!(held(&stem), 0);
        }
        assert!(followed.failed.is_empty(), "{:?}", followed.failed);
    }

    #[test]
    fn a_failure_is_said_again_after_the_camera_was_followed_well() {
        let hub = Hub::new(Duration::ZERO, false);
        let mut followed = Followed::new(&hub, &Stop::never(), None);
        let mut ends = |lived, fails: bool| {
            let outcome = match fails {
                true => Err(anyhow::anyhow!("no room")),
                false => Ok(()),
            };
            followed.ended("hall", lived, outcome)
        };
        assert!(ends(Duration::ZERO, true));
        assert!(!ends(Duration::ZERO, true), "said already");
        assert!(ends(2 * TRY_EVERY, true), "it was followed in between");
        assert!(!ends(Duration::ZERO, true));
        assert!(!ends(Duration::ZERO, false), "nobody published it any more");
        assert!(ends(Duration::ZERO, true));
    }

    #[test]
    fn one_that_cannot_be_followed_is_tried_on_beside_the_others() {
        let name = format!("test-unlucky-{}", std::process::id());
        let names = ["no/name".to_owned(), name.clone()];
        let hub = Hub::new(Duration::ZERO, false);
        let mut followed = Followed::new(&hub, &Stop::never(), Some(Duration::ZERO));
        let publisher = Publisher::<BodyFrame>::open(&name).unwrap();
        looked_until(&mut followed, &names, |f| f.threads.contains_key(&name));
        assert!(followed.failed.contains_key("no/name"));
        drop(publisher);
        followed.look(&[]);
        assert!(followed.failed.is_empty());
        looked_until(&mut followed, &[], |f| f.threads.is_empty());
    }
}
