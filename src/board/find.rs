//! A picture goes in, the board's corners come out.

use calib_targets_charuco::CharucoParams;
use calib_targets_chessboard::ChessboardDetector;
use glam::DVec2;

use super::corner::{Corner, Miss};
use super::pattern::{Board, LEAST_CORNERS};
use super::{charuco, chess};

/// So often is a picture without the board halved and looked at again: edges of large pictures that are out of focus,
/// or were scaled up, are wider than what detectors look for. A picture that shows no board takes a third longer by it.
const HALVINGS: i32 = 2;
/// Pictures with a side shorter than this show no edges that are too wide, pixels.
const LEAST_SIDE: u32 = 240;
/// Pictures with a side shorter than this show no board, pixels: corners are found by rings of 11 pixels across, and
/// their detector takes it for granted that rows are long enough for one.
const LEAST_FOR_CORNERS: u32 = 16;

/// Finds one kind of board.
pub struct Finder(Kind);

enum Kind {
    Chess(ChessboardDetector, [u32; 2]),
    Charuco(Box<CharucoParams>),
}

impl Finder {
    /// A finder of this board.
    ///
    /// # Errors
    /// One line when there is no such board.
    pub fn new(board: &Board) -> Result<Self, String> {
        Ok(Self(match board {
            Board::Chess { corners } => Kind::Chess(chess::detector()?, *corners),
            Board::Charuco(marked) => Kind::Charuco(Box::new(charuco::params(marked)?)),
        }))
    }

    /// The corners that a picture shows: `rgb` is interleaved, 3 bytes a pixel, of `size` pixels across and down. A
    /// chessboard is found whole or not at all, a few corners may lack inside; of a ChArUco board a part is enough.
    ///
    /// # Errors
    /// [`Miss`]: why there is none.
    ///
    /// # Panics
    /// If `rgb` has another length.
    pub fn find(&self, rgb: &[u8], size: [u32; 2]) -> Result<Vec<Corner>, Miss> {
        let pixels = size[0] as usize * size[1] as usize;
        assert_eq!(rgb.len(), 3 * pixels, "pixels of {size:?}");
        let grey: Vec<u8> = rgb.chunks_exact(3).map(grey).collect();
        let miss = match self.look(&grey, size) {
            Err(miss) if self.may_be_soft(&miss) => miss,
            sharp => return sharp,
        };
        let (mut grey, mut size) = (grey, size);
        for halvings in 1..=HALVINGS {
            (grey, size) = halved(&grey, size);
            if size[0].min(size[1]) < LEAST_SIDE {
                break;
            }
            let Ok(mut corners) = self.look(&grey, size) else {
                continue;
            };
            // Pixels' centres are on integers.
            let larger = |p: DVec2| (p + 0.5) * 2.0_f64.powi(halvings) - 0.5;
            corners.iter_mut().for_each(|c| c.pixel = larger(c.pixel));
            return Ok(corners);
        }
        Err(miss)
    }

    /// The corners in a grey picture as large as it is.
    fn look(&self, grey: &[u8], size: [u32; 2]) -> Result<Vec<Corner>, Miss> {
        if size[0].min(size[1]) < LEAST_FOR_CORNERS {
            return Err(Miss::Nothing);
        }
        let corners = match &self.0 {
            Kind::Chess(detector, corners) => chess::find(detector, *corners, grey, size),
            Kind::Charuco(params) => charuco::find(params, grey, size),
        }?;
        if corners.len() < LEAST_CORNERS {
            return Err(Miss::Few(corners.len()));
        }
        Ok(corners)
    }

    /// Whether a picture without the board may only be out of focus. One that shows a larger board is not: of this, a
    /// smaller picture may show as much as would be taken for the board.
    fn may_be_soft(&self, miss: &Miss) -> bool {
        match (miss, &self.0) {
            (Miss::Pale, _) => false,
            (Miss::Size(a, b), Kind::Chess(_, [columns, rows])) => {
                let holds = |w: u32, h: u32| w >= *columns && h >= *rows;
                !holds(*a, *b) && !holds(*b, *a)
            }
            _ => true,
        }
    }
}

/// The picture half as large: means of four pixels; an odd column or row at the end is left out.
fn halved(grey: &[u8], size: [u32; 2]) -> (Vec<u8>, [u32; 2]) {
    let half = size.map(|side| side / 2);
    let [width, w, h] = [size[0], half[0], half[1]].map(|side| side as usize);
    let mut small = Vec::with_capacity(w * h);
    for rows in grey.chunks_exact(2 * width.max(1)).take(h) {
        let (upper, lower) = rows.split_at(width);
        let fours = upper.chunks_exact(2).zip(lower.chunks_exact(2));
        small.extend(fours.map(|(a, b)| {
            let sum: u16 = [a[0], a[1], b[0], b[1]].map(u16::from).iter().sum();
            ((sum + 2) / 4) as u8
        }));
    }
    (small, half)
}

