//! Where an NHWC tensor lies in a buffer.

/// Placement of an NHWC tensor, or of a channel slice of one, in a flat buffer. Units are elements.
///
/// Pixel (row y, column x), channel c is at `origin + y * row_stride + x * pixel_stride + c`. `halo` pixels on every side
/// are part of the buffer too and hold the padding value, so that convolutions need no border cases.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Layout {
    /// Rows.
    pub height: usize,
    /// Columns.
    pub width: usize,
    /// Channels of this slice.
    pub channels: usize,
    /// Elements from one pixel to the next in a row; at least `channels`.
    pub pixel_stride: usize,
    /// Elements from one row to the next; at least `(width + 2 * halo) * pixel_stride`.
    pub row_stride: usize,
    /// Index of pixel (0, 0), channel 0.
    pub origin: usize,
    /// Readable padding pixels on every side.
    pub halo: usize,
}
