//! One JPEG picture: bytes go in, RGB comes out. For photos, Motion-JPEG files and cameras alike.

use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

use super::exif::Orientation;
use super::frame::Frame;
use super::limits::{MAX_SIDE, check_size};
use super::quiet::quietly;

/// Decodes JPEG pictures and keeps its scratch memory between them.
#[derive(Debug, Default)]
pub struct JpegPicture {
    /// A picture with Huffman tables put in.
    completed: Vec<u8>,
    /// CMYK pixels before conversion.
    inks: Vec<u8>,
    /// Draw what there is of a damaged picture instead of refusing it.
    lenient: bool,
    orientation: Orientation,
}

impl JpegPicture {
    /// A decoder that draws what there is of a damaged picture: for cameras, whose last bytes are often wrong.
    pub fn lenient() -> Self {
        Self {
            lenient: true,
            ..Self::default()
        }
    }

    /// Decodes into `frame`'s size and pixels; its time and sequence stay.
    ///
    /// Baseline and progressive, grey, YCbCr, RGB, CMYK and YCCK. EXIF orientation is not applied here. Pictures of
    /// cameras that leave out the Huffman tables get the standard ones (ITU T.81 annex K.3).
    ///
    /// # Errors
    /// One line that says what was expected, what was found and what to do; the caller names the input.
    pub fn decode(&mut self, bytes: &[u8], frame: &mut Frame) -> Result<(), String> {
        let head = scan(bytes)?;
        self.orientation = head.orientation;
        quietly(|| self.draw(bytes, &head, frame)).unwrap_or_else(contradictory)
    }

    fn draw(&mut self, bytes: &[u8], head: &Head, frame: &mut Frame) -> Result<(), String> {
        let lenient = self.lenient;
        let bytes = complete(bytes, head, lenient, &mut self.completed)?;
        let options = options(lenient).jpeg_set_out_colorspace(ColorSpace::RGB);
        let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options);
        let (width, height) = size_of(&mut decoder)?;
        let pixels = width * height;
        frame.width = width as u32;
        frame.height = height as u32;
        frame.rgb.resize(3 * pixels, 0);
        match decoder.input_colorspace() {
            Some(space @ (ColorSpace::CMYK | ColorSpace::YCCK)) => {
                decoder.set_options(options.jpeg_set_out_colorspace(space));
                self.inks.resize(4 * pixels, 0);
                decoder.decode_into(&mut self.inks).map_err(damaged)?;
                inks_to_rgb(
                    &self.inks,
                    space == ColorSpace::YCCK,
                    head.adobe,
                    &mut frame.rgb,
                );
                Ok(())
            }
            _ => decoder.decode_into(&mut frame.rgb).map_err(damaged),
        }
    }

    /// Decodes only how bright the pixels are, into `width * height` bytes of `luma`, which takes about half the time.
    /// Returns width and height, `None` for pictures in other colours than YCbCr and grey.
    ///
    /// # Errors
    /// As [`decode`](Self::decode); `strict` refuses damaged pictures.
    pub fn luma(
        &mut self,
        bytes: &[u8],
        strict: bool,
        luma: &mut Vec<u8>,
    ) -> Result<Option<(usize, usize)>, String> {
        let head = scan(bytes)?;
        quietly(|| self.draw_luma(bytes, &head, strict, luma)).unwrap_or_else(contradictory)
    }

    fn draw_luma(
        &mut self,
        bytes: &[u8],
        head: &Head,
        strict: bool,
        luma: &mut Vec<u8>,
    ) -> Result<Option<(usize, usize)>, String> {
        let bytes = complete(bytes, head, !strict, &mut self.completed)?;
        let options = options(!strict).jpeg_set_out_colorspace(ColorSpace::Luma);
        let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options);
        let (width, height) = size_of(&mut decoder)?;
        let known = decoder.input_colorspace();
        if !matches!(known, Some(ColorSpace::YCbCr | ColorSpace::Luma)) {
            return Ok(None);
        }
        luma.resize(width * height, 0);
        decoder.decode_into(luma).map_err(damaged)?;
        Ok(Some((width, height)))
    }

    /// What the EXIF block of the last picture says.
    pub fn orientation(&self) -> Orientation {
        self.orientation
    }
}

fn options(lenient: bool) -> DecoderOptions {
    DecoderOptions::default()
        .set_max_width(MAX_SIDE as usize)
        .set_max_height(MAX_SIDE as usize)
        .set_strict_mode(!lenient)
}

