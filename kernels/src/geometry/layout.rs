//! Where an NHWC tensor lies in a buffer.

use super::MAX_ELEMENTS;
use crate::KernelError;

/// Placement of an NHWC tensor, or of a channel slice of one, in a flat buffer. Units are elements.
///
/// Pixel (row y, column x), channel c is at `origin + y * row_stride + x * pixel_stride + c`. `halo` pixels on every
/// side are part of the buffer too and hold the padding value, so that convolutions need no border cases.
///
/// Layouts are made by [`dense`](Self::dense) and [`channel_slice`](Self::channel_slice) only, hence for every layout
/// - it has at least one pixel and one channel,
/// - `channels <= pixel_stride` and `(width + 2 * halo) * pixel_stride <= row_stride`,
/// - the index of every channel of every pixel, halo included, is below [`buffer_len`](Self::buffer_len), which is at
///   most `isize::MAX / 8`.
///
/// ```
/// use edgecap_kernels::Layout;
///
/// // 40 channels, of which a layer writes the last 16.
/// let whole = Layout::dense(20, 32, 40, 1)?;
/// let slice = whole.channel_slice(24, 16);
/// assert_eq!(slice.index(0, 0), whole.index(0, 0) + 24);
/// assert_eq!(slice.buffer_len(), whole.buffer_len());
/// // A size that no buffer can have is refused.
/// assert!(Layout::dense(1 << 40, 1 << 40, 40, 1).is_err());
/// # Ok::<(), edgecap_kernels::KernelError>(())
/// ```
///
/// Nobody else can put numbers into one:
///
/// ```compile_fail,E0451
/// # use edgecap_kernels::Layout;
/// let good = Layout::dense(3, 1, 1, 0).unwrap();
/// let wild = Layout { row_stride: 1 << 63, ..good };
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Layout {
    height: usize,
    width: usize,
    channels: usize,
    pixel_stride: usize,
    row_stride: usize,
    origin: usize,
    halo: usize,
}

impl Layout {
    /// A tensor of its own: `pixel_stride == channels`, rows packed, `halo` padding pixels on every side.
    ///
    /// # Errors
    /// When there is no pixel or no channel, or more elements than a buffer can hold.
    pub fn dense(
        height: usize,
        width: usize,
        channels: usize,
        halo: usize,
    ) -> Result<Self, KernelError> {
        let checked = || {
            let around = halo.checked_mul(2)?;
            let row_stride = width.checked_add(around)?.checked_mul(channels)?;
            let whole = height.checked_add(around)?.checked_mul(row_stride)?;
            let fits = height.min(width).min(channels) > 0 && whole <= MAX_ELEMENTS;
            fits.then_some(Self {
                height,
                width,
                channels,
                pixel_stride: channels,
                row_stride,
                // At most `whole`, as halo <= height + 2 * halo.
                origin: halo * row_stride + halo * channels,
                halo,
            })
        };
        checked().ok_or_else(|| {
            KernelError::Shape(format!(
                "expected a tensor of 1 to {MAX_ELEMENTS} elements, found {height}x{width}x{channels} with a halo of {halo}; choose another input size"
            ))
        })
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Columns.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Channels of this slice.
    pub fn channels(&self) -> usize {
        self.channels
    }

    /// Elements from one pixel to the next in a row; at least `channels`.
    pub fn pixel_stride(&self) -> usize {
        self.pixel_stride
    }

    /// Elements from one row to the next; at least `(width + 2 * halo) * pixel_stride`.
    pub fn row_stride(&self) -> usize {
        self.row_stride
    }

    /// Index of pixel (0, 0), channel 0.
    pub fn origin(&self) -> usize {
        self.origin
    }

    /// Readable padding pixels on every side.
    pub fn halo(&self) -> usize {
        self.halo
    }

    /// Elements of the smallest buffer that holds every pixel of this slice, halo included.
    pub fn buffer_len(&self) -> usize {
        self.origin
            + (self.height - 1 + self.halo) * self.row_stride
            + (self.width - 1 + self.halo) * self.pixel_stride
            + self.channels
    }

    /// Channels `first..first + channels` of this tensor, in place.
    ///
    /// # Panics
    /// When the slice is empty or does not lie within the channels of this layout.
    pub fn channel_slice(&self, first: usize, channels: usize) -> Self {
        let end = first.checked_add(channels);
        assert!(
            channels > 0 && end.is_some_and(|end| end <= self.channels),
            "expected a slice of 0..{} channels, found {channels} from {first}",
            self.channels
        );
        Self {
            channels,
            origin: self.origin + first,
            ..*self
        }
    }

    /// Index of channel 0 of the pixel in row `y`, column `x`; both may reach `halo` beyond the tensor. Beyond that the
    /// result means nothing.
    pub fn index(&self, y: isize, x: isize) -> usize {
        let (row, pixel) = (self.row_stride as isize, self.pixel_stride as isize);
        let from_origin = y.wrapping_mul(row).wrapping_add(x.wrapping_mul(pixel));
        (self.origin as isize).wrapping_add(from_origin) as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_index_lies_in_the_buffer() {
        for (height, width, channels, halo) in [(1, 1, 1, 0), (3, 5, 7, 2), (1, 4, 3, 3)] {
            let layout = Layout::dense(height, width, channels, halo).unwrap();
            let halo = halo as isize;
            assert_eq!(layout.index(-halo, -halo), 0);
            let last = layout.index(height as isize - 1 + halo, width as isize - 1 + halo);
            assert_eq!(last + channels, layout.buffer_len());
        }
    }

    #[test]
    fn what_no_buffer_can_hold_is_refused() {
        let huge = usize::MAX;
        for (height, width, channels, halo) in [
            (0, 1, 1, 0),
            (1, 0, 1, 0),
            (1, 1, 0, 0),
            (huge, 1, 1, 0),
            (1, huge, 1, 0),
            (1, 1, huge, 0),
            (1, 1, 1, huge),
            (1, 1, 1, 1 << (usize::BITS - 1)),
            (1 << 20, 1 << 20, 1 << 21, 1),
        ] {
            assert!(
                Layout::dense(height, width, channels, halo).is_err(),
                "{height} {width} {channels} {halo}"
            );
        }
    }

    #[test]
    #[should_panic(expected = "expected a slice of 0..8 channels")]
    fn a_slice_that_wraps_is_refused() {
        let _ = Layout::dense(1, 1, 8, 0)
            .unwrap()
            .channel_slice(usize::MAX, 2);
    }
}
