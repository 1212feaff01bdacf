//! The first block of a JPEG: how wide its pixels are.

use super::square::PixelShape;

/// Bytes of a JPEG up to the end of the densities that its first block may hold.
pub(super) const JFIF_BYTES: usize = 18;

/// The shape of a JPEG's pixels; `None` where its densities are those of paper.
pub(super) fn jfif_shape(head: &[u8; JFIF_BYTES]) -> Option<PixelShape> {
    // Start of image, APP0, its length, the name, a version, the unit: 0 has densities be the pixel's width and height.
    if head[..4] != [0xFF, 0xD8, 0xFF, 0xE0] || &head[6..11] != b"JFIF\0" || head[13] != 0 {
        return None;
    }
    let word = |at: usize| u64::from(u16::from_be_bytes([head[at], head[at + 1]]));
    PixelShape::new(word(14), word(16))
}
