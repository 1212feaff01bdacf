//! What a file takes in memory, told before it is made.

use super::error::ExportError;

/// Most bytes of a file's numbers.
const MOST: f64 = 4.0 * GIB;
const GIB: f64 = (1_u64 << 30) as f64;

/// Refuses more than is held; `what` says what takes the bytes.
///
/// # Errors
/// [`ExportError::Format`].
pub fn expect(bytes: f64, what: impl FnOnce() -> String) -> Result<(), ExportError> {
    if bytes <= MOST {
        return Ok(());
    }
    Err(ExportError::Format(format!(
        "expected {:.0} GiB of numbers at most, found {}, which are {:.1} GiB",
        MOST / GIB,
        what(),
        bytes / GIB
    )))
}
