//! A picture of dots in a grid of characters: every character cell shows a few dots, all of one colour.

use std::fmt::Write;

use console::Style;

use super::palette::Colour;

/// Which characters show the dots.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Glyphs {
    /// Two by four dots a character; needs a font with Braille, as every graphical terminal has.
    Braille,
    /// One by two; the Linux console has them.
    Blocks,
}

impl Glyphs {
    /// Dots across and down a character; a character is taken to be twice as high as wide, so dots are square.
    pub(super) fn dots(self) -> [usize; 2] {
        match self {
            Self::Braille => [2, 4],
            Self::Blocks => [1, 2],
        }
    }

    /// Bit of the dot at column x, row y of a character.
    fn bit(self, x: usize, y: usize) -> u8 {
        match self {
            // Unicode numbers the upper six dots column by column and appended the lowest two later.
            Self::Braille => [[0, 3], [1, 4], [2, 5], [6, 7]][y][x],
            Self::Blocks => [0, 1][y],
        }
    }

    fn character(self, bits: u8) -> char {
        match self {
            Self::Braille => char::from_u32(0x2800 + u32::from(bits)).expect("a Braille pattern"),
            Self::Blocks => [' ', '▀', '▄', '█'][usize::from(bits)],
        }
    }
}

#[derive(Debug, Clone, Copy, Default)]
struct Cell {
    bits: u8,
    letter: Option<char>,
    colour: Option<Colour>,
}

/// The picture. Coordinates are in dots, centres on integers.
#[derive(Debug)]
pub(super) struct Dots {
    glyphs: Glyphs,
    columns: usize,
    cells: Vec<Cell>,
}

impl Dots {
    pub fn new(glyphs: Glyphs, columns: usize, rows: usize) -> Self {
        Self {
            glyphs,
            columns,
            cells: vec![Cell::default(); columns * rows],
        }
    }

    /// A line one dot wide; of a faint one every second dot is missing.
    pub fn line(&mut self, a: [f32; 2], b: [f32; 2], colour: Colour, faint: bool) {
        let Some([a, b]) = self.clip(a, b) else {
            return;
        };
        let steps = (b[0] - a[0]).abs().max((b[1] - a[1]).abs()).ceil();
        for k in (0..=steps as usize).step_by(1 + usize::from(faint)) {
            let t = k as f32 / steps.max(1.0);
            self.set([0, 1].map(|i| a[i] + t * (b[i] - a[i])), colour);
        }
    }

    /// A circle's outline.
    pub fn ring(&mut self, at: [f32; 2], radius: f32, colour: Colour, faint: bool) {
        let size = self.size();
        if (0..2).any(|i| at[i] + radius < 0.0 || at[i] - radius > size[i]) {
            return;
        }
        // A circle that reaches past the picture needs no more dots than the picture has round its rim.
        let dots = radius.min(size[0] + size[1]).max(1.0);
        let steps = (std::f32::consts::TAU * dots).ceil() as usize;
        for k in (0..steps).step_by(1 + usize::from(faint)) {
            let (sin, cos) = (k as f32 / dots).sin_cos();
            self.set([at[0] + radius * cos, at[1] + radius * sin], colour);
        }
    }

    /// Letters from the character that holds the dot `at`, as far as there is room.
    pub fn text(&mut self, at: [f32; 2], text: &str, colour: Colour) {
        let [dx, dy] = self.glyphs.dots();
        let rows = self.cells.len() / self.columns.max(1);
        let row = (at[1].round() / dy as f32).floor();
        let column = (at[0].round() / dx as f32).floor();
        if !(0.0..rows as f32).contains(&row) || !(0.0..self.columns as f32).contains(&column) {
            return;
        }
        let (row, column) = (row as usize, column as usize);
        for (k, letter) in text.chars().enumerate().take(self.columns - column) {
            self.cells[row * self.columns + column + k] = Cell {
                bits: 0,
                letter: Some(letter),
                colour: Some(colour),
            };
        }
    }

    /// The lines, top to bottom, each `columns` wide; with the escape codes of colours where `coloured`.
    pub fn lines(&self, coloured: bool) -> Vec<String> {
        let show = |cell: &Cell| {
            cell.letter.unwrap_or_else(|| {
                if cell.bits == 0 {
                    ' '
                } else {
                    self.glyphs.character(cell.bits)
                }
            })
        };
        self.cells
            .chunks(self.columns.max(1))
            .map(|row| {
                let mut line = String::new();
                for run in row.chunk_by(|a, b| a.colour == b.colour) {
                    let text: String = run.iter().map(show).collect();
                    match run[0].colour {
                        Some(colour) if coloured => {
                            let style = Style::new().color256(nearest(colour)).force_styling(true);
                            let _ = write!(line, "{}", style.apply_to(text));
                        }
                        _ => line.push_str(&text),
                    }
                }
                line
            })
            .collect()
    }

    /// Dots from one line to the next.
    pub fn row_height(&self) -> f32 {
        self.glyphs.dots()[1] as f32
    }

    /// Dots across and down.
    fn size(&self) -> [f32; 2] {
        let [dx, dy] = self.glyphs.dots();
        let rows = self.cells.len() / self.columns.max(1);
        [(self.columns * dx) as f32, (rows * dy) as f32]
    }

    fn set(&mut self, at: [f32; 2], colour: Colour) {
        let size = self.size();
        let at = at.map(f32::round);
        if !(0.0..size[0]).contains(&at[0]) || !(0.0..size[1]).contains(&at[1]) {
            return;
        }
        let [dx, dy] = self.glyphs.dots();
        let (x, y) = (at[0] as usize, at[1] as usize);
        let cell = &mut self.cells[y / dy * self.columns + x / dx];
        if cell.letter.is_none() {
            cell.bits |= 1 << self.glyphs.bit(x % dx, y % dy);
            cell.colour = Some(colour);
        }
    }

    /// The part of a line within half a dot of the picture (Liang and Barsky): its ends may be kilometres away.
    fn clip(&self, a: [f32; 2], b: [f32; 2]) -> Option<[[f32; 2]; 2]> {
        let size = self.size();
        let (mut from, mut to) = (0.0_f32, 1.0_f32);
        for i in 0..2 {
            let along = b[i] - a[i];
            let (low, high) = (-0.5 - a[i], size[i] - 0.5 - a[i]);
            if along == 0.0 {
                if low > 0.0 || high < 0.0 {
                    return None;
                }
                continue;
            }
            let (enter, leave) = if along > 0.0 {
                (low / along, high / along)
            } else {
                (high / along, low / along)
            };
            (from, to) = (from.max(enter), to.min(leave));
        }
        let at = |t: f32| [0, 1].map(|i| a[i] + t * (b[i] - a[i]));
        (from <= to).then(|| [at(from), at(to)])
    }
}

/// The nearest of the 216 colours that terminals of 256 colours agree on.
fn nearest(colour: Colour) -> u8 {
    const LEVELS: [u8; 6] = [0, 95, 135, 175, 215, 255];
    let level = |v: u8| {
        (0..6)
            .min_by_key(|&k| LEVELS[k].abs_diff(v))
            .expect("six levels") as u8
    };
    16 + 36 * level(colour[0]) + 6 * level(colour[1]) + level(colour[2])
}
