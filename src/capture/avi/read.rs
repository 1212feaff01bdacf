//! Reading: a file's bytes go in, its pictures come out, as JPEGs or drawn.

use std::io::{Read, Seek, SeekFrom};

use super::chunks::{Entry, Layout, is_avi};
use crate::capture::decode::PixelFormat;
use crate::capture::drawn::{Drawing, next_drawn};
use crate::capture::error::CaptureError;
use crate::capture::frame::Frame;
use crate::capture::jfif::{JFIF_BYTES, jfif_shape};
use crate::capture::jpeg;
use crate::capture::raw::RawPicture;
use crate::capture::source::Source;
use crate::capture::square::PixelShape;

/// Plays a Motion-JPEG AVI file.
pub struct AviReader<R> {
    reader: R,
    name: String,
    entries: Vec<Entry>,
    position: usize,
    /// The file ends before its last chunk does, or goes on for long behind it.
    truncated: bool,
    /// Duration of one frame as a fraction of a second.
    scale: u32,
    rate: u32,
    codec: [u8; 4],
    /// As the stream's header has it.
    shape: Option<PixelShape>,
    /// Every chunk holds two JPEGs, of which each is every other line.
    is_interlaced: bool,
    drawing: Drawing,
}

impl<R: Read + Seek> AviReader<R> {
    /// Reads the headers and finds every picture. Reads go from place to place, and pictures are read whole: a buffer
    /// would be filled anew each time.
    ///
    /// # Errors
    /// [`CaptureError::Data`] when the bytes are no AVI file, hold no video, or no picture;
    /// [`CaptureError::Io`] when reading fails.
    pub fn new(mut reader: R, name: impl Into<String>) -> Result<Self, CaptureError> {
        let name = name.into();
        let io = |e| CaptureError::from_io_named(&name, e);
        let end = reader.seek(SeekFrom::End(0)).map_err(io)?;
        let mut magic = [0; 12];
        reader.seek(SeekFrom::Start(0)).map_err(io)?;
        if end < 12 || reader.read_exact(&mut magic).is_err() || !is_avi(&magic) {
            return Err(CaptureError::data(
                name,
                "expected an AVI file, found other bytes; check that it is the right file",
            ));
        }
        let layout = Layout::of(&mut reader, end).map_err(io)?;
        let Some(codec) = layout.codec else {
            return Err(CaptureError::data(
                name,
                "expected an AVI file with a video stream, found no video header; the file is damaged or holds only sound",
            ));
        };
        if layout.entries.is_empty() {
            return Err(CaptureError::data(
                name,
                "the AVI file holds no pictures; it is empty or was cut off",
            ));
        }
        let (scale, rate) = match layout.timing {
            Some((scale, rate)) if scale > 0 && rate > 0 => (scale, rate),
            _ if layout.microseconds > 0 => (layout.microseconds, 1_000_000),
            _ => (1, 25),
        };
        let first = layout.entries.iter().find(|e| e.length > 0);
        let lines = first.and_then(|first| jpeg_height(&mut reader, *first));
        Ok(Self {
            reader,
            name,
            entries: layout.entries,
            position: 0,
            truncated: layout.truncated,
            scale,
            rate,
            codec,
            shape: layout.shape,
            is_interlaced: lines.is_some_and(|lines| 2 * u32::from(lines) == layout.height),
            drawing: Drawing::default(),
        })
    }

    /// The codec's four letters, upper case.
    pub fn codec(&self) -> [u8; 4] {
        self.codec.map(|c| c.to_ascii_uppercase())
    }

    /// How wide its pixels are: as the stream's header says, else the first picture.
    pub(crate) fn pixel_shape(&mut self) -> Option<PixelShape> {
        self.shape.or_else(|| {
            let first = self.entries.iter().find(|e| e.length > 0)?;
            let mut head = [0; JFIF_BYTES];
            self.reader.seek(SeekFrom::Start(first.offset)).ok()?;
            self.reader.read_exact(&mut head).ok()?;
            jfif_shape(&head)
        })
    }

    /// Whether every picture is one JPEG, which is all that [`Source::next_into`] decodes here.
    pub fn is_motion_jpeg(&self) -> bool {
        !self.is_interlaced && matches!(&self.codec(), b"MJPG" | b"JPEG" | b"AVRN" | b"LJPG")
    }
}

/// Lines of the JPEG in a chunk; `None` for other bytes, and for damage, which is told when the picture is wanted.
fn jpeg_height<R: Read + Seek>(reader: &mut R, chunk: Entry) -> Option<u16> {
    // Lies in the file as a whole.
    let mut bytes = vec![0; chunk.length as usize];
    reader.seek(SeekFrom::Start(chunk.offset)).ok()?;
    reader.read_exact(&mut bytes).ok()?;
    jpeg::height(&bytes)
}

impl<R: Read + Seek + Send> Source for AviReader<R> {
    fn next_into(&mut self, frame: &mut Frame) -> Result<bool, CaptureError> {
        next_drawn(self, |own| &mut own.drawing, frame)
    }

    fn next_raw(&mut self, raw: &mut RawPicture) -> Result<bool, CaptureError> {
        loop {
            let Some(entry) = self.entries.get(self.position).copied() else {
                if std::mem::take(&mut self.truncated) {
                    return Err(CaptureError::data(
                        self.name.clone(),
                        format!(
                            "the file ends inside frame {} or is damaged there; the frames before it were read, copy the file again for the rest",
                            self.position
                        ),
                    ));
                }
                return Ok(false);
            };
            let index = self.position as u64;
            self.position += 1;
            if entry.length == 0 {
                // A frame without bytes repeats the one before: nothing new to see.
                continue;
            }
            raw.bytes.resize(entry.length as usize, 0);
            self.reader
                .seek(SeekFrom::Start(entry.offset))
                .and_then(|_| self.reader.read_exact(&mut raw.bytes))
                .map_err(|e| CaptureError::from_io_named(&self.name, e))?;
            raw.layout.format = PixelFormat::Mjpeg;
            raw.strict = true;
            raw.sequence = index;
            let time =
                u128::from(index) * u128::from(self.scale) * 1_000_000_000 / u128::from(self.rate);
            // A header may say any rate: times that a message does not hold are its last one.
            raw.time_ns = u64::try_from(time).unwrap_or(u64::MAX);
            return Ok(true);
        }
    }

    fn frame_count(&self) -> Option<u64> {
        // Repetitions at the end show nothing new and are not given.
        let last = self.entries.iter().rposition(|e| e.length > 0);
        Some(last.map_or(0, |last| last as u64 + 1))
    }

    fn fps(&self) -> Option<f64> {
        Some(f64::from(self.rate) / f64::from(self.scale))
    }

    fn name(&self) -> &str {
        &self.name
    }
}