/// Reads the headers: width and height.
fn size_of(decoder: &mut JpegDecoder<ZCursor<&[u8]>>) -> Result<(usize, usize), String> {
    decoder.decode_headers().map_err(damaged)?;
    let (width, height) = decoder
        .dimensions()
        .ok_or("expected a JPEG picture, found one without a size; the file is damaged")?;
    check_size(width as u64, height as u64)?;
    Ok((width, height))
}

/// The picture with the tables that cameras leave out, in `completed` where any were missing.
fn complete<'a>(
    bytes: &'a [u8],
    head: &Head,
    lenient: bool,
    completed: &'a mut Vec<u8>,
) -> Result<&'a [u8], String> {
    // The decoder notices a missing end only from one row of blocks to the next.
    if !lenient && !has_end(&bytes[head.scan_at..]) {
        return Err("expected the end marker of the JPEG picture, found none; the file was cut off, copy it again".into());
    }
    if head.has_tables {
        return Ok(bytes);
    }
    completed.clear();
    completed.extend_from_slice(&bytes[..head.scan_at]);
    push_standard_tables(completed);
    completed.extend_from_slice(&bytes[head.scan_at..]);
    Ok(completed)
}

/// The decoder's words in ours.
fn damaged(error: impl std::fmt::Display) -> String {
    format!(
        "the JPEG picture is damaged or cut off ({}); copy the file again or leave it out",
        error.to_string().trim()
    )
}

/// For a picture on which the decoder panics.
fn contradictory<T>() -> Result<T, String> {
    Err(damaged("its parts contradict each other"))
}

/// How many rows a picture has; `None` where its bytes do not say.
pub(crate) fn height(bytes: &[u8]) -> Option<u16> {
    let rows = scan(bytes).ok()?.frame.get(1..3)?;
    Some(u16::from_be_bytes([rows[0], rows[1]]))
}

/// The sampling of a component that has one block, across and down, in each unit of the picture.
const ONE_TO_ONE: u8 = 0x11;
/// The decoder reads 64 bits ahead, and a block has at least two.
const MAX_BLOCKS_AHEAD: u32 = 32;

/// What the markers before the picture's data say.
struct Head<'a> {
    has_tables: bool,
    /// Adobe writes its inks inverted and says so with an APP14 marker.
    adobe: bool,
    orientation: Orientation,
    /// The frame header: bits of a sample, rows and columns (u16 each), how many components, and of each its name, its
    /// sampling across and down (4 bits each), its table.
    frame: &'a [u8],
    /// Not progressive.
    is_sequential: bool,
    has_restarts: bool,
    /// Where the start-of-scan marker lies.
    scan_at: usize,
}

/// Walks the markers up to the start of scan.
fn scan(bytes: &[u8]) -> Result<Head<'_>, String> {
    if bytes.len() < 4 || bytes[..2] != [0xFF, 0xD8] {
        return Err("expected a JPEG picture, found other bytes; check the file".into());
    }
    let mut head = Head {
        has_tables: false,
        adobe: false,
        orientation: Orientation::Upright,
        frame: &[],
        is_sequential: false,
        has_restarts: false,
        scan_at: 0,
    };
    let mut at = 2;
    while at + 4 <= bytes.len() {
        if bytes[at] != 0xFF {
            // Bytes between markers: the decoder skips them too.
            at += 1;
            continue;
        }
        let marker = bytes[at + 1];
        if marker == 0xFF || marker == 0 || (0xD0..=0xD8).contains(&marker) || marker == 1 {
            at += if marker == 0xFF { 1 } else { 2 };
            continue;
        }
        if marker == 0xDA {
            head.scan_at = at;
            if head.is_sequential {
                check_first_scan(&head, bytes.get(at + 4).copied().unwrap_or(0))?;
            }
            return Ok(head);
        }
        let length = usize::from(u16::from_be_bytes([bytes[at + 2], bytes[at + 3]]));
        let body = bytes.get(at + 4..at + 2 + length).unwrap_or_default();
        head.has_tables |= marker == 0xC4;
        head.has_restarts |= marker == 0xDD;
        head.adobe |= marker == 0xEE && body.starts_with(b"Adobe");
        // Of the other kinds the decoder reads none.
        if matches!(marker, 0xC0..=0xC2) {
            head.frame = body;
            head.is_sequential = marker != 0xC2;
        }
        if let (0xE1, Some(exif)) = (marker, body.strip_prefix(b"Exif\0\0")) {
            head.orientation = Orientation::from_exif(exif);
        }
        at += 2 + length.max(2);
    }
    Err(
        "expected a JPEG picture, found only its first part; the file was cut off, copy it again"
            .into(),
    )
}

