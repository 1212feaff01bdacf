//! Raw Motion-JPEG, as cameras write it: JPEG pictures back to back go in, frames come out. Nothing in such a file says
//! when they were taken.

use std::io::{BufRead, Read};

use super::decode::PixelFormat;
use super::drawn::{Drawing, next_drawn};
use super::error::CaptureError;
use super::frame::Frame;
use super::raw::RawPicture;
use super::source::Source;

/// Most bytes that are looked through for the end of a picture: damage must not ask for all the memory there is.
const MAX_PICTURE_BYTES: u64 = 1 << 28;
/// Pictures a second where nobody says how many.
const DEFAULT_FPS: f64 = 30.0;
/// What every picture begins with.
const START: [u8; 2] = [0xFF, 0xD8];

/// Plays raw Motion-JPEG.
pub struct MjpegReader<R> {
    reader: R,
    name: String,
    fps: f64,
    index: u64,
    /// The start of the next picture has been read already.
    has_begun: bool,
    ended: bool,
    drawing: Drawing,
}

/// What was found where a picture is wanted.
enum Found {
    Picture,
    /// Of which the end is missing, and another one has begun.
    Unfinished,
    /// The end of the file inside a picture.
    Cut,
    Nothing,
}

impl<R: BufRead> MjpegReader<R> {
    /// Plays what `reader` gives, at `fps` pictures a second, 30 without.
    pub fn new(reader: R, name: impl Into<String>, fps: Option<f64>) -> Self {
        Self {
            reader,
            name: name.into(),
            fps: fps.unwrap_or(DEFAULT_FPS),
            index: 0,
            has_begun: false,
            ended: false,
            drawing: Drawing::default(),
        }
    }

    /// The bytes of the next picture.
    fn read(&mut self, jpeg: &mut Vec<u8>) -> std::io::Result<Found> {
        let mut reader = self.reader.by_ref().take(MAX_PICTURE_BYTES);
        // Some writers pad what lies between pictures.
        while !self.has_begun {
            jpeg.clear();
            match marker(&mut reader, jpeg)? {
                Some(marker) => self.has_begun = marker == START[1],
                None => return Ok(Found::Nothing),
            }
        }
        self.has_begun = false;
        jpeg.clear();
        jpeg.extend_from_slice(&START);
        loop {
            match marker(&mut reader, jpeg)? {
                None => return Ok(Found::Cut),
                Some(0xD9) => return Ok(Found::Picture),
                Some(0xD8) => {
                    jpeg.truncate(jpeg.len() - START.len());
                    self.has_begun = true;
                    return Ok(Found::Unfinished);
                }
                // Inside the picture's data.
                Some(0..=1 | 0xD0..=0xD7) => {}
                // Blocks are stepped over: the small picture in one has a start and an end, too.
                Some(_) => {
                    let at = jpeg.len();
                    reader.by_ref().take(2).read_to_end(jpeg)?;
                    let Some(&[high, low]) = jpeg.get(at..) else {
                        return Ok(Found::Cut);
                    };
                    let rest = u64::from(u16::from_be_bytes([high, low])).saturating_sub(2);
                    reader.by_ref().take(rest).read_to_end(jpeg)?;
                }
            }
        }
    }
}

/// Appends everything up to the next marker, and returns what follows its 0xFF; `None` at the end.
fn marker(reader: &mut impl BufRead, bytes: &mut Vec<u8>) -> std::io::Result<Option<u8>> {
    reader.read_until(0xFF, bytes)?;
    loop {
        let at = bytes.len();
        reader.by_ref().take(1).read_to_end(bytes)?;
        match bytes.get(at) {
            // Any number of them may come before a marker.
            Some(0xFF) => bytes.truncate(at),
            other => return Ok(other.copied()),
        }
    }
}

impl<R: BufRead + Send> Source for MjpegReader<R> {
    fn next_into(&mut self, frame: &mut Frame) -> Result<bool, CaptureError> {
        next_drawn(self, |own| &mut own.drawing, frame)
    }

    fn next_raw(&mut self, raw: &mut RawPicture) -> Result<bool, CaptureError> {
        if self.ended {
            return Ok(false);
        }
        let found = self.read(&mut raw.bytes);
        self.ended = matches!(found, Err(_) | Ok(Found::Cut | Found::Nothing));
        match found.map_err(|e| CaptureError::from_io_named(&self.name, e))? {
            Found::Nothing => return Ok(false),
            Found::Cut => {
                return Err(CaptureError::data(
                    self.name.clone(),
                    format!(
                        "the file ends inside frame {}; the frames before it were read, copy the file again for the rest",
                        self.index
                    ),
                ));
            }
            // Whoever decodes the latter says what is wrong with it.
            Found::Picture | Found::Unfinished => {}
        }
        raw.layout.format = PixelFormat::Mjpeg;
        raw.strict = true;
        raw.sequence = self.index;
        raw.time_ns = (self.index as f64 * 1e9 / self.fps).round() as u64;
        self.index += 1;
        Ok(true)
    }

    fn fps(&self) -> Option<f64> {
        Some(self.fps)
    }

    fn name(&self) -> &str {
        &self.name
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PADDED: &[u8] =
        b"\xFF\xD8\xFF\xFF\xE1\0\x06\xFF\xD9\xFF\xD8\xFF\xDA\0\x02ab\xFF\0c\xFF\xD0d\xFF\xD9";

    fn pictures(bytes: &[u8]) -> (Vec<Vec<u8>>, bool) {
        let mut reader = MjpegReader::new(bytes, "film.mjpeg", Some(10.0));
        let (mut raw, mut pictures) = (RawPicture::default(), Vec::new());
        loop {
            match reader.next_raw(&mut raw) {
                Ok(true) => {
                    let index = pictures.len() as u64;
                    assert_eq!((raw.sequence, raw.time_ns), (index, index * 100_000_000));
                    pictures.push(raw.bytes.clone());
                }
                Ok(false) => return (pictures, true),
                Err(error) => {
                    let place =
                        format!("film.mjpeg: the file ends inside frame {}", pictures.len());
                    assert!(error.to_string().contains(&place), "{error}");
                    assert!(!reader.next_raw(&mut raw).unwrap());
                    return (pictures, false);
                }
            }
        }
    }

    #[test]
    fn pictures_are_told_apart() {
        // Without what fills up the space before a marker.
        let one = [&PADDED[..3], &PADDED[4..]].concat();
        let two = vec![one.clone(), one.clone()];
        let padded = [PADDED, b"\0\0\xFF\0", PADDED, b"\0\0\0"].concat();
        assert_eq!(pictures(&padded), (two, true));
        assert_eq!(pictures(b""), (vec![], true));
        // The end of one is missing.
        let unfinished = [&one[..one.len() - 2], &one].concat();
        assert_eq!(
            pictures(&unfinished),
            (vec![one[..one.len() - 2].to_vec(), one.clone()], true)
        );
        for cut in 2..one.len() {
            let bytes = [&one[..], &one[..cut]].concat();
            assert_eq!(pictures(&bytes), (vec![one.clone()], false), "{cut}");
        }
    }

    proptest::proptest! {
        #[test]
        fn random_bytes_never_panic(
            bytes in proptest::collection::vec(proptest::sample::select(&b"\xFF\xD8\xD9\xDA\xE0\0\x03a"[..]), 0..200),
        ) {
            let mut reader = MjpegReader::new(&bytes[..], "x", None);
            let mut frame = Frame::default();
            while !matches!(reader.next_into(&mut frame), Ok(false)) {}
        }
    }
}
