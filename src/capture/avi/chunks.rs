//! The chunks of a file: its bytes go in, and out comes what its headers say and where each picture lies.

use std::io::{self, Read, Seek, SeekFrom};

use crate::capture::square::PixelShape;

/// Deepest nesting of LIST chunks that is followed; real files need 3.
const MAX_DEPTH: u32 = 8;

/// Bytes behind the last chunk that are no mere note of some program.
const LONG_REST_BYTES: u64 = 1 << 31;

/// Where one picture lies in the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Entry {
    pub offset: u64,
    pub length: u32,
}

/// What is learnt from a walk over the chunks.
#[derive(Default)]
pub(super) struct Layout {
    pub entries: Vec<Entry>,
    pub truncated: bool,
    /// (scale, rate) of the first video stream.
    pub timing: Option<(u32, u32)>,
    /// Microseconds per frame from the main header.
    pub microseconds: u32,
    pub codec: Option<[u8; 4]>,
    /// Lines of a picture, as the stream's format says.
    pub height: u32,
    /// Number of streams seen so far.
    streams: u32,
    /// Index of the first video stream.
    video: Option<u32>,
    /// Inside that stream's header list.
    in_video: bool,
    /// The stream header read last is that stream's: what follows its format belongs to it, too.
    is_of_video: bool,
    pub shape: Option<PixelShape>,
}

impl Layout {
    /// That of a file of `end` bytes.
    ///
    /// # Errors
    /// Those of reading.
    pub fn of<R: Read + Seek>(reader: &mut R, end: u64) -> io::Result<Self> {
        let mut layout = Self::default();
        walk(reader, 0, end, 0, &mut layout)?;
        Ok(layout)
    }
}

/// Whether the first bytes are those of an AVI file.
pub(in crate::capture) fn is_avi(head: &[u8]) -> bool {
    head.len() >= 12 && &head[..4] == b"RIFF" && &head[8..12] == b"AVI "
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
) -> io::Result<()> {
    let mut at = start;
    while at + 8 <= end {
        let mut head = [0; 8];
        reader.seek(SeekFrom::Start(at))?;
        reader.read_exact(&mut head)?;
        if depth > 0 && head == [0; 8] {
            at = behind_zeros(reader, at + 8, end)?;
            continue;
        }
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
                // Camcorders have one stream for picture and sound, whose format says nothing of codecs.
                layout.is_of_video =
                    matches!(&bytes[..4], b"vids" | b"iavs") && layout.video.is_none();
                layout.in_video = layout.is_of_video && &bytes[..4] == b"vids";
                if layout.is_of_video {
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
            [a, b, b'd', b'c' | b'b'] | [a, b, b'_', b'_'] if is_stream(*a, *b, layout.video) => {
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

/// Bytes that are read at once where zeros lie.
const BLOCK_BYTES: usize = 1 << 16;

/// Where zeros end that begin in front of `from`, in whole steps of a chunk's head, `end` at most: where a recorder
/// lost power, gigabytes of them may follow its last picture.
fn behind_zeros<R: Read + Seek>(reader: &mut R, from: u64, end: u64) -> io::Result<u64> {
    let mut block = [0; BLOCK_BYTES];
    let mut at = from;
    while at < end {
        let wanted = (end - at).min(BLOCK_BYTES as u64) as usize;
        let block = &mut block[..wanted];
        reader.read_exact(block)?;
        if let Some(zeros) = block.iter().position(|b| *b != 0) {
            return Ok(at + (zeros as u64 & !7));
        }
        at += wanted as u64;
    }
    Ok(end)
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
