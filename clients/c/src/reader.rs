//! What readers of all streams have in common: a subscriber, the message that the caller looks at, and the thread they
//! belong to.

use std::cell::Cell;
use std::ffi::{CStr, c_char, c_int};
use std::ptr::null_mut;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use edgecap_client::{LinkError, Message, Received, Subscriber};

use crate::error::{CallError, guarded};

pub(crate) const ERROR: c_int = -1;
const NONE: c_int = 0;
const MESSAGE: c_int = 1;

/// A reader of one camera's stream, and the message that the caller looks at.
#[derive(Debug)]
pub struct Reader<M: Message> {
    subscriber: Subscriber<M>,
    held: Option<Received<M>>,
    /// The number of the thread that it belongs to.
    thread: u64,
}

/// This thread's number: as `std` has one, but for destructors of a program's globals, too, which run when the thread's
/// values are gone. A number needs no destructor, so that it never is.
fn this_thread() -> u64 {
    static LAST: AtomicU64 = AtomicU64::new(0);
    thread_local! {
        static NUMBER: Cell<u64> = const { Cell::new(0) };
    }
    let number = NUMBER.try_with(|number| {
        if number.get() == 0 {
            number.set(LAST.fetch_add(1, Ordering::Relaxed) + 1);
        }
        number.get()
    });
    // Nobody has 0: without a number no reader is this thread's.
    number.unwrap_or(0)
}

/// How a message is taken.
pub(crate) type Take<M> = fn(&Subscriber<M>, Duration) -> Result<Option<Received<M>>, LinkError>;

/// Connects to `camera`'s stream; null when that fails.
///
/// # Safety
/// `camera` is null or a string that ends with a zero byte.
pub(crate) unsafe fn open<M: Message>(call: &'static str, camera: *const c_char) -> *mut Reader<M> {
    guarded(null_mut(), || {
        if camera.is_null() {
            let what = "a camera's name";
            return Err(CallError::Null { call, what });
        }
        // SAFETY: not null; the caller upholds that it is a string with an end.
        let camera = unsafe { CStr::from_ptr(camera) };
        let camera = camera.to_str().map_err(|_| CallError::Text)?;
        Ok(Box::into_raw(Box::new(Reader {
            subscriber: Subscriber::open(camera)?,
            held: None,
            thread: this_thread(),
        })))
    })
}

/// Takes a message and shows it to the caller, who may look at it until the next call with this reader.
///
/// # Safety
/// `reader` is null or one that is open; `message` is null or may be written.
pub(crate) unsafe fn read<M: Message>(
    call: &'static str,
    reader: *mut Reader<M>,
    timeout_ms: u32,
    message: *mut *const M,
    take: Take<M>,
) -> c_int {
    guarded(ERROR, || {
        if message.is_null() {
            let what = "a place for the frame";
            return Err(CallError::Null { call, what });
        }
        // SAFETY: this function's own condition.
        let (subscriber, held) = unsafe { of(call, reader) }?;
        // A reader may hold two messages: without this one, `newest` could not step over others.
        *held = None;
        let timeout = Duration::from_millis(timeout_ms.into());
        *held = take(subscriber, timeout)?;
        let Some(held) = held else {
            return Ok(NONE);
        };
        // SAFETY: not null; the caller upholds that it may be written. The message stays where it is while it is held.
        unsafe { message.write(&raw const **held) };
        Ok(MESSAGE)
    })
}

/// How many processes publish, 0 or 1; −1 when it failed.
///
/// # Safety
/// `reader` is null or one that is open.
pub(crate) unsafe fn publishers<M: Message>(call: &'static str, reader: *mut Reader<M>) -> c_int {
    guarded(ERROR, || {
        // SAFETY: this function's own condition.
        let (subscriber, _) = unsafe { of(call, reader) }?;
        Ok(c_int::from(subscriber.publisher_count() > 0))
    })
}

/// Closes a reader, 0; null is none. −1 when it failed: then the reader is still open.
///
/// # Safety
/// `reader` is null or one that is open; nobody uses it or its message afterwards.
pub(crate) unsafe fn close<M: Message>(call: &'static str, reader: *mut Reader<M>) -> c_int {
    guarded(ERROR, || {
        if reader.is_null() {
            return Ok(NONE);
        }
        // SAFETY: this function's own condition.
        unsafe { of(call, reader) }?;
        // SAFETY: it came from a box in `open`, and the caller upholds that it is closed once.
        drop(unsafe { Box::from_raw(reader) });
        Ok(NONE)
    })
}

/// What the owner has of a reader: the subscriber, and the message that the caller looks at. Not all of it: another
/// thread may look at whose it is meanwhile.
type Own<'a, M> = (&'a Subscriber<M>, &'a mut Option<Received<M>>);

/// The reader behind a pointer.
///
/// # Safety
/// `reader` is null or one that is open; what was given for it before is not used any more.
unsafe fn of<'a, M: Message>(
    call: &'static str,
    reader: *mut Reader<M>,
) -> Result<Own<'a, M>, CallError> {
    let what = "a reader";
    if reader.is_null() {
        return Err(CallError::Null { call, what });
    }
    // SAFETY: the caller upholds that it is a reader; its thread is never written after opening, so that any thread may
    // look.
    if unsafe { (*reader).thread } != this_thread() {
        return Err(CallError::Thread);
    }
    // SAFETY: the caller upholds that it is an open reader. Only the thread that opened it comes here (compared above),
    // one call after the other, so that nobody else has these two fields; others read `thread` alone, which neither
    // covers.
    Ok(unsafe { (&(*reader).subscriber, &mut (*reader).held) })
}
