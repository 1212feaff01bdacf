//! Which way up a photo is: EXIF bytes go in, one of eight orientations comes out, and pixels are turned accordingly.

use super::frame::Frame;

/// EXIF tag 0x0112: where the picture's first row and first column are when it is looked at.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Orientation {
    /// 1: as stored.
    #[default]
    Upright,
    /// 2: mirrored left to right.
    MirroredAcross,
    /// 3: turned by half.
    HalfTurn,
    /// 4: mirrored top to bottom.
    MirroredDown,
    /// 5: rows and columns exchanged.
    Transposed,
    /// 6: to be turned a quarter clockwise.
    QuarterClockwise,
    /// 7: rows and columns exchanged, then turned by half.
    Transversed,
    /// 8: to be turned a quarter counter-clockwise.
    QuarterCounterClockwise,
}

impl Orientation {
    /// From the tag's value; anything unknown counts as upright.
    pub fn from_tag(value: u16) -> Self {
        match value {
            2 => Self::MirroredAcross,
            3 => Self::HalfTurn,
            4 => Self::MirroredDown,
            5 => Self::Transposed,
            6 => Self::QuarterClockwise,
            7 => Self::Transversed,
            8 => Self::QuarterCounterClockwise,
            _ => Self::Upright,
        }
    }

    /// From a TIFF block, which is what follows `Exif\0\0` in a JPEG and what a PNG's `eXIf` chunk holds. Damaged
    /// blocks and blocks without the tag count as upright: a wrong label is no reason to refuse a picture.
    pub fn from_exif(tiff: &[u8]) -> Self {
        read_tag(tiff).map_or(Self::Upright, Self::from_tag)
    }

    /// Turns a picture so that it is upright.
    pub fn apply(self, frame: &mut Frame) {
        let (w, h) = (frame.width as usize, frame.height as usize);
        let swapped = matches!(
            self,
            Self::Transposed
                | Self::QuarterClockwise
                | Self::Transversed
                | Self::QuarterCounterClockwise
        );
        if self == Self::Upright || w == 0 || h == 0 {
            return;
        }
        let (out_w, out_h) = if swapped { (h, w) } else { (w, h) };
        let mut out = vec![0; frame.rgb.len()];
        for (y, row) in out.chunks_exact_mut(3 * out_w).enumerate() {
            for (x, pixel) in row.chunks_exact_mut(3).enumerate() {
                let (sx, sy) = match self {
                    Self::Upright => (x, y),
                    Self::MirroredAcross => (w - 1 - x, y),
                    Self::HalfTurn => (w - 1 - x, h - 1 - y),
                    Self::MirroredDown => (x, h - 1 - y),
                    Self::Transposed => (y, x),
                    Self::QuarterClockwise => (y, h - 1 - x),
                    Self::Transversed => (w - 1 - y, h - 1 - x),
                    Self::QuarterCounterClockwise => (w - 1 - y, x),
                };
                let at = 3 * (sy * w + sx);
                pixel.copy_from_slice(&frame.rgb[at..at + 3]);
            }
        }
        frame.rgb = out;
        frame.width = out_w as u32;
        frame.height = out_h as u32;
    }
}

/// Tag 0x0112 of the first directory, `None` when there is none or the block is damaged.
fn read_tag(tiff: &[u8]) -> Option<u16> {
    let little = match tiff.get(..4)? {
        b"II*\0" => true,
        b"MM\0*" => false,
        _ => return None,
    };
    let u16_at = |at: usize| -> Option<u16> {
        let bytes = tiff.get(at..at.checked_add(2)?)?.try_into().ok()?;
        Some(if little {
            u16::from_le_bytes(bytes)
        } else {
            u16::from_be_bytes(bytes)
        })
    };
    let u32_at = |at: usize| -> Option<u32> {
        let bytes = tiff.get(at..at.checked_add(4)?)?.try_into().ok()?;
        Some(if little {
            u32::from_le_bytes(bytes)
        } else {
            u32::from_be_bytes(bytes)
        })
    };
    const ORIENTATION: u16 = 0x0112;
    const SHORT: u16 = 3;
    let directory = u32_at(4)? as usize;
    let entries = usize::from(u16_at(directory)?);
    (0..entries)
        .map_while(|k| directory.checked_add(2 + 12 * k))
        .find(|at| u16_at(*at) == Some(ORIENTATION))
        .filter(|at| u16_at(at + 2) == Some(SHORT))
        .and_then(|at| u16_at(at + 8))
}
