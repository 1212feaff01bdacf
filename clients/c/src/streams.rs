//! A camera's streams: opening, reading, closing. The calls of all of them are the same, by other names.

use std::ffi::{c_char, c_int};

use edgecap_client::Subscriber;
use edgecap_client::message::{BodyFrame, EventFrame, HealthFrame, ObservationFrame};

use crate::reader::{self, Reader};

macro_rules! stream {
    ($reader:ident of $message:ty: $open:ident, $next:ident, $newest:ident, $publishers:ident, $close:ident) => {
        /// A reader of one camera's stream.
        #[allow(non_camel_case_types, reason = "its name in C")]
        pub type $reader = Reader<$message>;

        /// Connects to `camera`'s stream, whose publisher need not run yet; null when that fails.
        ///
        /// # Safety
        /// `camera` is null or a string that ends with a zero byte.
        #[unsafe(no_mangle)]
        pub unsafe extern "C" fn $open(camera: *const c_char) -> *mut $reader {
            // SAFETY: this function's own condition.
            unsafe { reader::open(stringify!($open), camera) }
        }

        /// The oldest message not yet read, waiting up to `timeout_ms` for one: 1 and the message, 0 when none came, −1
        /// when it failed. It is valid until the next call with this reader.
        ///
        /// # Safety
        /// `reader` is null or one that is open; `frame` is null or may be written.
        #[unsafe(no_mangle)]
        pub unsafe extern "C" fn $next(
            reader: *mut $reader,
            timeout_ms: u32,
            frame: *mut *const $message,
        ) -> c_int {
            let call = stringify!($next);
            // SAFETY: this function's own conditions.
            unsafe { reader::read(call, reader, timeout_ms, frame, Subscriber::next) }
        }

        /// The newest message, older unread ones are thrown away; otherwise as `next`.
        ///
        /// # Safety
        /// `reader` is null or one that is open; `frame` is null or may be written.
        #[unsafe(no_mangle)]
        pub unsafe extern "C" fn $newest(
            reader: *mut $reader,
            timeout_ms: u32,
            frame: *mut *const $message,
        ) -> c_int {
            let call = stringify!($newest);
            // SAFETY: this function's own conditions.
            unsafe { reader::read(call, reader, timeout_ms, frame, Subscriber::newest) }
        }

        /// Processes that publish this stream now, 0 or 1; −1 when it failed.
        ///
        /// # Safety
        /// `reader` is null or one that is open.
        #[unsafe(no_mangle)]
        pub unsafe extern "C" fn $publishers(reader: *mut $reader) -> c_int {
            // SAFETY: this function's own condition.
            unsafe { reader::publishers(stringify!($publishers), reader) }
        }

        /// Closes a reader, and its message is gone with it: 0; −1 when it failed, as in another thread, and the reader
        /// is still open. Null is no reader and nothing happens.
        ///
        /// # Safety
        /// `reader` is null or one that is open; nobody uses it or its message afterwards.
        #[unsafe(no_mangle)]
        pub unsafe extern "C" fn $close(reader: *mut $reader) -> c_int {
            // SAFETY: this function's own conditions.
            unsafe { reader::close(stringify!($close), reader) }
        }
    };
}

stream!(edgecap_bodies of BodyFrame: edgecap_bodies_open, edgecap_bodies_next, edgecap_bodies_newest,
    edgecap_bodies_publishers, edgecap_bodies_close);
stream!(edgecap_observations of ObservationFrame: edgecap_observations_open, edgecap_observations_next,
    edgecap_observations_newest, edgecap_observations_publishers, edgecap_observations_close);
stream!(edgecap_events of EventFrame: edgecap_events_open, edgecap_events_next, edgecap_events_newest,
    edgecap_events_publishers, edgecap_events_close);
stream!(edgecap_health of HealthFrame: edgecap_health_open, edgecap_health_next, edgecap_health_newest,
    edgecap_health_publishers, edgecap_health_close);