/// Refuses pictures whose components lie one after the other, but for those that the decoder draws right. With finer
/// rows of one component, or columns of another than the first, it panics or draws them wrong. It counts restarts on
/// from one scan to the next, and drops rows of blocks that it has read ahead when it meets the next scan. `found`:
/// components in the first scan.
fn check_first_scan(head: &Head, found: u8) -> Result<(), String> {
    let columns = head.frame.get(3..5);
    let columns = columns.map_or(0, |c| u32::from(u16::from_be_bytes([c[0], c[1]])));
    let components = head.frame.get(6..).unwrap_or_default().chunks_exact(3);
    let wanted = components.len();
    let mut samplings = components.map(|component| component[1]);
    let first = samplings.next().unwrap_or(ONE_TO_ONE);
    let is_plain = samplings.all(|sampling| sampling == ONE_TO_ONE) && first & 15 == 1;
    let is_single = found == 1 || first == ONE_TO_ONE;
    let is_wide = columns > 8 * MAX_BLOCKS_AHEAD * u32::from(first >> 4);
    if usize::from(found) >= wanted || (is_plain && is_single && is_wide && !head.has_restarts) {
        return Ok(());
    }
    Err(format!(
        "expected all {wanted} components of the JPEG picture in one scan, found {found} in the first; save the picture anew, not component by component"
    ))
}

/// Whether an end-of-image marker follows the picture's data. (Inside the data 0xFF is always followed by 0.)
fn has_end(scan: &[u8]) -> bool {
    scan.windows(2).rev().any(|pair| pair == [0xFF, 0xD9])
}

/// Four inks → RGB. Plain files hold ink (0 = white paper), Adobe's hold light (255 = white paper).
fn inks_to_rgb(inks: &[u8], ycck: bool, adobe: bool, rgb: &mut [u8]) {
    for (out, p) in rgb.chunks_exact_mut(3).zip(inks.chunks_exact(4)) {
        let mut cmy = [p[0], p[1], p[2]];
        if ycck {
            cmy = ycc_to_rgb(p[0], p[1], p[2]);
            // T.871's YCCK is the YCC of (255 − C, 255 − M, 255 − Y), so that RGB of it is the opposite of what is
            // stored.
            cmy = cmy.map(|v| 255 - v);
        }
        let light = |v: u8| u32::from(if adobe { v } else { 255 - v });
        let k = light(p[3]);
        for (o, c) in out.iter_mut().zip(cmy) {
            *o = ((light(c) * k + 127) / 255) as u8;
        }
    }
}

/// Full-range BT.601, as in JFIF.
fn ycc_to_rgb(y: u8, cb: u8, cr: u8) -> [u8; 3] {
    let (y, cb, cr) = (f32::from(y), f32::from(cb) - 128.0, f32::from(cr) - 128.0);
    [
        y + 1.402 * cr,
        y - 0.344_136 * cb - 0.714_136 * cr,
        y + 1.772 * cb,
    ]
    .map(|v| v.round() as u8)
}

/// ITU T.81 annex K.3: numbers of codes of each length, then the values, for (luma DC, luma AC, chroma DC, chroma AC).
const STANDARD_TABLES: [(u8, [u8; 16], &[u8]); 4] = [
    (
        0x00,
        [0, 1, 5, 1, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0, 0, 0],
        &[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11],
    ),
    (
        0x10,
        [0, 2, 1, 3, 3, 2, 4, 3, 5, 5, 4, 4, 0, 0, 1, 0x7D],
        &LUMA_AC,
    ),
    (
        0x01,
        [0, 3, 1, 1, 1, 1, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0],
        &[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11],
    ),
    (
        0x11,
        [0, 2, 1, 2, 4, 4, 3, 4, 7, 5, 4, 4, 0, 1, 2, 0x77],
        &CHROMA_AC,
    ),
];

