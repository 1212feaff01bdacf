//! Anti-aliased shapes on a frame: each pixel is covered by how far its centre lies inside the shape.

use super::font;
use super::palette::Colour;
use crate::capture::Frame;

/// A frame that is drawn on.
pub(super) struct Canvas<'a> {
    width: usize,
    height: usize,
    rgb: &'a mut [u8],
}

impl<'a> Canvas<'a> {
    pub fn new(frame: &'a mut Frame) -> Self {
        let (width, height) = (frame.width as usize, frame.height as usize);
        assert_eq!(
            frame.rgb.len(),
            3 * width * height,
            "expected 3 bytes for each pixel of the frame"
        );
        Self {
            width,
            height,
            rgb: &mut frame.rgb,
        }
    }

    /// Thickness of bones that looks alike at every size, pixels.
    pub fn thickness(&self) -> f32 {
        (self.width.min(self.height) as f32 / 150.0).clamp(1.5, 12.0)
    }

    /// A line with round ends.
    pub fn line(&mut self, a: [f32; 2], b: [f32; 2], radius: f32, colour: Colour, opacity: f32) {
        let along = [b[0] - a[0], b[1] - a[1]];
        let length2 = (along[0] * along[0] + along[1] * along[1]).max(1e-6);
        let low = [a[0].min(b[0]), a[1].min(b[1])];
        let high = [a[0].max(b[0]), a[1].max(b[1])];
        self.fill(low, high, radius, colour, opacity, |x, y| {
            let (dx, dy) = (x - a[0], y - a[1]);
            let t = ((dx * along[0] + dy * along[1]) / length2).clamp(0.0, 1.0);
            (dx - t * along[0]).hypot(dy - t * along[1]) - radius
        });
    }

    /// A filled circle.
    pub fn dot(&mut self, at: [f32; 2], radius: f32, colour: Colour, opacity: f32) {
        self.fill(at, at, radius, colour, opacity, |x, y| {
            (x - at[0]).hypot(y - at[1]) - radius
        });
    }

    /// A circle's outline of the given thickness.
    pub fn ring(
        &mut self,
        at: [f32; 2],
        radius: f32,
        thickness: f32,
        colour: Colour,
        opacity: f32,
    ) {
        let outer = radius + 0.5 * thickness;
        self.fill(at, at, outer, colour, opacity, |x, y| {
            ((x - at[0]).hypot(y - at[1]) - radius).abs() - 0.5 * thickness
        });
    }

    /// Text on a coloured board whose lower left corner lies a little above `at`, pushed back into the picture.
    pub fn label(
        &mut self,
        text: &str,
        at: [f32; 2],
        thickness: f32,
        colour: Colour,
        board: Colour,
    ) {
        let dot = (thickness / 2.5).round().max(1.0) as usize;
        let letters = text.chars().count();
        let board_width = (letters * (font::WIDTH + 1) + 1) * dot;
        let board_height = (font::HEIGHT + 2) * dot;
        let place = |wish: f32, size: usize, limit: usize| {
            wish.clamp(0.0, limit.saturating_sub(size) as f32).round() as usize
        };
        let left = place(at[0] - 0.5 * board_width as f32, board_width, self.width);
        let top = place(
            at[1] - 3.0 * thickness - board_height as f32,
            board_height,
            self.height,
        );
        // Darkened, so that white text stands out on every colour.
        let board = board.map(|c| c / 2);
        for y in top..top + board_height {
            for x in left..left + board_width {
                self.blend(x, y, board, 0.8);
            }
        }
        for (k, letter) in text.chars().enumerate() {
            let x0 = left + (k * (font::WIDTH + 1) + 1) * dot;
            for (row, bits) in font::glyph(letter).into_iter().enumerate() {
                for column in (0..font::WIDTH).filter(|c| bits >> (font::WIDTH - 1 - c) & 1 == 1) {
                    for y in 0..dot {
                        for x in 0..dot {
                            let y = top + (row + 1) * dot + y;
                            self.blend(x0 + column * dot + x, y, colour, 1.0);
                        }
                    }
                }
            }
        }
    }

    /// Blends every pixel near the box `low..=high` by its distance to the shape's edge (negative inside).
    fn fill(
        &mut self,
        low: [f32; 2],
        high: [f32; 2],
        margin: f32,
        colour: Colour,
        opacity: f32,
        distance: impl Fn(f32, f32) -> f32,
    ) {
        let range = |low: f32, high: f32, limit: usize| {
            // Float-to-integer casts saturate, so that far-away coordinates end at the picture's edge.
            let from = (low - margin - 1.0).floor().max(0.0) as usize;
            let to = ((high + margin + 2.0).ceil().max(0.0) as usize).min(limit);
            from..to
        };
        for y in range(low[1], high[1], self.height) {
            for x in range(low[0], high[0], self.width) {
                let coverage = (0.5 - distance(x as f32, y as f32)).clamp(0.0, 1.0);
                if coverage > 0.0 {
                    self.blend(x, y, colour, coverage * opacity);
                }
            }
        }
    }

    /// Mixes a colour into one pixel; outside the picture nothing happens.
    fn blend(&mut self, x: usize, y: usize, colour: Colour, opacity: f32) {
        if x >= self.width || y >= self.height {
            return;
        }
        let at = 3 * (y * self.width + x);
        for (p, c) in self.rgb[at..at + 3].iter_mut().zip(colour) {
            let (old, new) = (f32::from(*p), f32::from(c));
            *p = (old + opacity * (new - old)).round() as u8;
        }
    }
}
