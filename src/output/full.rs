//! Whether an error of writing says that nothing more finds room, and what to do about it.

use std::io;

use rustix::io::Errno;

/// What is wrong and what to do, where an error says that nothing more finds room.
pub fn no_room(error: &io::Error) -> Option<&'static str> {
    if is_limited(error) {
        return Some(
            "the system lets no file become longer: raise the limit (ulimit -f, LimitFSIZE=)",
        );
    }
    match error.kind() {
        io::ErrorKind::StorageFull => Some("the disk is full: make room"),
        io::ErrorKind::QuotaExceeded => Some("the quota on the disk is used up: make room"),
        _ => None,
    }
}

/// Whether a format has no room for more, such as an AVI of 1 GiB, and not the system.
pub fn is_full(error: &io::Error) -> bool {
    error.kind() == io::ErrorKind::FileTooLarge && !is_limited(error)
}

/// Whether the system's limit on the length of files was met.
fn is_limited(error: &io::Error) -> bool {
    error.raw_os_error() == Some(Errno::FBIG.raw_os_error())
}
