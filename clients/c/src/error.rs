//! What can fail in a call from C, and what the last failed call of a thread has to say.

use std::cell::RefCell;
use std::ffi::{CString, c_char};
use std::panic::{AssertUnwindSafe, catch_unwind};

use edgecap_client::LinkError;

/// Why a call failed.
#[derive(Debug, thiserror::Error)]
pub(crate) enum CallError {
    #[error("{call}: expected {what}, found NULL")]
    Null {
        call: &'static str,
        what: &'static str,
    },
    #[error(
        "camera name: expected 1 to 64 of a-z, A-Z, 0-9, '-' and '_', found bytes that are no UTF-8"
    )]
    Text,
    #[error("a reader belongs to the thread that opened it: open another one in this thread")]
    Thread,
    #[error(transparent)]
    Link(#[from] LinkError),
}

thread_local! {
    static LAST: RefCell<CString> = RefCell::default();
}

/// Why this thread's last call with a reader or a frame failed, one line; empty when it did not. Valid until the next
/// such call.
#[unsafe(no_mangle)]
pub extern "C" fn edgecap_error() -> *const c_char {
    LAST.try_with(|text| text.borrow().as_ptr())
        .unwrap_or(c"".as_ptr())
}

fn remember(text: &str) {
    // A zero byte would end the text early; none of our messages holds one. Destructors of a program's own globals run
    // when this thread's values are gone: they have nobody to ask.
    let _ = LAST.try_with(|last| last.replace(CString::new(text).unwrap_or_default()));
}

/// Runs `call`; where it fails or panics, `failed` is the answer and the reason is kept for [`edgecap_error`].
pub(crate) fn guarded<T>(failed: T, call: impl FnOnce() -> Result<T, CallError>) -> T {
    // What a panic leaves half done lies behind the handle, which the caller is told to close.
    let (answer, text) = match catch_unwind(AssertUnwindSafe(call)) {
        Ok(Ok(answer)) => (answer, String::new()),
        Ok(Err(e)) => (failed, e.to_string()),
        Err(_) => (
            failed,
            "edgecap failed inside (stderr says where): close this reader and open another".into(),
        ),
    };
    remember(&text);
    answer
}
