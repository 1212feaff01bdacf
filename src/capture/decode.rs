//! One camera buffer: bytes as the camera sends them go in, RGB comes out.

use crate::capture::frame::Frame;
use crate::capture::jpeg::JpegPicture;
use crate::capture::limits::check_size;
use crate::capture::yuv::{Matrix, Range, YuvToRgb};

/// A JPEG picture's size differs by less from what was agreed: some cameras send whole blocks, 1088 rows for 1080.
const JPEG_BLOCK: u32 = 16;

/// What cameras send and we understand.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum PixelFormat {
    /// `YUYV`: 4:2:2, two bytes a pixel.
    Yuyv,
    /// `UYVY`: the same, chroma first.
    Uyvy,
    /// `NV12`: 4:2:0, a plane of luma and one of interleaved chroma.
    Nv12,
    /// `YU12`: 4:2:0, a plane of luma and two of chroma with rows half as long.
    Yu12,
    /// `GREY`: luma alone, of infrared cameras.
    Grey,
    /// `RGB3`: three bytes a pixel.
    Rgb24,
    /// `BGR3`: the same, blue first.
    Bgr24,
    /// `MJPG` and `JPEG`: every picture a JPEG.
    Mjpeg,
}

impl PixelFormat {
    /// From V4L2's four letters.
    pub fn from_fourcc(code: [u8; 4]) -> Option<Self> {
        match &code {
            b"YUYV" => Some(Self::Yuyv),
            b"UYVY" => Some(Self::Uyvy),
            b"NV12" => Some(Self::Nv12),
            b"YU12" => Some(Self::Yu12),
            b"GREY" => Some(Self::Grey),
            b"RGB3" => Some(Self::Rgb24),
            b"BGR3" => Some(Self::Bgr24),
            b"MJPG" | b"JPEG" => Some(Self::Mjpeg),
            _ => None,
        }
    }

    /// The byte that says how bright the first pixel is (green where there is no luma), and how many bytes later the
    /// next pixel's is.
    pub(crate) fn brightness_at(self) -> (usize, usize) {
        match self {
            Self::Yuyv => (0, 2),
            Self::Uyvy => (1, 2),
            Self::Nv12 | Self::Yu12 | Self::Grey | Self::Mjpeg => (0, 1),
            Self::Rgb24 | Self::Bgr24 => (1, 3),
        }
    }

    /// Whether pictures are smaller than their pixels.
    pub(crate) fn is_compressed(self) -> bool {
        self == Self::Mjpeg
    }

