//! Photos: one JPEG or PNG file goes in, one upright RGB picture comes out.

use std::fs::File;
use std::io::{Cursor, Read};
use std::path::{Path, PathBuf};

use image::codecs::png::PngDecoder;
use image::{ColorType, ImageDecoder, Limits};

use super::album::{Album, other_kind};
use super::error::{CaptureError, name_of};
use super::exif::Orientation;
use super::frame::Frame;
use super::jpeg::JpegPicture;
use super::limits::{MAX_SIDE, check_size};
use super::signature::{PNG_START, is_jpeg, is_png};
use super::source::Source;

/// Largest photo file that is read, bytes.
const MAX_FILE_BYTES: u64 = 1 << 30;
/// Most memory that a PNG may take while it is unpacked: 8000 × 8000 pixels of 16-bit RGBA and the decoder's own.
const MAX_PNG_BYTES: u64 = 1 << 30;
/// Time between photos of a folder when nothing else is known: most folders of numbered pictures are 30 Hz films.
const DEFAULT_FPS: f64 = 30.0;
/// Colour behind transparent pixels: the one that also pads the network's input.
const BACKDROP: u32 = 128;

/// Reads photos one after the other.
pub struct PhotoSource {
    name: String,
    folder: Option<PathBuf>,
    files: Vec<PathBuf>,
    /// What was said of others in the folder.
    told: Option<String>,
    position: usize,
    fps: Option<f64>,
    bytes: Vec<u8>,
    decoder: PhotoDecoder,
}

impl PhotoSource {
    /// One photo.
    pub fn file(path: &Path, fps: Option<f64>) -> Self {
        Self {
            name: name_of(path),
            folder: None,
            files: vec![path.to_owned()],
            told: None,
            position: 0,
            fps,
            bytes: Vec::new(),
            decoder: PhotoDecoder::default(),
        }
    }

    /// Every JPEG and PNG file of a folder, as an album has them. Hidden files are left out; what else looks like a
    /// photo is, too, with a warning. `fps`: the rate at which the photos were taken, for time stamps;
    /// 30 without.
    ///
    /// # Errors
    /// [`CaptureError::NoInput`] when the folder is missing or holds no photo; [`CaptureError::Permission`],
    /// [`CaptureError::Io`] when it cannot be read.
    pub fn folder(path: &Path, fps: Option<f64>) -> Result<Self, CaptureError> {
        let mut source = Self {
            folder: Some(path.to_owned()),
            files: Vec::new(),
            ..Self::file(path, fps)
        };
        source.list(path)?;
        Ok(source)
    }

    /// Begins with the first photo that a folder has now.
    fn list(&mut self, folder: &Path) -> Result<(), CaptureError> {
        let album = Album::of(folder).map_err(|e| CaptureError::from_io(folder, e))?;
        let left_out = album.left_out();
        if album.photos.is_empty() {
            let others = left_out.map_or(String::new(), |others| format!(" but {others}"));
            return Err(CaptureError::NoInput {
                input: self.name.clone(),
                reason: format!(
                    "expected photos (.jpg, .jpeg, .png) in this folder, found none{others}"
                ),
            });
        }
        if left_out != self.told
            && let Some(others) = &left_out
        {
            tracing::warn!("{}: left out: {others}", self.name);
        }
        (self.files, self.told, self.position) = (album.photos, left_out, 0);
        Ok(())
    }

    /// The files in the order in which they are read.
    pub fn files(&self) -> &[PathBuf] {
        &self.files
    }

    /// How the newest photo was turned to be upright.
    pub fn orientation(&self) -> Orientation {
        self.decoder.orientation()
    }
}

impl Source for PhotoSource {
    fn next_into(&mut self, frame: &mut Frame) -> Result<bool, CaptureError> {
        let Some(path) = self.files.get(self.position) else {
            return Ok(false);
        };
        let index = self.position;
        self.position += 1;
        let one_of_many = self.files.len() > 1;
        read_file(path, &mut self.bytes)
            .and_then(|()| {
                self.decoder
                    .decode(&self.bytes, frame)
                    .map_err(|reason| CaptureError::data(name_of(path), reason))
            })
            .map_err(|e| if one_of_many { e.into_picture() } else { e })?;
        frame.sequence = index as u64;
        frame.time_ns = (index as f64 * 1e9 / self.fps.unwrap_or(DEFAULT_FPS)).round() as u64;
        Ok(true)
    }

