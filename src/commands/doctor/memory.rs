//! Shared memory: whether a message arrives, and who publishes.

use std::time::Duration;
use std::time::Instant;

use edgecap_client::message::BodyFrame;
use edgecap_client::{LinkError, Publisher, Subscriber, place};

use super::finding::{Finding, State};
use crate::commands::closed;
use crate::commands::exit;
use crate::commands::input::DEFAULT_NAME;

pub const MEMORY: &str = "shared memory";
pub const RUNNING: &str = "running";

/// How the stream of a check is called, before the number of its process.
const CHECK: &str = "doctor-";
/// So many messages are timed; the first brings reader and writer together.
const MESSAGES: u64 = 15;

/// Whether a stream is that of a check, which nobody is to see.
pub fn is_check(name: &str) -> bool {
    let number = name.strip_prefix(CHECK);
    number.is_some_and(|n| n.parse::<u32>().is_ok())
}

/// Messages go round through a stream of their own.
pub fn shared_memory() -> Finding {
    let name = format!("{CHECK}{}", std::process::id());
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

/// The command that shows the first of them.
fn watch(names: &[String]) -> String {
    match names.first() {
        Some(name) if name != DEFAULT_NAME => format!("edgecap watch --name {name}"),
        _ => "edgecap watch".to_owned(),
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
        let text = format!("{all} {verb}: '{}' shows it", watch(names));
        return Finding::new(RUNNING, State::Fine, text);
    }
    let silent = silent.join(", ");
    let text = match closed::advice() {
        Some(advice) => format!("nobody publishes {silent} that this user may see; {advice}"),
        None => format!("nobody publishes {silent}: 'edgecap' starts it"),
    };
    Finding::new(RUNNING, State::Note, text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_check_is_known_by_its_number() {
        assert!(is_check("doctor-4711"));
        assert!(!is_check("doctor-room") && !is_check("doctor-") && !is_check("camera0"));
    }

    #[test]
    fn a_name_is_typed_where_it_is_not_the_usual_one() {
        assert_eq!(watch(&["camera0".to_owned()]), "edgecap watch");
        let names = ["hall", "yard"].map(ToOwned::to_owned);
        assert_eq!(watch(&names), "edgecap watch --name hall");
    }
}