    /// Work to turn a picture into RGB, in order: what to prefer when sizes and rates are equal.
    pub(crate) fn cost(self) -> u32 {
        match self {
            Self::Rgb24 => 0,
            Self::Bgr24 => 1,
            Self::Yuyv => 2,
            Self::Uyvy => 3,
            Self::Nv12 => 4,
            Self::Yu12 => 5,
            Self::Mjpeg => 6,
            // Without colours people are told apart less well.
            Self::Grey => 7,
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
    /// How luma and chroma make up colours.
    pub matrix: Matrix,
    /// Which samples are black and white.
    pub range: Range,
}

/// Turns buffers of one layout into frames.
#[derive(Debug)]
pub struct PictureDecoder {
    layout: RawLayout,
    colours: YuvToRgb,
    jpeg: JpegPicture,
    /// Whether a JPEG has come whose size was the agreed one.
    keeps_to_size: bool,
}

impl PictureDecoder {
    /// For a layout. Drivers that leave the stride at 0 mean rows without padding.
    ///
    /// # Errors
    /// What is wrong with the layout: a size beyond the limits, a stride shorter than a row.
    pub fn new(mut layout: RawLayout) -> Result<Self, String> {
        check_size(layout.width.into(), layout.height.into())?;
        let row = match layout.format {
            PixelFormat::Yuyv | PixelFormat::Uyvy => 4 * layout.width.div_ceil(2),
            PixelFormat::Nv12 | PixelFormat::Yu12 => 2 * layout.width.div_ceil(2),
            PixelFormat::Grey => layout.width,
            PixelFormat::Rgb24 | PixelFormat::Bgr24 => 3 * layout.width,
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
            colours: YuvToRgb::new(layout.matrix, layout.range),
            jpeg: JpegPicture::lenient(),
            keeps_to_size: false,
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
            PixelFormat::Yuyv | PixelFormat::Uyvy => {
                stride * (height - 1) + 4 * (self.layout.width as usize).div_ceil(2)
            }
            PixelFormat::Nv12 => stride * (height + height.div_ceil(2)),
            PixelFormat::Yu12 => stride * height + 2 * (stride / 2) * height.div_ceil(2),
            PixelFormat::Grey => stride * (height - 1) + self.layout.width as usize,
            PixelFormat::Rgb24 | PixelFormat::Bgr24 => stride * (height - 1) + last_row,
            // A JPEG says itself where it ends.
            PixelFormat::Mjpeg => 4,
        }
    }

    /// Fills `frame`'s size and pixels; its time and sequence stay.
    ///
    /// # Errors
    /// One line when the buffer holds no whole picture, or a JPEG of another size than the layout's.
    pub fn decode(&mut self, bytes: &[u8], frame: &mut Frame) -> Result<(), String> {
        let needed = self.needed_bytes();
        if bytes.len() < needed {
            return Err(format!(
                "expected {needed} bytes of a picture, found {}; the picture is left out",
                bytes.len()
            ));
        }
        if self.layout.format == PixelFormat::Mjpeg {
            self.jpeg.decode(bytes, frame)?;
            if self.is_agreed(frame.width, frame.height)? {
                cut(frame, self.layout.width, self.layout.height);
            }
            return Ok(());
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
            PixelFormat::Uyvy => self.colours.uyvy(bytes, stride, width, &mut frame.rgb),
            PixelFormat::Yu12 => {
                let (luma, chroma) = bytes.split_at(stride * height);
                let (u, v) = chroma.split_at(stride / 2 * height.div_ceil(2));
                let strides = [stride, stride / 2];
                let planes = [luma, u, v];
                self.colours
                    .planar(planes, strides, (1, 1), width, &mut frame.rgb);
            }
            PixelFormat::Grey => {
                let rows = bytes.chunks(stride);
                for (out, row) in frame.rgb.chunks_exact_mut(3 * width).zip(rows) {
                    self.colours.grey(&row[..width], out);
                }
            }
            PixelFormat::Rgb24 | PixelFormat::Bgr24 => {
                let rows = bytes.chunks(stride);
                for (out, row) in frame.rgb.chunks_exact_mut(3 * width).zip(rows) {
                    out.copy_from_slice(&row[..3 * width]);
                    if self.layout.format == PixelFormat::Bgr24 {
                        out.chunks_exact_mut(3).for_each(|p| p.swap(0, 2));
                    }
                }
            }
            PixelFormat::Mjpeg => {}
        }
        Ok(())
    }

    /// Whether a JPEG has the agreed size, or that in whole blocks. Refuses another, of a damaged header, where the
    /// camera has kept to the one agreed; of one that never has, all are taken.
    fn is_agreed(&mut self, width: u32, height: u32) -> Result<bool, String> {
        let agreed = self.layout;
        let is_near = |found: u32, agreed: u32| found.abs_diff(agreed) < JPEG_BLOCK;
        let is_agreed = is_near(width, agreed.width) && is_near(height, agreed.height);
        self.keeps_to_size |= is_agreed;
        if is_agreed || !self.keeps_to_size {
            return Ok(is_agreed);
        }
        Err(format!(
            "expected a picture of {}x{}, found one of {width}x{height} (--capture-size asks for another); it is left out",
            agreed.width, agreed.height
        ))
    }
}

/// Cuts off what is right of `width` and below `height`: blocks are filled up there with what the camera does not see,
/// and a lens is calibrated for the agreed size.
fn cut(frame: &mut Frame, width: u32, height: u32) {
    let (row, kept) = (3 * frame.width as usize, 3 * width as usize);
    if kept < row {
        for k in 1..frame.height as usize {
            frame.rgb.copy_within(k * row..k * row + kept, k * kept);
        }
        frame.width = width;
    }
    frame.height = frame.height.min(height);
    let bytes = 3 * frame.width as usize * frame.height as usize;
    frame.rgb.truncate(bytes);
}
