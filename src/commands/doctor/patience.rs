//! Checks that end: what is looked at may hang, whoever looks may not.

use std::io;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

use super::finding::{Finding, State};
use crate::commands::exit::{self, Failure};

/// Why there is no answer.
#[derive(Debug)]
pub enum Unanswered {
    /// It takes longer than it may.
    Hangs,
    /// It has panicked, and said so.
    Broke,
    /// The system has no thread for it.
    NoThread(io::Error),
}

/// What a check finds within `limit`, else why it found nothing. Where it hangs its thread ends with this process.
pub fn within(
    what: &'static str,
    limit: Duration,
    check: impl FnOnce() -> Finding + Send + 'static,
) -> Finding {
    attempt(limit, check).unwrap_or_else(|why| {
        let hangs = format!(
            "no answer within {} s: something that it opens hangs, such as a device or a pipe in place of a file",
            limit.as_secs()
        );
        unanswered(what, why, hangs)
    })
}

/// What to say of a check without an answer; of one that hangs, `hangs`.
pub fn unanswered(what: &'static str, why: Unanswered, hangs: impl Into<String>) -> Finding {
    match why {
        Unanswered::Hangs => Finding::new(what, State::Broken(exit::TRY_LATER), hangs),
        Unanswered::Broke => Finding::new(what, State::Broken(exit::SOFTWARE), BROKE),
        Unanswered::NoThread(e) => Finding::failed(what, Failure::no_thread("to look with", &e)),
    }
}

/// What to say of a check that panicked.
const BROKE: &str =
    "the check itself broke, as is said above: report it with this report of 'edgecap doctor'";

/// What `work` returns within `limit`.
///
/// # Errors
/// Why there is no answer.
pub fn attempt<T: Send + 'static>(
    limit: Duration,
    work: impl FnOnce() -> T + Send + 'static,
) -> Result<T, Unanswered> {
    attempt_on(std::thread::Builder::new(), limit, work)
}

fn attempt_on<T: Send + 'static>(
    thread: std::thread::Builder,
    limit: Duration,
    work: impl FnOnce() -> T + Send + 'static,
) -> Result<T, Unanswered> {
    let (send, receive) = channel();
    thread
        .name("check".into())
        .spawn(move || send.send(work()))
        .map_err(Unanswered::NoThread)?;
    receive.recv_timeout(limit).map_err(|e| match e {
        RecvTimeoutError::Timeout => Unanswered::Hangs,
        RecvTimeoutError::Disconnected => Unanswered::Broke,
    })
}

#[cfg(test)]
mod tests {
    use std::panic::resume_unwind;
    use std::thread::Builder;

    use super::*;

    /// Nothing that is waited for comes later than this.
    const AMPLE: Duration = Duration::from_secs(60);

    #[test]
    fn what_hangs_is_broken() {
        let hangs = || loop {
            std::thread::park();
        };
        let finding = within("it", Duration::from_millis(50), hangs);
        assert_eq!(finding.state, State::Broken(exit::TRY_LATER));
        assert!(finding.text.contains("hangs"), "{}", finding.text);
        assert_eq!(attempt(AMPLE, || 7).unwrap(), 7);
    }

    #[test]
    fn a_check_that_breaks_does_not_hang() {
        let finding = within("it", AMPLE, || resume_unwind(Box::new("a panic")));
        assert_eq!(finding.state, State::Broken(exit::SOFTWARE));
        assert!(!finding.text.contains("hangs"), "{}", finding.text);
    }

    /// A stack that no machine has room for stands in for a system that starts no more threads.
    #[test]
    fn a_check_without_a_thread_does_not_hang() {
        let none = Builder::new().stack_size(1 << 60);
        let why = attempt_on(none, AMPLE, || ()).unwrap_err();
        let finding = unanswered("it", why, "hangs");
        assert_eq!(finding.state, State::Broken(exit::UNAVAILABLE));
        assert!(
            finding.text.contains("a thread to look with"),
            "{}",
            finding.text
        );
    }
}
