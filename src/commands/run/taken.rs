//! Whether another process publishes what a run is about to publish. A run that listened to another's bodies would show
//! and record them as its own: it is refused before anything is opened or said.

use std::thread::sleep;
use std::time::{Duration, Instant};

use edgecap_client::message::{BodyFrame, ObservationFrame};
use edgecap_client::{LinkError, Message, place, service_name};

/// How long it is looked again, and how soon: processes of a run that was killed take a moment to end, and whoever
/// clears away what the dead left holds their streams for as long as that takes.
const PATIENCE: Duration = Duration::from_millis(500);
const PAUSE: Duration = Duration::from_millis(10);

/// A stream as the place of streams lists it, and as a service.
struct Stream {
    stem: String,
    service: String,
}

impl Stream {
    fn of<M: Message>(camera: &str) -> Self {
        Self {
            stem: format!("{camera}.{}", M::STREAM),
            service: service_name::<M>(camera),
        }
    }
}

/// Refuses a camera whose bodies or observations another process publishes.
///
/// # Errors
/// [`LinkError::Busy`].
pub fn expect_free_camera(camera: &str) -> Result<(), LinkError> {
    expect_free(&[
        Stream::of::<BodyFrame>(camera),
        Stream::of::<ObservationFrame>(camera),
    ])
}

/// Refuses a name whose bodies another process publishes.
///
/// # Errors
/// [`LinkError::Busy`].
pub fn expect_free_bodies(name: &str) -> Result<(), LinkError> {
    expect_free(&[Stream::of::<BodyFrame>(name)])
}

fn expect_free(streams: &[Stream]) -> Result<(), LinkError> {
    let began = Instant::now();
    loop {
        // What else is wrong with the place is told by who opens a stream there.
        let alive = place::clear().unwrap_or_default();
        let Some(taken) = streams.iter().find(|s| alive.contains(&s.stem)) else {
            return Ok(());
        };
        if began.elapsed() > PATIENCE {
            return Err(LinkError::Busy {
                service: taken.service.clone(),
            });
        }
        sleep(PAUSE);
    }
}