/// ITU-R BT.601's luma.
fn grey(rgb: &[u8]) -> u8 {
    let [r, g, b] = [rgb[0], rgb[1], rgb[2]].map(u32::from);
    ((77 * r + 150 * g + 29 * b + 128) >> 8) as u8
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use glam::DMat2;

    use super::*;

    /// 1 in the first of squares with a side of 1, -1 in the second, and so on; edges are about `soft` squares wide.
    fn wave(x: f64, soft: f64) -> f64 {
        ((PI * x).sin() / (PI * soft)).tanh()
    }

    /// A board of 10 by 7 squares that stands askew and fills most of the picture, with edges that are about `soft`
    /// pixels wide, and with noise; and where its inner corners are, row by row.
    fn picture(size: [u32; 2], soft: f64) -> (Vec<u8>, Vec<DVec2>) {
        let square = f64::from(size[1]) / 10.0;
        let (x, y) = (DVec2::new(1.0, 0.12), DVec2::new(-0.15, 0.95));
        let (x, y) = (square * x, square * y);
        let middle = DVec2::new(size[0].into(), size[1].into()) / 2.0 + DVec2::new(3.3, -2.6);
        let first = middle - 5.0 * x - 3.5 * y;
        let axes = DMat2::from_cols(x, y);
        let inverse = axes.inverse();
        let (mut noise, mut rgb) = (1_u32, Vec::new());
        for k in 0..size[0] * size[1] {
            let pixel = DVec2::new((k % size[0]).into(), (k / size[0]).into());
            let at = inverse * (pixel - first);
            let is_on = (0.0..10.0).contains(&at.x) && (0.0..7.0).contains(&at.y);
            let colour = if is_on {
                -wave(at.x, soft / square) * wave(at.y, soft / square)
            } else {
                1.0
            };
            noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let grain = f64::from(noise >> 24) / 32.0 - 4.0;
            let value = (128.0 + 87.0 * colour + grain).round() as u8;
            rgb.extend([value; 3]);
        }
        let corners =
            (0..54).map(|k| first + axes * DVec2::new(f64::from(1 + k % 9), f64::from(1 + k / 9)));
        (rgb, corners.collect())
    }

    #[test]
    fn boards_in_large_soft_pictures_are_found() {
        let finder = Finder::new(&"9x6".parse().unwrap()).unwrap();
        for (size, soft, off) in [
            ([1280, 720], 0.8, 0.2),
            ([2560, 1440], 3.2, 0.4),
            ([2561, 1441], 16.0, 1.2),
        ] {
            let (rgb, corners) = picture(size, soft);
            let found = finder.find(&rgb, size).unwrap();
            assert_eq!(found.len(), 54, "{size:?}");
            for corner in found {
                let k = corner.place.x + 9.0 * corner.place.y;
                let apart = corner.pixel.distance(corners[k as usize]);
                assert!(apart < off, "{size:?}: {corner:?} is {apart} px off");
            }
        }
    }

    #[test]
    fn pictures_that_are_too_narrow_for_a_corner_show_no_board() {
        for board in ["9x6", "charuco:8x6:DICT_5X5_100"] {
            let finder = Finder::new(&board.parse().unwrap()).unwrap();
            for size in [[2, 400], [9, 400], [15, 400], [400, 2], [1, 1]] {
                let found = finder.find(&noise(size), size);
                assert_eq!(found, Err(Miss::Nothing), "{board}, {size:?}");
            }
            // The smallest ones that are looked at.
            for size in [[16, 16], [16, 400], [400, 16]] {
                let found = finder.find(&noise(size), size);
                assert!(found.is_err(), "{board}, {size:?}: {found:?}");
            }
        }
    }

    fn noise(size: [u32; 2]) -> Vec<u8> {
        let mut noise = 1_u32;
        (0..3 * size[0] * size[1])
            .map(|_| {
                noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                (noise >> 24) as u8
            })
            .collect()
    }

    #[test]
    fn a_larger_board_is_not_looked_for_again() {
        let finder = Finder::new(&"8x6".parse().unwrap()).unwrap();
        for (miss, may_be_soft) in [
            (Miss::Nothing, true),
            (Miss::Few(20), true),
            (Miss::Size(5, 4), true),
            (Miss::Size(9, 6), false),
            (Miss::Size(6, 9), false),
            (Miss::Pale, false),
        ] {
            assert_eq!(finder.may_be_soft(&miss), may_be_soft, "{miss:?}");
        }
    }

    #[test]
    fn a_picture_is_halved_by_means() {
        let grey = [0, 2, 9, 4, 6, 9, 9, 9, 9];
        assert_eq!(halved(&grey, [3, 3]), (vec![3], [1, 1]));
        let odd = [10, 20, 30, 40, 1, 2, 3, 4];
        assert_eq!(halved(&odd, [4, 2]), (vec![8, 19], [2, 1]));
    }
}
