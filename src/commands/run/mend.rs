//! What becomes of a child that has ended.

use std::process::ExitStatus;

use crate::commands::exit::{self, Failure};
use crate::metrics::Meter;
use crate::supervise::{Child, describe};

/// Looks after a child of this camera. A crash is mended, a failure that would come again is the run's; `infer` may be
/// done, which is returned.
pub fn look_after(child: &mut Child, camera: &str, meter: &Meter) -> anyhow::Result<bool> {
    let Some(status) = child.tend()? else {
        return Ok(false);
    };
    if status.success() && child.verb() == "infer" {
        child.leave();
        return Ok(true);
    }
    if let Some(code) = permanent(status, child.has_lived()) {
        return Err(Failure::silent(code).into());
    }
    let what = format!("{} ended with {}", child.verb(), describe(status));
    tracing::warn!("{camera}: {what}; starting it again");
    meter.failed(what);
    child.restart();
    Ok(false)
}

/// The exit code of a failure that would come again. A camera or stream that worked before may come back.
fn permanent(status: ExitStatus, has_lived: bool) -> Option<u8> {
    let code = status.code()? as u8;
    let passes = match code {
        // Who was ended by another than its supervisor is missed.
        0 | exit::INTERRUPTED | exit::SOFTWARE | exit::PANICKED | exit::IO => true,
        exit::UNAVAILABLE | exit::TRY_LATER | exit::NO_INPUT => has_lived,
        _ => false,
    };
    (!passes).then_some(code)
}

#[cfg(test)]
mod tests {
    use std::os::unix::process::ExitStatusExt;

    use super::*;

    #[test]
    fn a_panic_is_mended_as_any_crash_and_bad_data_is_not() {
        let ended = |code: u8| permanent(ExitStatus::from_raw(i32::from(code) << 8), true);
        assert_eq!(ended(exit::PANICKED), None);
        assert_eq!(ended(exit::DATA), Some(exit::DATA));
        let killed = ExitStatus::from_raw(9);
        assert_eq!(permanent(killed, false), None);
    }
}