    /// Photos of a folder may have come and gone.
    fn rewind(&mut self) -> Result<bool, CaptureError> {
        self.position = 0;
        if let Some(folder) = self.folder.clone() {
            self.list(&folder)?;
        }
        Ok(true)
    }

    fn frame_count(&self) -> Option<u64> {
        Some(self.files.len() as u64)
    }

    fn fps(&self) -> Option<f64> {
        self.fps
    }

    fn is_stills(&self) -> bool {
        self.fps.is_none()
    }

    fn name(&self) -> &str {
        &self.name
    }

    fn picture(&self) -> String {
        let newest = self.position.checked_sub(1).and_then(|k| self.files.get(k));
        newest.map_or_else(|| self.name.clone(), |path| name_of(path))
    }
}

/// Reads a whole file of a sane size.
fn read_file(path: &Path, bytes: &mut Vec<u8>) -> Result<(), CaptureError> {
    let io = |e| CaptureError::from_io(path, e);
    let file = File::open(path).map_err(io)?;
    bytes.clear();
    file.take(MAX_FILE_BYTES + 1)
        .read_to_end(bytes)
        .map_err(io)?;
    if bytes.len() as u64 > MAX_FILE_BYTES {
        return Err(CaptureError::data(
            name_of(path),
            format!(
                "the file has more than {MAX_FILE_BYTES} bytes, which no photo needs; check that it is the right file"
            ),
        ));
    }
    Ok(())
}

/// Decodes photos from memory.
#[derive(Debug, Default)]
pub struct PhotoDecoder {
    jpeg: JpegPicture,
    pixels: Vec<u8>,
    orientation: Orientation,
}

impl PhotoDecoder {
    /// Decodes a JPEG or PNG, told apart by its first bytes, and turns it upright; `frame`'s time and sequence stay.
    /// 16-bit channels are rounded to 8, transparent pixels are laid over mid grey.
    ///
    /// # Errors
    /// One line that says what was expected, what was found and what to do; the caller names the file.
    pub fn decode(&mut self, bytes: &[u8], frame: &mut Frame) -> Result<(), String> {
        let orientation = if is_jpeg(bytes) {
            self.jpeg.decode(bytes, frame)?;
            self.jpeg.orientation()
        } else if is_png(bytes) {
            self.decode_png(bytes, frame)?
        } else if bytes.is_empty() {
            return Err(
                "expected a JPEG or PNG picture, found an empty file; copy it again".into(),
            );
        } else {
            let found =
                other_kind(bytes).map_or("other bytes".into(), |kind| format!("{kind} picture"));
            return Err(format!(
                "expected a JPEG or PNG picture, found {found}; convert it to one of these"
            ));
        };
        orientation.apply(frame);
        self.orientation = orientation;
        Ok(())
    }

    /// How the photo that was decoded last was turned.
    pub fn orientation(&self) -> Orientation {
        self.orientation
    }

    fn decode_png(&mut self, bytes: &[u8], frame: &mut Frame) -> Result<Orientation, String> {
        let mut limits = Limits::no_limits();
        limits.max_image_width = Some(MAX_SIDE);
        limits.max_image_height = Some(MAX_SIDE);
        limits.max_alloc = Some(MAX_PNG_BYTES);
        let mut decoder =
            PngDecoder::with_limits(Cursor::new(bytes), limits).map_err(damaged_png)?;
        let (width, height) = decoder.dimensions();
        check_size(width.into(), height.into())?;
        // The decoder has read up to the pixels, and is gone after them.
        let ahead = decoder.exif_metadata().ok().flatten();
        let exif = ahead.as_deref().or_else(|| exif_behind_pixels(bytes));
        let orientation = exif.map_or(Orientation::Upright, Orientation::from_exif);
        let color = decoder.color_type();
        // At most 100 million pixels of 8 bytes.
        self.pixels.resize(decoder.total_bytes() as usize, 0);
        decoder.read_image(&mut self.pixels).map_err(damaged_png)?;
        frame.width = width;
        frame.height = height;
        frame.rgb.resize(3 * width as usize * height as usize, 0);
        to_rgb(&self.pixels, color, &mut frame.rgb)?;
        if self.pixels.len() > 1 << 26 {
            // One huge photo among small ones need not hold its memory for ever.
            self.pixels = Vec::new();
        }
        Ok(orientation)
    }
}

