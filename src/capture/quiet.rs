//! Other people's parsers, which panic on some damaged input: a panic of theirs goes in, `None` comes out.

use std::cell::Cell;
use std::panic::{self, AssertUnwindSafe};
use std::sync::Once;

thread_local! {
    /// Whether this thread's panics are caught, and told in other words.
    static QUIET: Cell<bool> = const { Cell::new(false) };
}

/// Runs a parser; `None` when it panicked, without a word on the terminal.
///
/// The hook is put in once and asks the thread. One put in for each call would hush other threads, and of two calls at
/// the same time the one that ends last would leave the other's in place for good.
pub(crate) fn quietly<T>(parse: impl FnOnce() -> T) -> Option<T> {
    static HOOK: Once = Once::new();
    HOOK.call_once(|| {
        let loud = panic::take_hook();
        panic::set_hook(Box::new(move |what| {
            if !QUIET.get() {
                loud(what);
            }
        }));
    });
    let outer = QUIET.replace(true);
    // What the parser was building is dropped with it, and what it was filling is filled anew.
    let result = panic::catch_unwind(AssertUnwindSafe(parse));
    QUIET.set(outer);
    result.ok()
}

#[cfg(test)]
mod tests {
    use std::process::Command;

    use super::*;

    /// Set in the process whose standard error the test reads.
    const CHILD: &str = "EDGECAP_TEST_QUIET";

    #[test]
    fn a_caught_panic_is_not_heard_and_any_other_is() {
        if std::env::var_os(CHILD).is_some() {
            assert_eq!(quietly(|| 3), Some(3));
            assert_eq!(quietly(|| panic!("hushed")), None::<()>);
            assert!(std::thread::spawn(|| panic!("elsewhere")).join().is_err());
            panic!("afterwards");
        }
        let name = "capture::quiet::tests::a_caught_panic_is_not_heard_and_any_other_is";
        let output = Command::new(std::env::current_exe().unwrap())
            .args([name, "--exact", "--nocapture"])
            .env(CHILD, "1")
            .output()
            .unwrap();
        let heard = String::from_utf8_lossy(&output.stderr);
        for (word, wanted) in [("hushed", false), ("elsewhere", true), ("afterwards", true)] {
            assert_eq!(heard.contains(word), wanted, "{word}: {heard}");
        }
    }
}