#[rustfmt::skip]
const LUMA_AC: [u8; 162] = [
    0x01, 0x02, 0x03, 0x00, 0x04, 0x11, 0x05, 0x12, 0x21, 0x31, 0x41, 0x06, 0x13, 0x51, 0x61, 0x07, 0x22, 0x71,
    0x14, 0x32, 0x81, 0x91, 0xA1, 0x08, 0x23, 0x42, 0xB1, 0xC1, 0x15, 0x52, 0xD1, 0xF0, 0x24, 0x33, 0x62, 0x72,
    0x82, 0x09, 0x0A, 0x16, 0x17, 0x18, 0x19, 0x1A, 0x25, 0x26, 0x27, 0x28, 0x29, 0x2A, 0x34, 0x35, 0x36, 0x37,
    0x38, 0x39, 0x3A, 0x43, 0x44, 0x45, 0x46, 0x47, 0x48, 0x49, 0x4A, 0x53, 0x54, 0x55, 0x56, 0x57, 0x58, 0x59,
    0x5A, 0x63, 0x64, 0x65, 0x66, 0x67, 0x68, 0x69, 0x6A, 0x73, 0x74, 0x75, 0x76, 0x77, 0x78, 0x79, 0x7A, 0x83,
    0x84, 0x85, 0x86, 0x87, 0x88, 0x89, 0x8A, 0x92, 0x93, 0x94, 0x95, 0x96, 0x97, 0x98, 0x99, 0x9A, 0xA2, 0xA3,
    0xA4, 0xA5, 0xA6, 0xA7, 0xA8, 0xA9, 0xAA, 0xB2, 0xB3, 0xB4, 0xB5, 0xB6, 0xB7, 0xB8, 0xB9, 0xBA, 0xC2, 0xC3,
    0xC4, 0xC5, 0xC6, 0xC7, 0xC8, 0xC9, 0xCA, 0xD2, 0xD3, 0xD4, 0xD5, 0xD6, 0xD7, 0xD8, 0xD9, 0xDA, 0xE1, 0xE2,
    0xE3, 0xE4, 0xE5, 0xE6, 0xE7, 0xE8, 0xE9, 0xEA, 0xF1, 0xF2, 0xF3, 0xF4, 0xF5, 0xF6, 0xF7, 0xF8, 0xF9, 0xFA,
];

#[rustfmt::skip]
const CHROMA_AC: [u8; 162] = [
    0x00, 0x01, 0x02, 0x03, 0x11, 0x04, 0x05, 0x21, 0x31, 0x06, 0x12, 0x41, 0x51, 0x07, 0x61, 0x71, 0x13, 0x22,
    0x32, 0x81, 0x08, 0x14, 0x42, 0x91, 0xA1, 0xB1, 0xC1, 0x09, 0x23, 0x33, 0x52, 0xF0, 0x15, 0x62, 0x72, 0xD1,
    0x0A, 0x16, 0x24, 0x34, 0xE1, 0x25, 0xF1, 0x17, 0x18, 0x19, 0x1A, 0x26, 0x27, 0x28, 0x29, 0x2A, 0x35, 0x36,
    0x37, 0x38, 0x39, 0x3A, 0x43, 0x44, 0x45, 0x46, 0x47, 0x48, 0x49, 0x4A, 0x53, 0x54, 0x55, 0x56, 0x57, 0x58,
    0x59, 0x5A, 0x63, 0x64, 0x65, 0x66, 0x67, 0x68, 0x69, 0x6A, 0x73, 0x74, 0x75, 0x76, 0x77, 0x78, 0x79, 0x7A,
    0x82, 0x83, 0x84, 0x85, 0x86, 0x87, 0x88, 0x89, 0x8A, 0x92, 0x93, 0x94, 0x95, 0x96, 0x97, 0x98, 0x99, 0x9A,
    0xA2, 0xA3, 0xA4, 0xA5, 0xA6, 0xA7, 0xA8, 0xA9, 0xAA, 0xB2, 0xB3, 0xB4, 0xB5, 0xB6, 0xB7, 0xB8, 0xB9, 0xBA,
    0xC2, 0xC3, 0xC4, 0xC5, 0xC6, 0xC7, 0xC8, 0xC9, 0xCA, 0xD2, 0xD3, 0xD4, 0xD5, 0xD6, 0xD7, 0xD8, 0xD9, 0xDA,
    0xE2, 0xE3, 0xE4, 0xE5, 0xE6, 0xE7, 0xE8, 0xE9, 0xEA, 0xF2, 0xF3, 0xF4, 0xF5, 0xF6, 0xF7, 0xF8, 0xF9, 0xFA,
];

/// Appends one DHT segment with the four standard tables.
fn push_standard_tables(bytes: &mut Vec<u8>) {
    let length: usize = 2 + STANDARD_TABLES
        .iter()
        .map(|t| 17 + t.2.len())
        .sum::<usize>();
    bytes.extend_from_slice(&[0xFF, 0xC4]);
    bytes.extend_from_slice(&(length as u16).to_be_bytes());
    for (class, counts, values) in STANDARD_TABLES {
        bytes.push(class);
        bytes.extend_from_slice(&counts);
        bytes.extend_from_slice(values);
    }
}