/// The EXIF block of a PNG that stands behind its pixels, where some programs append it.
fn exif_behind_pixels(png: &[u8]) -> Option<&[u8]> {
    let behind = chunks(png).skip_while(|(kind, _)| kind != b"IDAT");
    let mut own = behind.take_while(|(kind, _)| kind != b"IEND");
    own.find_map(|(kind, body)| (kind == *b"eXIf").then_some(body))
}

/// The chunks of a PNG, kind and contents, up to one that is cut off. Checksums are not looked at.
fn chunks(png: &[u8]) -> impl Iterator<Item = ([u8; 4], &[u8])> {
    let mut rest = png.strip_prefix(PNG_START).unwrap_or_default();
    std::iter::from_fn(move || {
        let (length, tail) = rest.split_first_chunk()?;
        let (kind, tail) = tail.split_first_chunk()?;
        let (body, tail) = tail.split_at_checked(u32::from_be_bytes(*length) as usize)?;
        rest = tail.get(size_of::<u32>()..)?;
        Some((*kind, body))
    })
}

fn damaged_png(error: image::ImageError) -> String {
    match error {
        image::ImageError::Limits(_) => format!(
            "the PNG picture is larger than {MAX_SIDE} pixels a side or {} MB unpacked; make it smaller",
            MAX_PNG_BYTES >> 20
        ),
        error => format!(
            "the PNG picture is damaged or cut off ({error}); copy the file again or leave it out"
        ),
    }
}

/// Any PNG pixels → RGB.
fn to_rgb(pixels: &[u8], color: ColorType, rgb: &mut [u8]) -> Result<(), String> {
    // `image` hands out 16-bit samples in the machine's own byte order.
    let wide = |p: &[u8], k: usize| {
        let v = u32::from(u16::from_ne_bytes([p[2 * k], p[2 * k + 1]]));
        (v * 255 + 32_767) / 65_535
    };
    let byte = |p: &[u8], k: usize| u32::from(p[k]);
    let over = |v: u32, alpha: u32| ((v * alpha + BACKDROP * (255 - alpha) + 127) / 255) as u8;
    let outs = rgb.chunks_exact_mut(3);
    match color {
        ColorType::Rgb8 => rgb.copy_from_slice(pixels),
        ColorType::L8 => outs.zip(pixels).for_each(|(o, p)| o.fill(*p)),
        ColorType::La8 => {
            for (o, p) in outs.zip(pixels.chunks_exact(2)) {
                o.fill(over(byte(p, 0), byte(p, 1)));
            }
        }
        ColorType::Rgba8 => {
            for (o, p) in outs.zip(pixels.chunks_exact(4)) {
                for (k, o) in o.iter_mut().enumerate() {
                    *o = over(byte(p, k), byte(p, 3));
                }
            }
        }
        ColorType::L16 => {
            for (o, p) in outs.zip(pixels.chunks_exact(2)) {
                o.fill(wide(p, 0) as u8);
            }
        }
        ColorType::La16 => {
            for (o, p) in outs.zip(pixels.chunks_exact(4)) {
                o.fill(over(wide(p, 0), wide(p, 1)));
            }
        }
        ColorType::Rgb16 => {
            for (o, p) in outs.zip(pixels.chunks_exact(6)) {
                for (k, o) in o.iter_mut().enumerate() {
                    *o = wide(p, k) as u8;
                }
            }
        }
        ColorType::Rgba16 => {
            for (o, p) in outs.zip(pixels.chunks_exact(8)) {
                for (k, o) in o.iter_mut().enumerate() {
                    *o = over(wide(p, k), wide(p, 3));
                }
            }
        }
        other => {
            return Err(format!(
                "expected grey, RGB or RGBA pixels, found {other:?}; convert the picture to RGB"
            ));
        }
    }
    Ok(())
}
