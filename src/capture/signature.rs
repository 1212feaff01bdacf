//! What the first bytes of a file say of it.

/// What a PNG begins with.
pub const PNG_START: &[u8] = b"\x89PNG\r\n\x1a\n";

/// Whether the first bytes are those of a JPEG.
pub fn is_jpeg(bytes: &[u8]) -> bool {
    bytes.starts_with(&[0xFF, 0xD8, 0xFF])
}

/// Whether the first bytes are those of a PNG.
pub fn is_png(bytes: &[u8]) -> bool {
    bytes.starts_with(PNG_START)
}
