//! Motion-JPEG in an AVI container: bytes go in, frames come out, and the other way round.
//!
//! The container is RIFF: a chunk is a four-letter code, a little-endian u32 length, that many bytes, and one byte of
//! padding after an odd length. A file is `RIFF("AVI " LIST("hdrl" avih LIST("strl" strh strf vprp)) LIST("movi" 00dc…)
//! idx1)`; files over 1 GiB go on with `RIFF("AVIX" LIST("movi" …))` (OpenDML). Every `00dc` chunk is one whole JPEG
//! picture. Any player opens what [`AviWriter`] writes; [`AviReader`] needs no other program.

use std::io::{Read, Seek, SeekFrom, Write};

use image::ExtendedColorType;
use image::codecs::jpeg::JpegEncoder;

use super::camera::PixelFormat;
use super::error::CaptureError;
use super::frame::Frame;
use super::jpeg;
use super::raw::{RawDecoder, RawPicture};
use super::source::Source;
use super::square::PixelShape;

/// Most bytes that one RIFF chunk of ours may hold: players that know no OpenDML stop here.
const MAX_RIFF_BYTES: u64 = 1 << 30;
/// `AVIF_HASINDEX`: the file ends with `idx1`.
const FLAG_HAS_INDEX: u32 = 0x10;
/// `AVIIF_KEYFRAME`: the picture stands alone.
const FLAG_KEY_FRAME: u32 = 0x10;
/// Deepest nesting of LIST chunks that is followed; real files need 3.
const MAX_DEPTH: u32 = 8;

/// Bytes behind the last chunk that are no mere note of some program.
const LONG_REST_BYTES: u64 = 1 << 31;

/// Where one picture lies in the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Entry {
    offset: u64,
    length: u32,
}

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
    raw: RawPicture,
    decoder: RawDecoder,
}

