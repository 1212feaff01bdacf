//! Films whose pixels are wider or narrower than high: their pictures go in, pictures of square pixels come out. A lens
//! is one for both directions.

use super::error::CaptureError;
use super::frame::Frame;
use super::limits::check_size;
use super::rate::Rate;
use super::source::Source;

/// How far the width of a pixel may be from its height: headers round the shape of the picture.
const SQUARE_WITHIN: f64 = 1e-3;

/// How wide a film's pixels are for their height.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PixelShape(f64);

impl PixelShape {
    /// From width and height in any unit; `None` where one is 0, which says that it is not known.
    pub fn new(across: u64, down: u64) -> Option<Self> {
        (across > 0 && down > 0).then(|| Self(across as f64 / down as f64))
    }

    /// After a quarter turn.
    #[cfg(feature = "mp4")]
    pub fn turned(self) -> Self {
        Self(1.0 / self.0)
    }

    /// What a picture of so many pixels becomes. One side is stretched: no pixel is thrown away.
    fn size(self, width: u32, height: u32) -> (u64, u64) {
        let stretched = |side: u32, by: f64| (f64::from(side) * by.max(1.0)).round() as u64;
        (stretched(width, self.0), stretched(height, 1.0 / self.0))
    }
}

/// A film's pictures with square pixels. Where they are square already, or nobody knows, it is the film itself.
pub fn square(film: impl Source + 'static, shape: Option<PixelShape>) -> Box<dyn Source> {
    match shape {
        Some(shape) if (shape.0 - 1.0).abs() > SQUARE_WITHIN => Box::new(Stretched {
            film,
            shape,
            own: Frame::default(),
        }),
        _ => Box::new(film),
    }
}

struct Stretched<S> {
    film: S,
    shape: PixelShape,
    /// The film's own picture.
    own: Frame,
}

impl<S: Source> Source for Stretched<S> {
    fn next_into(&mut self, frame: &mut Frame) -> Result<bool, CaptureError> {
        if !self.film.next_into(&mut self.own)? {
            return Ok(false);
        }
        let own = &self.own;
        let (width, height) = self.shape.size(own.width, own.height);
        check_size(width, height).map_err(|reason| CaptureError::data(self.name(), reason))?;
        (frame.time_ns, frame.sequence) = (own.time_ns, own.sequence);
        // Sides within the limits.
        (frame.width, frame.height) = (width as u32, height as u32);
        frame.rgb.resize(3 * (width * height) as usize, 0);
        match frame.width > own.width {
            true => stretch_across(own, frame),
            false => stretch_down(own, frame),
        }
        Ok(true)
    }

    fn frame_count(&self) -> Option<u64> {
        self.film.frame_count()
    }

    fn fps(&self) -> Option<f64> {
        self.film.fps()
    }

    fn rate(&self) -> Rate {
        self.film.rate()
    }

    fn is_live(&self) -> bool {
        self.film.is_live()
    }

    fn is_stills(&self) -> bool {
        self.film.is_stills()
    }

    fn name(&self) -> &str {
        self.film.name()
    }

    fn picture(&self) -> String {
        self.film.picture()
    }
}

/// Of each pixel along the longer side: the two of the shorter one that it lies between, and 256ths of the second.
fn places(from: u32, to: u32) -> Vec<(usize, usize, u32)> {
    let (last, step) = (f64::from(from - 1), f64::from(from) / f64::from(to));
    let place = |k: u32| {
        let at = ((f64::from(k) + 0.5) * step - 0.5).clamp(0.0, last);
        let first = at.floor();
        let second = (first + 1.0).min(last);
        let share = ((at - first) * 256.0).round() as u32;
        (first as usize, second as usize, share)
    };
    (0..to).map(place).collect()
}

fn stretch_across(from: &Frame, to: &mut Frame) {
    let places = places(from.width, to.width);
    let rows = from.rgb.chunks_exact(3 * from.width as usize);
    let stretched = to.rgb.chunks_exact_mut(3 * to.width as usize);
    for (row, stretched) in rows.zip(stretched) {
        for (pixel, (a, b, share)) in stretched.chunks_exact_mut(3).zip(&places) {
            mix(&row[3 * a..][..3], &row[3 * b..][..3], *share, pixel);
        }
    }
}

fn stretch_down(from: &Frame, to: &mut Frame) {
    let bytes = 3 * from.width as usize;
    let row = |k: usize| &from.rgb[k * bytes..][..bytes];
    let places = places(from.height, to.height);
    for (stretched, (a, b, share)) in to.rgb.chunks_exact_mut(bytes).zip(places) {
        mix(row(a), row(b), share, stretched);
    }
}

fn mix(a: &[u8], b: &[u8], share: u32, out: &mut [u8]) {
    for ((out, a), b) in out.iter_mut().zip(a).zip(b) {
        *out = ((u32::from(*a) * (256 - share) + u32::from(*b) * share + 128) >> 8) as u8;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One picture whose columns, or rows, rise.
    struct Ramp(bool);

    impl Source for Ramp {
        fn next_into(&mut self, frame: &mut Frame) -> Result<bool, CaptureError> {
            (frame.width, frame.height) = (45, 36);
            let value = |k: usize| if self.0 { k % 45 } else { k / 45 };
            frame.rgb = (0..45 * 36).flat_map(|k| [4 * value(k) as u8; 3]).collect();
            (frame.time_ns, frame.sequence) = (7, 3);
            Ok(true)
        }

        fn name(&self) -> &str {
            "ramp"
        }
    }

    fn stretched(across: u64, down: u64, is_across: bool) -> Frame {
        let mut film = square(Ramp(is_across), PixelShape::new(across, down));
        film.next().unwrap().unwrap()
    }

    #[test]
    fn the_side_that_is_too_short_is_stretched_and_nothing_moves() {
        for (across, down, size) in [
            (64, 45, (64, 36)),
            (3, 4, (45, 48)),
            (1, 1, (45, 36)),
            (1000, 1001, (45, 36)),
            (0, 1, (45, 36)),
            (1, 0, (45, 36)),
        ] {
            let is_across = across >= down;
            let frame = stretched(across, down, is_across);
            assert_eq!((frame.width, frame.height), size, "{across}:{down}");
            assert_eq!((frame.time_ns, frame.sequence), (7, 3));
            let (long, short) = match is_across {
                true => (size.0, 45.0),
                false => (size.1, 36.0),
            };
            for (k, pixel) in frame.rgb.chunks_exact(3).enumerate() {
                let (x, y) = (k as u32 % size.0, k as u32 / size.0);
                let along = f64::from(if is_across { x } else { y });
                let at = (along + 0.5) * short / f64::from(long) - 0.5;
                let wanted = 4.0 * at.clamp(0.0, short - 1.0);
                assert!((f64::from(pixel[0]) - wanted).abs() <= 1.0, "{x} {y}");
            }
        }
    }

    #[test]
    fn a_shape_that_cannot_be_is_refused_before_the_picture_is_made() {
        let mut film = square(Ramp(true), PixelShape::new(u64::MAX, 1));
        let error = film.next().unwrap_err();
        assert_eq!(error.exit_code(), 65);
        assert!(error.to_string().contains("ramp"), "{error}");
    }
}
