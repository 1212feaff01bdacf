//! How long views are: those of one length may have started and ended together.

use crate::commands::exit::Failure;
use crate::commands::view_file::ViewFile;

/// Seconds that views may differ in length which are only taken to have started together, and by which one may begin
/// or end apart from the others without a word.
pub const SPARE: f64 = 0.5;
/// What to do about views that differ in length.
pub const CUT: &str = "cut them to the same time";

/// Refuses views that differ more in length than by `apart` seconds; `uneven` is what to do then.
///
/// # Errors
/// Naming the longest and the shortest.
pub fn expect_lengths(seen: &[ViewFile], apart: f64, uneven: &str) -> anyhow::Result<()> {
    let by_length = |a: &&ViewFile, b: &&ViewFile| length(a).total_cmp(&length(b));
    let ends = (seen.iter().min_by(by_length), seen.iter().max_by(by_length));
    if let (Some(least), Some(most)) = ends
        && length(most) - length(least) > apart.max(SPARE)
    {
        return Err(Failure::data(format!(
            "expected views of one length, found {:.1} s of camera {} and {:.1} s of {}; {uneven}",
            length(most),
            most.name,
            length(least),
            least.name
        ))
        .into());
    }
    Ok(())
}

/// Seconds from a view's first frame to its last; it tells its times.
fn length(view: &ViewFile) -> f64 {
    let span = view.times[view.times.len() - 1] - view.times[0];
    span as f64 * 1e-9
}

/// Whether a view is as long as one of others, so that it may have started and ended with it; every one tells its
/// times.
pub fn is_as_long<'a>(view: &ViewFile, mut others: impl Iterator<Item = &'a ViewFile>) -> bool {
    others.any(|other| (length(other) - length(view)).abs() <= SPARE)
}
