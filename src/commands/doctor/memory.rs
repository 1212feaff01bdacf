//! Shared memory: whether a message arrives, and who publishes.

use std::time::Duration;
use std::time::Instant;

use edgecap_client::message::BodyFrame;
use edgecap_client::{LinkError, Publisher, Subscriber, place};

use super::finding::{Finding, State};
use crate::commands::exit;

pub const MEMORY: &str = "shared memory";
pub const RUNNING: &str = "running";

/// So many messages are timed; the first brings reader and writer together.
const MESSAGES: u64 = 15;

/// Messages go round through a stream of their own.
pub fn shared_memory() -> Finding {
    let name = format!("doctor-{}", std::process::id());
    let round = || -> Result<Option<Duration>, LinkError> {
        let reader = Subscriber::<BodyFrame>::open(&name)?;
        let mut writer = Publisher::<BodyFrame>::open(&name)?;
        let mut times = Vec::new();
        for sequence in 0..=MESSAGES {
            let sent = BodyFrame {
                sequence,
                ..BodyFrame::default()
            };
            let start = Instant::now();
            writer.publish(&sent)?;
            let received = reader.next(Duration::from_secs(1))?;
            if received.is_none_or(|r| *r != sent) {
                return Ok(None);
            }
            times.push(start.elapsed());
        }
        let times = &mut times[1..];
        times.sort_unstable();
        Ok(Some(times[times.len() / 2]))
    };
    match round() {
        Ok(Some(time)) => {
            let text = format!(
                "a message takes {:.0} µs; in {}",
                1e6 * time.as_secs_f64(),
                place::runtime_dir().display()
            );
            Finding::new(MEMORY, State::Fine, text)
        }
        Ok(None) => {
            let text = "a message did not arrive within a second: is the machine overloaded?";
            Finding::new(MEMORY, State::Broken(exit::IO), text)
        }
        Err(e) => Finding::failed(MEMORY, e),
    }
}

/// Which of these cameras publish.
pub fn running(names: &[String]) -> Finding {
    let mut silent = Vec::new();
    for name in names {
        match Subscriber::<BodyFrame>::open(name) {
            Ok(bodies) if bodies.publisher_count() > 0 => {}
            Ok(_) => silent.push(name.as_str()),
            Err(e) => return Finding::failed(RUNNING, e),
        }
    }
    if silent.is_empty() {
        let (verb, all) = (["publishes", "publish"], names.join(", "));
        let verb = verb[usize::from(names.len() > 1)];
        let text = format!("{all} {verb}: 'edgecap watch' shows it");
        return Finding::new(RUNNING, State::Fine, text);
    }
    let text = format!(
        "nobody publishes {}: 'edgecap' starts it",
        silent.join(", ")
    );
    Finding::new(RUNNING, State::Note, text)
}
