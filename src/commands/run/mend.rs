//! What becomes of a child that has ended.

use std::process::ExitStatus;

use crate::commands::exit::{self, Failure};
use crate::metrics::Meter;
use crate::supervise::{Child, describe};

/// Looks after a child of this camera. A crash is mended, a failure that would come again is the run's; `infer` may be
/// done, which is returned.
///
/// # Errors
/// A failure that would come again, and a child that cannot be started and has never worked.
pub fn look_after(child: &mut Child, camera: &str, meter: &Meter) -> anyhow::Result<bool> {
    let status = match child.tend() {
        Ok(None) => return Ok(false),
        Ok(Some(status)) => status,
        // The system may be out of memory or process numbers for a moment.
        Err(e) if child.has_lived() => {
            let what = format!("{} cannot be started: {e}", child.verb());
            tracing::warn!("{camera}: {what}; it is tried again");
            meter.failed(what);
            child.restart();
            return Ok(false);
        }
        Err(e) => return Err(e.into()),
    };
    if status.success() && child.verb() == "infer" {
        child.leave();
        return Ok(true);
    }
    let has_seen = child.verb() == "infer" && child.has_worked();
    if let Some(code) = permanent(status, child.has_lived(), has_seen) {
        return Err(Failure::silent(code).into());
    }
    let what = format!("{} ended with {}", child.verb(), describe(status));
    tracing::warn!("{camera}: {what}; starting it again");
    meter.failed(what);
    child.restart();
    Ok(false)
}

/// The exit code of a failure that would come again. A camera or stream that was there before may come back, and so may
/// the camera that the settings suited, where pictures were seen with them.
fn permanent(status: ExitStatus, has_lived: bool, has_seen: bool) -> Option<u8> {
    let code = status.code()? as u8;
    let passes = match code {
        // Who was ended by another than its supervisor is missed.
        0 | exit::INTERRUPTED | exit::SOFTWARE | exit::PANICKED | exit::IO => true,
        exit::UNAVAILABLE | exit::TRY_LATER | exit::NO_INPUT => has_lived,
        exit::CONFIG => has_seen,
        _ => false,
    };
    (!passes).then_some(code)
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::symlink;
    use std::os::unix::process::ExitStatusExt;
    use std::time::{Duration, Instant};

    use super::*;

    /// A busy machine takes its time; a child that is never started again would be waited for without end.
    const PATIENCE: Duration = Duration::from_secs(60);

    #[test]
    fn a_panic_is_mended_as_any_crash_and_bad_data_is_not() {
        let ended = |code: u8| permanent(ExitStatus::from_raw(i32::from(code) << 8), true, true);
        assert_eq!(ended(exit::PANICKED), None);
        assert_eq!(ended(exit::DATA), Some(exit::DATA));
        let killed = ExitStatus::from_raw(9);
        assert_eq!(permanent(killed, false, false), None);
    }

    /// A camera that was waited for shows nothing of them.
    #[test]
    fn settings_are_wrong_until_a_picture_was_seen_with_them() {
        let wrong = ExitStatus::from_raw(i32::from(exit::CONFIG) << 8);
        assert_eq!(permanent(wrong, true, false), Some(exit::CONFIG));
        assert_eq!(permanent(wrong, true, true), None);
    }

    #[test]
    fn one_that_has_worked_and_cannot_be_started_is_tried_again() {
        let folder = tempfile::tempdir().unwrap();
        let [program, verb] = ["sh", "lives"].map(|n| folder.path().join(n));
        std::fs::write(&verb, "printf .").unwrap();
        symlink("/bin/sh", &program).unwrap();
        let verb = verb.to_str().unwrap().to_owned().leak();
        let mut child = Child::new(verb, ()).unwrap().of(&program);
        let meter = Meter::new("hall", "camera", &[]);
        let mut until = |starts| {
            let since = Instant::now();
            while child.starts() < starts {
                assert!(!look_after(&mut child, "hall", &meter).unwrap());
                assert!(since.elapsed() < PATIENCE, "{} starts", child.starts());
                std::thread::sleep(Duration::from_millis(1));
            }
        };
        until(1);
        std::fs::remove_file(&program).unwrap();
        until(4);
        let said = meter.snapshot().last_error.expect("it has failed");
        assert!(said.contains("cannot be started"), "{said}");
        symlink("/bin/sh", &program).unwrap();
        until(5);
    }

    #[test]
    fn one_that_cannot_be_started_at_all_ends_the_run() {
        let mut child = Child::new("fit", ()).unwrap().of("/nowhere/edgecap");
        let meter = Meter::new("hall", "camera", &[]);
        assert!(look_after(&mut child, "hall", &meter).is_err());
    }
}
