//! YUV4MPEG2: uncompressed film from a file or a pipe goes in, frames come out.
//!
//! One header line `YUV4MPEG2 W640 H480 F30:1 C420jpeg …`, then for every frame a line `FRAME…` and its planes.

use std::io::{ErrorKind, Read};

use super::error::CaptureError;
use super::frame::Frame;
use super::limits::check_size;
use super::source::Source;
use super::square::PixelShape;
use super::yuv::{Matrix, Range, YuvToRgb};

/// First bytes of every file.
pub(crate) const MAGIC: &[u8] = b"YUV4MPEG2";
/// Longest header or frame line that is read.
const MAX_LINE: usize = 1024;
/// Height from which untagged film is taken for BT.709, as players do.
const HIGH_DEFINITION_LINES: u32 = 720;

/// Where a picture's colours lie.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Planes {
    Grey,
    /// Chroma is `1 << .0` times narrower and `1 << .1` times lower.
    Colour(u32, u32),
}

/// Plays YUV4MPEG2.
pub struct Y4mReader<R> {
    reader: R,
    name: String,
    width: u32,
    height: u32,
    /// Frames per second as a fraction.
    rate: (u32, u32),
    shape: Option<PixelShape>,
    planes: Planes,
    colours: YuvToRgb,
    bytes: Vec<u8>,
    header_bytes: u64,
    frames: Option<u64>,
    index: u64,
    ended: bool,
}

impl<R: Read> Y4mReader<R> {
    /// Reads the header. Reads are small at first: give a buffered reader. `total_bytes`: length of the whole file if
    /// it has one, for [`Source::frame_count`].
    ///
    /// # Errors
    /// [`CaptureError::Data`] for other bytes, sizes beyond the limits and sample formats other than 8-bit 4:2:0,
    /// 4:2:2, 4:4:4 and grey; [`CaptureError::NoInput`] when nothing comes at all; [`CaptureError::Io`] when reading
    /// fails.
    pub fn new(
        mut reader: R,
        name: impl Into<String>,
        total_bytes: Option<u64>,
    ) -> Result<Self, CaptureError> {
        let name = name.into();
        let mut line = Vec::new();
        match read_line(&mut reader, &mut line)
            .map_err(|e| CaptureError::from_io_named(&name, e))?
        {
            Line::Whole => {}
            Line::End if line.is_empty() => {
                return Err(CaptureError::NoInput {
                    input: name,
                    reason: "expected a YUV4MPEG2 film, found nothing; is the program before the pipe running?".into(),
                });
            }
            Line::End | Line::TooLong => return Err(no_film(name)),
        }
        let header_bytes = line.len() as u64 + 1;
        let mut words = line.split(|b| *b == b' ');
        if words.next() != Some(MAGIC) {
            return Err(no_film(name));
        }
        let (mut width, mut height) = (0, 0);
        let mut rate = (25, 1);
        let mut shape = None;
        let mut planes = Planes::Colour(1, 1);
        let mut range = Range::Limited;
        for word in words.filter(|w| !w.is_empty()) {
            let text = String::from_utf8_lossy(&word[1..]);
            match word[0] {
                b'W' => width = text.parse().unwrap_or(0),
                b'H' => height = text.parse().unwrap_or(0),
                b'F' => {
                    if let Some((n, d)) = text.split_once(':')
                        && let (Ok(n @ 1..), Ok(d @ 1..)) = (n.parse(), d.parse())
                    {
                        rate = (n, d);
                    }
                }
                b'A' => {
                    if let Some((across, down)) = text.split_once(':')
                        && let (Ok(across), Ok(down)) = (across.parse::<u32>(), down.parse::<u32>())
                    {
                        shape = PixelShape::new(across.into(), down.into());
                    }
                }
                b'C' => {
                    planes = match &*text {
                        "mono" => Planes::Grey,
                        "420" | "420jpeg" | "420mpeg2" | "420paldv" => Planes::Colour(1, 1),
                        "422" => Planes::Colour(1, 0),
                        "444" => Planes::Colour(0, 0),
                        other => {
                            return Err(CaptureError::data(
                                name,
                                format!(
                                    "expected 8-bit 4:2:0, 4:2:2, 4:4:4 or grey film, found C{}; convert it with ffmpeg -pix_fmt yuv420p",
                                    printable(other)
                                ),
                            ));
                        }
                    }
                }
                b'X' if text == "COLORRANGE=FULL" => range = Range::Full,
                _ => {}
            }
        }
        check_size(width.into(), height.into())
            .map_err(|reason| CaptureError::data(name.clone(), reason))?;
        let matrix = if height >= HIGH_DEFINITION_LINES {
            Matrix::Bt709
        } else {
            Matrix::Bt601
        };
        let frame_bytes = frame_bytes(width as usize, height as usize, planes);
        let frames = total_bytes.map(|n| {
            n.saturating_sub(header_bytes)
                .div_ceil(frame_bytes as u64 + 6)
        });
        Ok(Self {
            reader,
            name,
            width,
            height,
            rate,
            shape,
            planes,
            colours: YuvToRgb::new(matrix, range),
            bytes: vec![0; frame_bytes],
            header_bytes,
            frames,
            index: 0,
            ended: false,
        })
    }