/// What is learnt from a walk over the chunks.
#[derive(Default)]
struct Layout {
    entries: Vec<Entry>,
    truncated: bool,
    /// (scale, rate) of the first video stream.
    timing: Option<(u32, u32)>,
    /// Microseconds per frame from the main header.
    microseconds: u32,
    codec: Option<[u8; 4]>,
    /// Lines of a picture, as the stream's format says.
    height: u32,
    /// Number of streams seen so far.
    streams: u32,
    /// Index of the first video stream.
    video: Option<u32>,
    /// Inside that stream's header list.
    in_video: bool,
    /// The stream header read last is that stream's: what follows its format belongs to it, too.
    is_of_video: bool,
    shape: Option<PixelShape>,
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
        let mut layout = Layout::default();
        walk(&mut reader, 0, end, 0, &mut layout).map_err(io)?;
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
            raw: RawPicture::default(),
            decoder: RawDecoder::default(),
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

/// Whether the first bytes are those of an AVI file.
pub(crate) fn is_avi(head: &[u8]) -> bool {
    head.len() >= 12 && &head[..4] == b"RIFF" && &head[8..12] == b"AVI "
}

/// Lines of the JPEG in a chunk; `None` for other bytes, and for damage, which is told when the picture is wanted.
fn jpeg_height<R: Read + Seek>(reader: &mut R, chunk: Entry) -> Option<u16> {
    // Lies in the file as a whole.
    let mut bytes = vec![0; chunk.length as usize];
    reader.seek(SeekFrom::Start(chunk.offset)).ok()?;
    reader.read_exact(&mut bytes).ok()?;
    jpeg::height(&bytes)
}

/// Bytes of a JPEG up to the end of the densities that its first block may hold.
const JFIF_BYTES: usize = 18;

/// The shape of a JPEG's pixels; `None` where its densities are those of paper.
pub(super) fn jfif_shape(head: &[u8; JFIF_BYTES]) -> Option<PixelShape> {
    // Start of image, APP0, its length, the name, a version, the unit: 0 has densities be the pixel's width and height.
    if head[..4] != [0xFF, 0xD8, 0xFF, 0xE0] || &head[6..11] != b"JFIF\0" || head[13] != 0 {
        return None;
    }
    let word = |at: usize| u64::from(u16::from_be_bytes([head[at], head[at + 1]]));
    PixelShape::new(word(14), word(16))
}

/// The shape of pixels in the header of a stream's video properties (OpenDML): the picture's aspect, x and y in 16 bits
/// each, then its width and height in pixels.
fn vprp_shape(header: &[u8; VPRP_BYTES]) -> Option<PixelShape> {
    let (aspect, width, height) = (u32_at(header, 20), u32_at(header, 24), u32_at(header, 28));
    let (x, y) = (u64::from(aspect >> 16), u64::from(aspect & 0xFFFF));
    PixelShape::new(x * u64::from(height), y * u64::from(width))
}

/// Bytes of video properties that are read.
const VPRP_BYTES: usize = 32;

/// Walks the chunks in `start..end` of the file. Every step goes forward by at least 8 bytes, so it ends on any input.
fn walk<R: Read + Seek>(
    reader: &mut R,
    start: u64,
    end: u64,
    depth: u32,
    layout: &mut Layout,
) -> std::io::Result<()> {
    let mut at = start;
    while at + 8 <= end {
        let mut head = [0; 8];
        reader.seek(SeekFrom::Start(at))?;
        reader.read_exact(&mut head)?;
        let code: [u8; 4] = head[..4].try_into().unwrap_or_default();
        let body = at + 8;
        let length = match (&code, u64::from(u32_at(&head, 4))) {
            // Writers that were killed, or wrote into a pipe, leave the outer lengths 0: such a chunk lasts to the end.
            (b"RIFF" | b"LIST", 0) => end - body,
            (_, length) => length,
        };
        // What follows the RIFF chunks is no part of the film, as notes of some program are none.
        if depth == 0 && !belongs_outside(code) {
            // But so much of it is the rest of a film for which lengths of 32 bits were too short.
            layout.truncated |= end - at >= LONG_REST_BYTES;
            break;
        }
        let stop = (body + length).min(end);
        let whole = body + length <= end;
        match &code {
            b"RIFF" | b"LIST" if depth < MAX_DEPTH && body + 4 <= end => {
                let mut kind = [0; 4];
                reader.read_exact(&mut kind)?;
                layout.truncated |= !whole;
                if matches!(
                    &kind,
                    b"AVI " | b"AVIX" | b"hdrl" | b"strl" | b"movi" | b"rec "
                ) {
                    walk(reader, body + 4, stop, depth + 1, layout)?;
                }
            }
            b"avih" if whole && length >= 4 => {
                let mut bytes = [0; 4];
                reader.read_exact(&mut bytes)?;
                layout.microseconds = u32_at(&bytes, 0);
            }
            b"strh" if whole && length >= 28 => {
                let mut bytes = [0; 28];
                reader.read_exact(&mut bytes)?;
                layout.in_video = &bytes[..4] == b"vids" && layout.video.is_none();
                layout.is_of_video = layout.in_video;
                if layout.in_video {
                    layout.video = Some(layout.streams);
                    layout.timing = Some((u32_at(&bytes, 20), u32_at(&bytes, 24)));
                    layout.codec = bytes[4..8].try_into().ok();
                }
                layout.streams += 1;
            }
            b"strf" if whole && length >= 20 && layout.in_video => {
                let mut bytes = [0; 20];
                reader.read_exact(&mut bytes)?;
                // BITMAPINFOHEADER names what the bytes are; the stream header only suggests a driver.
                if let Some(codec) = bytes[16..20].try_into().ok().filter(|c| c != &[0; 4]) {
                    layout.codec = Some(codec);
                }
                // Below 0 for pictures that are stored from their top.
                layout.height = u32_at(&bytes, 8).cast_signed().unsigned_abs();
                layout.in_video = false;
            }
            b"vprp" if whole && length >= VPRP_BYTES as u64 && layout.is_of_video => {
                let mut bytes = [0; VPRP_BYTES];
                reader.read_exact(&mut bytes)?;
                layout.shape = vprp_shape(&bytes);
            }
            [a, b, b'd', b'c' | b'b'] if is_stream(*a, *b, layout.video) => {
                if whole {
                    layout.entries.push(Entry {
                        offset: body,
                        length: length as u32,
                    });
                } else {
                    layout.truncated = true;
                }
            }
            _ => layout.truncated |= !whole,
        }
        at = body + length + (length & 1);
    }
    Ok(())
}

/// Whether a chunk of a film may lie outside its RIFF chunks: padding between them, and all that follows the headers
/// where the length of the first covers only those.
fn belongs_outside(code: [u8; 4]) -> bool {
    match &code {
        b"RIFF" | b"LIST" | b"JUNK" | b"idx1" => true,
        [tens, ones, b'd' | b'w', b'b' | b'c'] => tens.is_ascii_digit() && ones.is_ascii_digit(),
        _ => false,
    }
}

/// Whether two digits name the stream whose pictures are wanted.
fn is_stream(tens: u8, ones: u8, wanted: Option<u32>) -> bool {
    let (tens, ones) = (
        u32::from(tens.wrapping_sub(b'0')),
        u32::from(ones.wrapping_sub(b'0')),
    );
    tens < 10 && ones < 10 && wanted == Some(10 * tens + ones)
}

/// Little-endian u32 at a fixed place of a header that is long enough.
fn u32_at(bytes: &[u8], at: usize) -> u32 {
    bytes[at..at + 4]
        .iter()
        .rev()
        .fold(0, |n, b| n << 8 | u32::from(*b))
}

impl<R: Read + Seek + Send> Source for AviReader<R> {
    fn next_into(&mut self, frame: &mut Frame) -> Result<bool, CaptureError> {
        let mut raw = std::mem::take(&mut self.raw);
        let mut read = self.next_raw(&mut raw);
        if matches!(read, Ok(true)) {
            let drawn = self.decoder.decode_of(&self.name, &mut raw, frame);
            read = drawn.map(|()| true);
        }
        self.raw = raw;
        read
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

/// Writes a Motion-JPEG AVI file.
///
/// The headers hold the number of frames, so that the file is complete only after [`finish`](Self::finish): write
/// beside, then rename. What was cut off before plays to its last whole picture.
#[derive(Debug)]
pub struct AviWriter<W> {
    writer: W,
    width: u32,
    height: u32,
    /// Frames per second as a fraction.
    rate: (u32, u32),
    entries: Vec<(u32, u32)>,
    /// Bytes after the code `movi`.
    movi_bytes: u64,
    largest: u32,
    jpeg: Vec<u8>,
}

/// Bytes before the first chunk of `movi`: RIFF 12, hdrl 12 + avih 64 + strl 12 + strh 64 + strf 48, movi 12.
const HEADER_BYTES: u32 = 224;
/// Where the lengths of the file and of the pictures lie; 0 while nobody knows them, which readers take for "to the
/// end".
const RIFF_LENGTH: usize = 4;
const MOVI_LENGTH: usize = HEADER_BYTES as usize - 8;

impl<W: Write + Seek> AviWriter<W> {
    /// Starts a file of `width` × `height` pictures at `rate.0 / rate.1` frames a second.
    ///
    /// # Errors
    /// The system's own, from writing. `InvalidInput` for a size or rate of 0 or a side over 65535.
    pub fn new(writer: W, width: u32, height: u32, rate: (u32, u32)) -> std::io::Result<Self> {
        let side = 1..=u32::from(u16::MAX);
        if !side.contains(&width) || !side.contains(&height) || rate.0 == 0 || rate.1 == 0 {
            return Err(std::io::Error::new(
                std::io::ErrorKind::InvalidInput,
                format!(
                    "an AVI file needs sides of 1 to 65535 and a frame rate above 0, not {width}x{height} at {}/{}",
                    rate.0, rate.1
                ),
            ));
        }
        let mut file = Self {
            writer,
            width,
            height,
            rate,
            entries: Vec::new(),
            movi_bytes: 0,
            largest: 0,
            jpeg: Vec::new(),
        };
        let mut header = file.header();
        for length in [RIFF_LENGTH, MOVI_LENGTH] {
            header[length..length + 4].fill(0);
        }
        file.writer.write_all(&header)?;
        Ok(file)
    }

    /// The writer.
    pub fn get_mut(&mut self) -> &mut W {
        &mut self.writer
    }

    /// Appends a picture that is a JPEG already.
    ///
    /// # Errors
    /// The system's own, from writing. `FileTooLarge` over 1 GiB.
    pub fn write_jpeg(&mut self, jpeg: &[u8]) -> std::io::Result<()> {
        let padded = jpeg.len() as u64 + (jpeg.len() as u64 & 1);
        let total = u64::from(HEADER_BYTES)
            + self.movi_bytes
            + 8
            + padded
            + 16 * (self.entries.len() as u64 + 2);
        if total > MAX_RIFF_BYTES {
            return Err(std::io::Error::new(
                std::io::ErrorKind::FileTooLarge,
                format!(
                    "an AVI file of this kind holds at most {MAX_RIFF_BYTES} bytes; write shorter pieces"
                ),
            ));
        }
        // Fits: the sum above is at most 2^30.
        let length = jpeg.len() as u32;
        self.writer.write_all(b"00dc")?;
        self.writer.write_all(&length.to_le_bytes())?;
        self.writer.write_all(jpeg)?;
        if length & 1 == 1 {
            self.writer.write_all(&[0])?;
        }
        // idx1 counts from the code `movi`, which lies 4 bytes before the first chunk.
        self.entries.push((4 + self.movi_bytes as u32, length));
        self.movi_bytes += 8 + padded;
        self.largest = self.largest.max(length);
        Ok(())
    }

    /// Appends the newest picture of [`write_frame`](Self::write_frame) once more.
    ///
    /// # Errors
    /// As [`write_jpeg`](Self::write_jpeg).
    pub fn repeat(&mut self) -> std::io::Result<()> {
        let jpeg = std::mem::take(&mut self.jpeg);
        let written = self.write_jpeg(&jpeg);
        self.jpeg = jpeg;
        written
    }

    /// Appends a picture, encoded with a JPEG quality of 1 to 100.
    ///
    /// # Errors
    /// As [`write_jpeg`](Self::write_jpeg); `InvalidInput` when the picture's size is not the file's.
    pub fn write_frame(&mut self, frame: &Frame, quality: u8) -> std::io::Result<()> {
        let bytes = 3 * frame.width as usize * frame.height as usize;
        if (frame.width, frame.height) != (self.width, self.height) || frame.rgb.len() != bytes {
            return Err(std::io::Error::new(
                std::io::ErrorKind::InvalidInput,
                format!(
                    "this AVI file takes pictures of {}x{}, not {}x{} of {} bytes",
                    self.width,
                    self.height,
                    frame.width,
                    frame.height,
                    frame.rgb.len()
                ),
            ));
        }
        let mut jpeg = std::mem::take(&mut self.jpeg);
        jpeg.clear();
        JpegEncoder::new_with_quality(&mut jpeg, quality.clamp(1, 100))
            .encode(
                &frame.rgb,
                frame.width,
                frame.height,
                ExtendedColorType::Rgb8,
            )
            .map_err(std::io::Error::other)?;
        let written = self.write_jpeg(&jpeg);
        self.jpeg = jpeg;
        written
    }

    /// Writes the index and the headers; returns the writer, flushed.
    ///
    /// # Errors
    /// The system's own, from writing.
    pub fn finish(mut self) -> std::io::Result<W> {
        let index_bytes = 16 * self.entries.len() as u32;
        let mut index = Vec::with_capacity(index_bytes as usize + 8);
        index.extend_from_slice(b"idx1");
        push(&mut index, &[index_bytes]);
        for (offset, length) in &self.entries {
            index.extend_from_slice(b"00dc");
            push(&mut index, &[FLAG_KEY_FRAME, *offset, *length]);
        }
        self.writer.write_all(&index)?;
        let header = self.header();
        self.writer.seek(SeekFrom::Start(0))?;
        self.writer.write_all(&header)?;
        self.writer.seek(SeekFrom::End(0))?;
        self.writer.flush()?;
        Ok(self.writer)
    }

    /// Everything before the first picture.
    fn header(&self) -> Vec<u8> {
        let frames = self.entries.len() as u32;
        let movi = self.movi_bytes as u32;
        let (width, height) = (self.width, self.height);
        let (rate, scale) = self.rate;
        let microseconds =
            (u64::from(scale) * 1_000_000 / u64::from(rate)).min(u64::from(u32::MAX));
        let mut h = Vec::with_capacity(HEADER_BYTES as usize);
        h.extend_from_slice(b"RIFF");
        push(&mut h, &[HEADER_BYTES - 8 + movi + 8 + 16 * frames]);
        h.extend_from_slice(b"AVI LIST");
        push(&mut h, &[HEADER_BYTES - 12 - 12 - 8]);
        h.extend_from_slice(b"hdrlavih");
        // Size, µs per frame, bytes per second, granularity, flags, frames, first frame, streams, buffer, width,
        // height.
        push(
            &mut h,
            &[
                56,
                microseconds as u32,
                0,
                0,
                FLAG_HAS_INDEX,
                frames,
                0,
                1,
                self.largest,
                width,
                height,
                0,
                0,
                0,
                0,
            ],
        );
        h.extend_from_slice(b"LIST");
        push(&mut h, &[4 + 64 + 48]);
        h.extend_from_slice(b"strlstrh");
        push(&mut h, &[56]);
        h.extend_from_slice(b"vidsMJPG");
        // Flags, priority and language, first frame, scale, rate, start, length, buffer, quality (default), sample
        // size.
        push(
            &mut h,
            &[0, 0, 0, scale, rate, 0, frames, self.largest, u32::MAX, 0],
        );
        // Where the picture lies: left, top, right, bottom as i16.
        push(&mut h, &[0, width | height << 16]);
        h.extend_from_slice(b"strf");
        push(&mut h, &[40, 40, width, height, 1 | 24 << 16]);
        h.extend_from_slice(b"MJPG");
        push(
            &mut h,
            &[width.saturating_mul(height).saturating_mul(3), 0, 0, 0, 0],
        );
        h.extend_from_slice(b"LIST");
        push(&mut h, &[4 + movi]);
        h.extend_from_slice(b"movi");
        h
    }
}

/// Appends little-endian words.
fn push(bytes: &mut Vec<u8>, words: &[u32]) {
    for word in words {
        bytes.extend_from_slice(&word.to_le_bytes());
    }
}
