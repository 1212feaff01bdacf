//! What the system says against a camera, in the user's terms.

use std::io;

use super::list::not_permitted;
use crate::capture::error::CaptureError;

/// The system's refusal of a camera in the user's terms.
pub fn refused(device: &str, error: io::Error) -> CaptureError {
    let device = device.to_owned();
    match error.raw_os_error() {
        Some(libc::EBUSY) => CaptureError::Busy {
            device,
            reason:
                "another program uses this camera; close it (browser, video call) and try again"
                    .into(),
        },
        Some(libc::EACCES | libc::EPERM) => not_permitted(&device),
        Some(libc::ENOENT | libc::ENODEV | libc::ENXIO) => CaptureError::Unavailable {
            what: device,
            reason: "expected a camera, found none; plug it in, or look for another one under /dev/video*".into(),
        },
        Some(libc::ENOTTY) => unusable(device, "is no camera"),
        Some(libc::ENOSPC) => CaptureError::Unavailable {
            what: device,
            reason: "its USB bus has no room for its pictures beside those of other cameras; plug it into a socket of \
                     another bus (lsusb -t), or ask all on this one for less by --capture-size and --fps"
                .into(),
        },
        _ => CaptureError::Unavailable {
            what: device,
            reason: format!("the camera refuses to start ({error}); unplug it, plug it in again, try another size"),
        },
    }
}

/// A device that is of no use here, and why.
pub fn unusable(device: String, what: &str) -> CaptureError {
    CaptureError::Unavailable {
        what: device,
        reason: format!("this device {what}; choose another one"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_bus_is_named() {
        let error = refused("/dev/video2", io::Error::from_raw_os_error(libc::ENOSPC));
        assert_eq!(error.exit_code(), 69);
        let text = error.to_string();
        assert!(
            text.contains("/dev/video2") && text.contains("USB bus"),
            "{text}"
        );
        assert!(!text.contains("space"), "no disk is full: {text}");
    }
}
