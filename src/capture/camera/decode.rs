//! One camera buffer: bytes as the camera sends them go in, RGB comes out.

use crate::capture::frame::Frame;
use crate::capture::jpeg::JpegPicture;
use crate::capture::limits::check_size;
use crate::capture::yuv::{Matrix, Range, YuvToRgb};

/// What cameras send and we understand.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum PixelFormat {
    /// `YUYV`: 4:2:2, two bytes a pixel.
    Yuyv,
    /// `NV12`: 4:2:0, a plane of luma and one of interleaved chroma.
    Nv12,
    /// `RGB3`: three bytes a pixel.
    Rgb24,
    /// `MJPG` and `JPEG`: every picture a JPEG.
    Mjpeg,
}

impl PixelFormat {
    /// From V4L2's four letters.
    pub fn from_fourcc(code: [u8; 4]) -> Option<Self> {
        match &code {
            b"YUYV" => Some(Self::Yuyv),
            b"NV12" => Some(Self::Nv12),
            b"RGB3" => Some(Self::Rgb24),
            b"MJPG" | b"JPEG" => Some(Self::Mjpeg),
            _ => None,
        }
    }

    /// Work to turn a picture into RGB, in order: what to prefer when sizes and rates are equal.
    pub(crate) fn cost(self) -> u32 {
        match self {
            Self::Rgb24 => 0,
            Self::Yuyv => 1,
            Self::Nv12 => 2,
            Self::Mjpeg => 3,
        }
    }
}

/// How a camera's buffers are laid out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RawLayout {
    /// What the bytes are.
    pub format: PixelFormat,
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// Bytes from one row to the next; without meaning for MJPEG.
    pub stride: u32,
    /// Which samples are black and white.
    pub range: Range,
}

/// Turns buffers of one layout into frames.
#[derive(Debug)]
pub struct PictureDecoder {
    layout: RawLayout,
    colours: YuvToRgb,
    jpeg: JpegPicture,
}

impl PictureDecoder {
    /// For a layout. Drivers that leave the stride at 0 mean rows without padding.
    ///
    /// # Errors
    /// What is wrong with the layout: a size beyond the limits, a stride shorter than a row.
    pub fn new(mut layout: RawLayout) -> Result<Self, String> {
        check_size(layout.width.into(), layout.height.into())?;
        let row = match layout.format {
            PixelFormat::Yuyv => 4 * layout.width.div_ceil(2),
            PixelFormat::Nv12 => 2 * layout.width.div_ceil(2),
            PixelFormat::Rgb24 => 3 * layout.width,
            PixelFormat::Mjpeg => 0,
        };
        if layout.stride == 0 {
            layout.stride = row;
        }
        if layout.stride < row {
            return Err(format!(
                "expected rows of at least {row} bytes from the camera, its driver says {}; try another size",
                layout.stride
            ));
        }
        Ok(Self {
            layout,
            // UVC and V4L2 default to BT.601 for all sizes.
            colours: YuvToRgb::new(Matrix::Bt601, layout.range),
            jpeg: JpegPicture::lenient(),
        })
    }

    /// The layout, stride filled in.
    pub fn layout(&self) -> RawLayout {
        self.layout
    }

    /// Fewest bytes of a whole picture.
    pub fn needed_bytes(&self) -> usize {
        let (stride, height) = (self.layout.stride as usize, self.layout.height as usize);
        let last_row = 3 * self.layout.width as usize;
        match self.layout.format {
            PixelFormat::Yuyv => {
                stride * (height - 1) + 4 * (self.layout.width as usize).div_ceil(2)
            }
            PixelFormat::Nv12 => stride * (height + height.div_ceil(2)),
            PixelFormat::Rgb24 => stride * (height - 1) + last_row,
            // A JPEG says itself where it ends.
            PixelFormat::Mjpeg => 4,
        }
    }

    /// Fills `frame`'s size and pixels; its time and sequence stay.
    ///
    /// # Errors
    /// One line when the buffer holds no whole picture.
    pub fn decode(&mut self, bytes: &[u8], frame: &mut Frame) -> Result<(), String> {
        let needed = self.needed_bytes();
        if bytes.len() < needed {
            return Err(format!(
                "expected {needed} bytes of a picture, found {}; the picture is left out",
                bytes.len()
            ));
        }
        if self.layout.format == PixelFormat::Mjpeg {
            return self.jpeg.decode(bytes, frame);
        }
        let (width, height) = (self.layout.width as usize, self.layout.height as usize);
        let stride = self.layout.stride as usize;
        frame.width = self.layout.width;
        frame.height = self.layout.height;
        frame.rgb.resize(3 * width * height, 0);
        match self.layout.format {
            PixelFormat::Yuyv => self.colours.yuyv(bytes, stride, width, &mut frame.rgb),
            PixelFormat::Nv12 => {
                let (luma, chroma) = bytes.split_at(stride * height);
                self.colours
                    .nv12(luma, chroma, stride, width, &mut frame.rgb);
            }
            PixelFormat::Rgb24 => {
                let rows = bytes.chunks(stride);
                for (out, row) in frame.rgb.chunks_exact_mut(3 * width).zip(rows) {
                    out.copy_from_slice(&row[..3 * width]);
                }
            }
            PixelFormat::Mjpeg => {}
        }
        Ok(())
    }
}
