//! A camera's bodies: opening, reading, closing.

use std::ffi::{CStr, c_char, c_int};
use std::ptr::null_mut;
use std::thread::{self, ThreadId};
use std::time::Duration;

use edgecap_client::message::BodyFrame;
use edgecap_client::{LinkError, Received, Subscriber};

use crate::error::{CallError, guarded};

const ERROR: c_int = -1;
const NONE: c_int = 0;
const FRAME: c_int = 1;

/// A reader of one camera's bodies, and the frame that the caller looks at.
#[allow(non_camel_case_types, reason = "its name in C")]
#[derive(Debug)]
pub struct edgecap_bodies {
    subscriber: Subscriber<BodyFrame>,
    held: Option<Received<BodyFrame>>,
    thread: ThreadId,
}

/// Connects to `camera`'s bodies, whose publisher need not run yet; null when that fails.
///
/// # Safety
/// `camera` is null or a string that ends with a zero byte.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn edgecap_bodies_open(camera: *const c_char) -> *mut edgecap_bodies {
    guarded(null_mut(), || {
        if camera.is_null() {
            return Err(CallError::Null {
                call: "edgecap_bodies_open",
                what: "a camera's name",
            });
        }
        // SAFETY: not null; the caller upholds that it is a string with an end.
        let camera = unsafe { CStr::from_ptr(camera) };
        let camera = camera.to_str().map_err(|_| CallError::Text)?;
        Ok(Box::into_raw(Box::new(edgecap_bodies {
            subscriber: Subscriber::open(camera)?,
            held: None,
            thread: thread::current().id(),
        })))
    })
}

/// The oldest frame not yet read, waiting up to `timeout_ms` for one: 1 and the frame, 0 when none came, −1 when it failed.
/// The frame is valid until the next call with this reader.
///
/// # Safety
/// `bodies` is null or a reader that is open; `frame` is null or may be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn edgecap_bodies_next(
    bodies: *mut edgecap_bodies,
    timeout_ms: u32,
    frame: *mut *const BodyFrame,
) -> c_int {
    // SAFETY: this function's own conditions.
    unsafe {
        read(
            "edgecap_bodies_next",
            bodies,
            timeout_ms,
            frame,
            Subscriber::next,
        )
    }
}

/// The newest frame, older unread ones are thrown away; otherwise [`edgecap_bodies_next`].
///
/// # Safety
/// As for [`edgecap_bodies_next`].
#[unsafe(no_mangle)]
pub unsafe extern "C" fn edgecap_bodies_newest(
    bodies: *mut edgecap_bodies,
    timeout_ms: u32,
    frame: *mut *const BodyFrame,
) -> c_int {
    // SAFETY: this function's own conditions.
    unsafe {
        read(
            "edgecap_bodies_newest",
            bodies,
            timeout_ms,
            frame,
            Subscriber::newest,
        )
    }
}

/// Processes that publish these bodies now, 0 or 1; −1 when it failed.
///
/// # Safety
/// `bodies` is null or a reader that is open.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn edgecap_bodies_publishers(bodies: *mut edgecap_bodies) -> c_int {
    guarded(ERROR, || {
        // SAFETY: this function's own condition.
        let reader = unsafe { reader("edgecap_bodies_publishers", bodies) }?;
        Ok(c_int::from(reader.subscriber.publisher_count() > 0))
    })
}

/// Frees what killed processes left behind.
///
/// # Safety
/// `bodies` is null or a reader that is open.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn edgecap_bodies_clean_up(bodies: *mut edgecap_bodies) {
    guarded((), || {
        // SAFETY: this function's own condition.
        let reader = unsafe { reader("edgecap_bodies_clean_up", bodies) }?;
        reader.subscriber.clean_up();
        Ok(())
    });
}

/// Closes a reader; its frame is gone with it. Null is no reader and nothing happens.
///
/// # Safety
/// `bodies` is null or a reader that is open; nobody uses it or its frame afterwards.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn edgecap_bodies_close(bodies: *mut edgecap_bodies) {
    guarded((), || {
        if bodies.is_null() {
            return Ok(());
        }
        // SAFETY: this function's own condition.
        let reader = unsafe { reader("edgecap_bodies_close", bodies) }?;
        // SAFETY: it came from a box in `edgecap_bodies_open`, and the caller upholds that it is closed once.
        drop(unsafe { Box::from_raw(reader) });
        Ok(())
    });
}

/// The reader behind a pointer.
///
/// # Safety
/// `bodies` is null or a reader that is open.
unsafe fn reader<'a>(
    call: &'static str,
    bodies: *mut edgecap_bodies,
) -> Result<&'a mut edgecap_bodies, CallError> {
    let what = "a reader";
    if bodies.is_null() {
        return Err(CallError::Null { call, what });
    }
    // SAFETY: the caller upholds that it is a reader; its thread is never written after opening, so that any thread may look.
    if unsafe { (*bodies).thread } != thread::current().id() {
        return Err(CallError::Thread);
    }
    // SAFETY: as above, and only the thread that opened it comes here, one call after the other.
    Ok(unsafe { &mut *bodies })
}

type Read = fn(&Subscriber<BodyFrame>, Duration) -> Result<Option<Received<BodyFrame>>, LinkError>;

/// Takes a frame with `how` and shows it to the caller.
///
/// # Safety
/// As for [`edgecap_bodies_next`].
unsafe fn read(
    call: &'static str,
    bodies: *mut edgecap_bodies,
    timeout_ms: u32,
    frame: *mut *const BodyFrame,
    how: Read,
) -> c_int {
    guarded(ERROR, || {
        if frame.is_null() {
            let what = "a place for the frame";
            return Err(CallError::Null { call, what });
        }
        // SAFETY: this function's own condition.
        let reader = unsafe { reader(call, bodies) }?;
        // A reader may hold two messages: without this one, `newest` could not step over others.
        reader.held = None;
        let timeout = Duration::from_millis(timeout_ms.into());
        reader.held = how(&reader.subscriber, timeout)?;
        let Some(held) = &reader.held else {
            return Ok(NONE);
        };
        // SAFETY: not null; the caller upholds that it may be written. The message stays where it is while it is held.
        unsafe { frame.write(&raw const **held) };
        Ok(FRAME)
    })
}
