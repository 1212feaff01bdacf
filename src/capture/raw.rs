//! A picture as its source sends it, and turning it into colours or brightness when somebody wants to see it.

use super::brightness::Brightness;
use super::decode::{PictureDecoder, PixelFormat, RawLayout};
use super::error::CaptureError;
use super::frame::Frame;
use super::jpeg::JpegPicture;
use super::yuv::{Matrix, Range};

/// A picture that nobody has looked at yet: a camera's or film's own bytes, and when it was taken.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RawPicture {
    /// What the bytes are. A film's JPEG says itself how large it is, a camera's of another size is damaged.
    pub layout: RawLayout,
    /// As the source sent them.
    pub bytes: Vec<u8>,
    /// Capture time, nanoseconds: as [`Frame::time_ns`].
    pub time_ns: u64,
    /// As [`Frame::sequence`].
    pub sequence: u64,
    /// Whether a damaged JPEG is refused, as a film's is; a camera's is drawn as far as it goes.
    pub strict: bool,
}

impl Default for RawPicture {
    fn default() -> Self {
        Self {
            layout: rgb(0, 0),
            bytes: Vec::new(),
            time_ns: 0,
            sequence: 0,
            strict: false,
        }
    }
}

impl RawPicture {
    /// Takes over a picture that its source has decoded; `frame` gets the old bytes to fill again.
    pub fn take_over(&mut self, frame: &mut Frame) {
        self.layout = rgb(frame.width, frame.height);
        (self.time_ns, self.sequence) = (frame.time_ns, frame.sequence);
        std::mem::swap(&mut self.bytes, &mut frame.rgb);
    }

    /// Whether the bytes are colours already.
    fn is_decoded(&self) -> bool {
        let RawLayout {
            format,
            width,
            height,
            stride,
            ..
        } = self.layout;
        format == PixelFormat::Rgb24
            && stride == 3 * width
            && self.bytes.len() == stride as usize * height as usize
    }
}

/// Colours without padding.
fn rgb(width: u32, height: u32) -> RawLayout {
    RawLayout {
        format: PixelFormat::Rgb24,
        width,
        height,
        stride: 3 * width,
        matrix: Matrix::default(),
        range: Range::Full,
    }
}

/// Decodes raw pictures; what it allocates it keeps.
#[derive(Debug, Default)]
pub struct RawDecoder {
    /// For the layout seen last.
    lenient: Option<PictureDecoder>,
    strict: JpegPicture,
    luma: Vec<u8>,
    colours: Frame,
}

impl RawDecoder {
    /// Fills `frame`; `raw` keeps its time, its count, and perhaps `frame`'s old bytes in place of its own.
    ///
    /// # Errors
    /// One line when the bytes hold no whole picture.
    pub fn decode(&mut self, raw: &mut RawPicture, frame: &mut Frame) -> Result<(), String> {
        (frame.time_ns, frame.sequence) = (raw.time_ns, raw.sequence);
        if raw.is_decoded() {
            (frame.width, frame.height) = (raw.layout.width, raw.layout.height);
            std::mem::swap(&mut raw.bytes, &mut frame.rgb);
            return Ok(());
        }
        self.draw(raw, frame)
    }

    /// As [`decode`](Self::decode), of a picture of `input`, whose error names it and the frame.
    ///
    /// # Errors
    /// [`CaptureError::Picture`].
    pub fn decode_of(
        &mut self,
        input: &str,
        raw: &mut RawPicture,
        frame: &mut Frame,
    ) -> Result<(), CaptureError> {
        self.decode(raw, frame)
            .map_err(|reason| CaptureError::Picture {
                input: format!("{input}, frame {}", raw.sequence),
                reason,
            })
    }

    /// Fills `brightness`. A JPEG's colours are not worked out for that.
    ///
    /// # Errors
    /// As [`decode`](Self::decode).
    pub fn brightness(
        &mut self,
        raw: &RawPicture,
        brightness: &mut Brightness,
    ) -> Result<(), String> {
        let RawLayout {
            format,
            width,
            height,
            stride,
            ..
        } = raw.layout;
        if format == PixelFormat::Mjpeg {
            let jpeg = &mut self.strict;
            if let Some((width, height)) = jpeg.luma(&raw.bytes, raw.strict, &mut self.luma)? {
                brightness.measure(&self.luma, [width, height], width, 1);
                return Ok(());
            }
            let mut colours = std::mem::take(&mut self.colours);
            let drawn = self.draw(raw, &mut colours);
            if drawn.is_ok() {
                let size = [colours.width as usize, colours.height as usize];
                brightness.measure(&colours.rgb[1..], size, 3 * size[0], 3);
            }
            self.colours = colours;
            return drawn;
        }
        let needed = self.decoder(raw.layout)?.needed_bytes();
        if raw.bytes.len() < needed {
            return Err(format!(
                "expected {needed} bytes of a picture, found {}; the picture is left out",
                raw.bytes.len()
            ));
        }
        // Green stands for brightness where there is no luma.
        let (first, step) = format.brightness_at();
        brightness.measure(
            &raw.bytes[first..],
            [width as usize, height as usize],
            stride as usize,
            step,
        );
        Ok(())
    }

    fn draw(&mut self, raw: &RawPicture, frame: &mut Frame) -> Result<(), String> {
        if raw.strict && raw.layout.format == PixelFormat::Mjpeg {
            return self.strict.decode(&raw.bytes, frame);
        }
        self.decoder(raw.layout)?.decode(&raw.bytes, frame)
    }

    fn decoder(&mut self, layout: RawLayout) -> Result<&mut PictureDecoder, String> {
        let known = self.lenient.take().filter(|d| d.layout() == layout);
        let decoder = match known {
            Some(decoder) => decoder,
            None => PictureDecoder::new(layout)?,
        };
        Ok(self.lenient.insert(decoder))
    }
}
