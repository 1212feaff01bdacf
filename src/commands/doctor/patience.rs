//! Checks that end: what is looked at may hang, whoever looks may not.

use std::sync::mpsc::channel;
use std::time::Duration;

use super::finding::{Finding, State};
use crate::commands::exit;

/// What a check finds within `limit`, else that it hangs. Its thread then ends with this process.
pub fn within(
    what: &'static str,
    limit: Duration,
    check: impl FnOnce() -> Finding + Send + 'static,
) -> Finding {
    attempt(limit, check).unwrap_or_else(|| {
        let text = format!(
            "no answer within {} s: something that it opens hangs, such as a device or a pipe in place of a file",
            limit.as_secs()
        );
        Finding::new(what, State::Broken(exit::TRY_LATER), text)
    })
}

/// What `work` returns within `limit`; `None` where it hangs, or ended unexpectedly.
pub fn attempt<T: Send + 'static>(
    limit: Duration,
    work: impl FnOnce() -> T + Send + 'static,
) -> Option<T> {
    let (send, receive) = channel();
    std::thread::Builder::new()
        .name("check".into())
        .spawn(move || send.send(work()))
        .ok()?;
    receive.recv_timeout(limit).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_hangs_is_broken() {
        let hangs = || loop {
            std::thread::park();
        };
        let finding = within("it", Duration::from_millis(50), hangs);
        assert_eq!(finding.state, State::Broken(exit::TRY_LATER));
        assert_eq!(attempt(Duration::from_secs(60), || 7), Some(7));
    }
}
