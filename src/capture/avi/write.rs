//! Writing: pictures go in, a file's bytes come out.

use std::io::{Seek, SeekFrom, Write};

use image::ExtendedColorType;
use image::codecs::jpeg::JpegEncoder;

use crate::capture::frame::Frame;

/// Most bytes that one RIFF chunk of ours may hold: players that know no OpenDML stop here.
const MAX_RIFF_BYTES: u64 = 1 << 30;
/// `AVIF_HASINDEX`: the file ends with `idx1`.
const FLAG_HAS_INDEX: u32 = 0x10;
/// `AVIIF_KEYFRAME`: the picture stands alone.
const FLAG_KEY_FRAME: u32 = 0x10;

/// Bytes before the first chunk of `movi`: RIFF 12, hdrl 12 + avih 64 + strl 12 + strh 64 + strf 48, movi 12.
const HEADER_BYTES: u32 = 224;
/// Where the lengths of the file and of the pictures lie; 0 while nobody knows them, which readers take for "to the
/// end".
const RIFF_LENGTH: usize = 4;
const MOVI_LENGTH: usize = HEADER_BYTES as usize - 8;

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
