//! Sources that give pictures undecoded, for who wants them drawn: a [`Source`] goes in, [`Frame`]s come out.

use super::error::CaptureError;
use super::frame::Frame;
use super::raw::{RawDecoder, RawPicture};
use super::source::Source;

/// What such a source keeps from picture to picture: memory that is used again.
#[derive(Debug, Default)]
pub(super) struct Drawing {
    raw: RawPicture,
    decoder: RawDecoder,
}

/// [`Source::next_into`] by [`Source::next_raw`], which must not need what is `kept`.
///
/// # Errors
/// Those of [`Source::next_raw`]; [`CaptureError::Picture`], which names the source and the frame, where a picture
/// cannot be decoded.
pub(super) fn next_drawn<S: Source>(
    source: &mut S,
    kept: impl Fn(&mut S) -> &mut Drawing,
    frame: &mut Frame,
) -> Result<bool, CaptureError> {
    let mut own = std::mem::take(kept(source));
    let read = source.next_raw(&mut own.raw).and_then(|more| {
        if more {
            own.decoder.decode_of(source.name(), &mut own.raw, frame)?;
        }
        Ok(more)
    });
    *kept(source) = own;
    read
}
