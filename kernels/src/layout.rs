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

impl Layout {
    /// A tensor of its own: `pixel_stride == channels`, rows packed, `halo` padding pixels on every side.
    pub fn dense(height: usize, width: usize, channels: usize, halo: usize) -> Self {
        let row_stride = (width + 2 * halo) * channels;
        Self {
            height,
            width,
            channels,
            pixel_stride: channels,
            row_stride,
            origin: halo * row_stride + halo * channels,
            halo,
        }
    }

    /// Elements of the smallest buffer that holds every pixel of this layout, halo included.
    pub fn buffer_len(&self) -> usize {
        if self.height == 0 || self.width == 0 {
            return 0;
        }
        self.origin
            + (self.height - 1 + self.halo) * self.row_stride
            + (self.width - 1 + self.halo) * self.pixel_stride
            + self.channels
    }

    /// Channels `first..first + channels` of this tensor, in place.
    ///
    /// # Panics
    /// When the slice does not lie within the channels of this layout.
    pub fn channel_slice(&self, first: usize, channels: usize) -> Self {
        assert!(
            first + channels <= self.channels,
            "channel slice {first}..{} of a tensor of {} channels",
            first + channels,
            self.channels
        );
        Self {
            channels,
            origin: self.origin + first,
            ..*self
        }
    }

    /// Index of channel 0 of the pixel in row `y`, column `x`; both may reach `halo` beyond the tensor.
    pub fn index(&self, y: isize, x: isize) -> usize {
        (self.origin as isize + y * self.row_stride as isize + x * self.pixel_stride as isize)
            as usize
    }

    /// Whether rows, pixels and halo lie apart from each other and begin inside the buffer.
    pub(crate) fn is_consistent(&self) -> bool {
        self.pixel_stride >= self.channels
            && self.row_stride >= (self.width + 2 * self.halo) * self.pixel_stride
            && self.origin >= self.halo * (self.row_stride + self.pixel_stride)
    }
}
