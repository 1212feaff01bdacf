//! How large a picture may be: a few bytes of a damaged header must not ask for all the memory there is.

/// Longest side of a picture, pixels.
pub const MAX_SIDE: u32 = 16_384;
/// Most pixels of a picture: 300 MB as RGB.
pub const MAX_PIXELS: u64 = 100_000_000;

/// Refuses sizes of 0 and beyond the limits.
pub(crate) fn check_size(width: u64, height: u64) -> Result<(), String> {
    if width == 0 || height == 0 {
        return Err(format!(
            "expected a picture, found one of {width}x{height} pixels; the file is damaged"
        ));
    }
    let side = u64::from(MAX_SIDE);
    if width > side || height > side || width * height > MAX_PIXELS {
        return Err(format!(
            "the picture has {width}x{height} pixels, at most {MAX_SIDE} a side and {} million in all are taken; make it smaller",
            MAX_PIXELS / 1_000_000
        ));
    }
    Ok(())
}
