//! Whether another process publishes what this one is about to publish. A run that listened to another's bodies would
//! show and record them as its own: it is refused before anything is opened or said.

use std::thread::sleep;
use std::time::{Duration, Instant};

use edgecap_client::message::{BodyFrame, HealthFrame, ObservationFrame};
use edgecap_client::{LinkError, Message, place, service_name};

/// How long it is looked again, and how soon: processes of a run that was killed take a moment to end.
const PATIENCE: Duration = Duration::from_millis(500);
const PAUSE: Duration = Duration::from_millis(10);
/// The same for what one process publishes: another that ends waits for its readers, for a second and a half.
const ENDING: Duration = Duration::from_secs(2);
/// How often it is looked at least: one look alone may take longer than that.
const LOOKS: u32 = 3;

/// What a process publishes of a camera or a room. Its events come with the bodies, its pictures with what it says of
/// its health.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum What {
    Bodies,
    Observations,
    Health,
}

/// A stream as the place of streams lists it, and as a service.
struct Stream {
    stem: String,
    service: String,
}

impl Stream {
    fn of<M: Message>(name: &str) -> Self {
        Self {
            stem: format!("{name}.{}", M::STREAM),
            service: service_name::<M>(name),
        }
    }
}

impl What {
    fn stream(self, name: &str) -> Stream {
        match self {
            Self::Bodies => Stream::of::<BodyFrame>(name),
            Self::Observations => Stream::of::<ObservationFrame>(name),
            Self::Health => Stream::of::<HealthFrame>(name),
        }
    }
}

/// What is published for a camera.
fn streams_of(camera: &str) -> Vec<Stream> {
    let all = [What::Bodies, What::Observations, What::Health];
    all.map(|what| what.stream(camera)).into()
}

/// Refuses a name under which another process publishes any of this.
///
/// # Errors
/// [`LinkError::Busy`].
pub fn expect_free(name: &str, whats: &[What]) -> Result<(), LinkError> {
    let streams = whats.iter().map(|what| what.stream(name)).collect();
    free_of(&[streams], ENDING, look).into_iter().collect()
}

/// For each of the cameras of a run whether nobody else publishes anything of it, else [`LinkError::Busy`]. All are
/// looked for at once: whoever looks clears away what the dead left, and holds their streams while it does.
pub fn are_free<'a>(cameras: impl IntoIterator<Item = &'a str>) -> Vec<Result<(), LinkError>> {
    let streams: Vec<_> = cameras.into_iter().map(streams_of).collect();
    free_of(&streams, PATIENCE, look)
}

/// The streams that are published now, in whichever session this user began to.
fn look() -> Vec<String> {
    // What else is wrong with the place is told by who opens a stream there.
    let mut alive = place::clear().unwrap_or_default();
    alive.extend(place::published_elsewhere());
    alive
}

/// Whether none of the streams of each is published. While one is, it is looked again.
fn free_of(
    each: &[Vec<Stream>],
    patience: Duration,
    mut look: impl FnMut() -> Vec<String>,
) -> Vec<Result<(), LinkError>> {
    let (began, mut looks) = (Instant::now(), 0);
    loop {
        let alive = look();
        looks += 1;
        let free = |streams: &Vec<Stream>| match streams.iter().find(|s| alive.contains(&s.stem)) {
            None => Ok(()),
            Some(taken) => Err(LinkError::Busy {
                service: taken.service.clone(),
            }),
        };
        let found: Vec<_> = each.iter().map(free).collect();
        if found.iter().all(Result::is_ok) || (looks >= LOOKS && began.elapsed() > patience) {
            return found;
        }
        sleep(PAUSE);
    }
}

#[cfg(test)]
mod tests {
    use edgecap_client::Publisher;
    use edgecap_client::message::EventFrame;

    use super::*;

    #[test]
    fn cameras_that_start_side_by_side_after_a_crash_keep_none_of_them_out() {
        let folder = tempfile::tempdir().unwrap();
        let names: Vec<String> = (0..16).map(|n| format!("c{n}")).collect();
        for name in &names {
            for stream in ["bodies", "events", "health", "observations"] {
                std::fs::write(folder.path().join(format!("{name}.{stream}.lock")), "").unwrap();
            }
        }
        let start = |name: &str| -> Result<_, LinkError> {
            let look = || place::clear_at(folder.path()).unwrap_or_default();
            let free = free_of(&[streams_of(name)], PATIENCE, look);
            free.into_iter().collect::<Result<(), _>>()?;
            // The smallest stream; it stays open until all have begun.
            Publisher::<EventFrame>::open_at(folder.path(), name)
        };
        let (start, ready) = (&start, &std::sync::Barrier::new(names.len()));
        std::thread::scope(|threads| {
            for name in &names {
                threads.spawn(move || {
                    let opened = start(name);
                    ready.wait();
                    opened.unwrap();
                });
            }
        });
    }

    #[test]
    fn a_stream_is_looked_for_again_however_long_a_look_takes() {
        let held = || vec!["camera0.bodies".to_owned()];
        let each = [streams_of("camera0"), streams_of("camera1")];
        let mut looks = 0;
        let found = free_of(&each, Duration::ZERO, || {
            looks += 1;
            if looks < LOOKS { held() } else { Vec::new() }
        });
        assert!(looks == LOOKS && found.iter().all(Result::is_ok));
        let found = free_of(&each, Duration::ZERO, held);
        assert!(
            matches!(&found[0], Err(LinkError::Busy { service }) if service.contains("bodies"))
        );
        assert!(found[1].is_ok(), "one that is taken keeps no other out");
    }
}