    /// How wide its pixels are, where the header says so.
    pub(crate) fn pixel_shape(&self) -> Option<PixelShape> {
        self.shape
    }

    /// Length of the header line.
    pub fn header_bytes(&self) -> u64 {
        self.header_bytes
    }

    /// The next frame's planes; `false` at the end.
    fn read_frame(&mut self) -> Result<bool, CaptureError> {
        let io = |e| CaptureError::from_io_named(&self.name, e);
        let mut line = Vec::new();
        let state = read_line(&mut self.reader, &mut line).map_err(io)?;
        let cut = || {
            CaptureError::data(
                self.name.clone(),
                format!(
                    "the film ends inside frame {}; the frames before it were read, write it again for the rest",
                    self.index
                ),
            )
        };
        match state {
            Line::End if line.is_empty() => return Ok(false),
            Line::End => return Err(cut()),
            _ if !line.starts_with(b"FRAME") => {
                return Err(CaptureError::data(
                    self.name.clone(),
                    format!(
                        "expected the word FRAME before frame {}, found other bytes; the film is damaged, write it again",
                        self.index
                    ),
                ));
            }
            _ => {}
        }
        match self.reader.read_exact(&mut self.bytes) {
            Ok(()) => Ok(true),
            Err(e) if e.kind() == ErrorKind::UnexpectedEof => Err(cut()),
            Err(e) => Err(io(e)),
        }
    }
}

fn no_film(name: String) -> CaptureError {
    CaptureError::data(
        name,
        "expected a YUV4MPEG2 film (y4m), found other bytes; make one with ffmpeg -f yuv4mpegpipe -pix_fmt yuv420p",
    )
}

/// Text of others, fit for a terminal.
fn printable(text: &str) -> String {
    text.chars()
        .take(16)
        .map(|c| if c.is_ascii_graphic() { c } else { '?' })
        .collect()
}

fn frame_bytes(width: usize, height: usize, planes: Planes) -> usize {
    match planes {
        Planes::Grey => width * height,
        Planes::Colour(x, y) => {
            width * height + 2 * width.div_ceil(1 << x) * height.div_ceil(1 << y)
        }
    }
}

enum Line {
    Whole,
    End,
    TooLong,
}

/// Reads up to a line feed, which is not stored.
fn read_line<R: Read>(reader: &mut R, line: &mut Vec<u8>) -> std::io::Result<Line> {
    let mut byte = [0];
    while line.len() < MAX_LINE {
        match reader.read(&mut byte) {
            Ok(0) => return Ok(Line::End),
            Ok(_) if byte[0] == b'\n' => return Ok(Line::Whole),
            Ok(_) => line.push(byte[0]),
            Err(e) if e.kind() == ErrorKind::Interrupted => {}
            Err(e) => return Err(e),
        }
    }
    Ok(Line::TooLong)
}

impl<R: Read + Send> Source for Y4mReader<R> {
    fn next_into(&mut self, frame: &mut Frame) -> Result<bool, CaptureError> {
        if self.ended {
            return Ok(false);
        }
        match self.read_frame() {
            Ok(true) => {}
            other => {
                self.ended = true;
                return other;
            }
        }
        let (width, height) = (self.width as usize, self.height as usize);
        frame.width = self.width;
        frame.height = self.height;
        frame.rgb.resize(3 * width * height, 0);
        let (luma, rest) = self.bytes.split_at(width * height);
        match self.planes {
            Planes::Grey => self.colours.grey(luma, &mut frame.rgb),
            Planes::Colour(x, y) => {
                let (u, v) = rest.split_at(rest.len() / 2);
                let strides = [width, width.div_ceil(1 << x)];
                self.colours
                    .planar([luma, u, v], strides, (x, y), width, &mut frame.rgb);
            }
        }
        frame.sequence = self.index;
        let time = u128::from(self.index) * u128::from(self.rate.1) * 1_000_000_000
            / u128::from(self.rate.0);
        // A header may say any rate: times that a message does not hold are its last one.
        frame.time_ns = u64::try_from(time).unwrap_or(u64::MAX);
        self.index += 1;
        Ok(true)
    }

    fn frame_count(&self) -> Option<u64> {
        self.frames
    }

    fn fps(&self) -> Option<f64> {
        Some(f64::from(self.rate.0) / f64::from(self.rate.1))
    }

    fn name(&self) -> &str {
        &self.name
    }
}
