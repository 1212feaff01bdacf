//! A picture goes in, the board's corners come out.

use calib_targets_charuco::CharucoParams;
use calib_targets_chessboard::ChessboardDetector;
use glam::DVec2;

use super::pattern::{Board, LEAST_CORNERS};
use super::{charuco, chess};

/// A corner of the board, seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Corner {
    /// Where it is on the board, squares.
    pub place: DVec2,
    /// Where the picture shows it, pixels.
    pub pixel: DVec2,
}

/// Why a picture shows no board.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Miss {
    /// Nothing like a board.
    #[error("no board was found")]
    Nothing,
    /// Not the whole of a chessboard, or not this one.
    #[error("{0}x{1} corners were found, not those of the board")]
    Size(u32, u32),
    /// Too little of a board.
    #[error("only {0} corners were found")]
    Few(usize),
    /// A board whose black and white squares cannot be told apart.
    #[error("black and white squares look alike")]
    Pale,
}

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
        let corners = match &self.0 {
            Kind::Chess(detector, corners) => chess::find(detector, *corners, &grey, size),
            Kind::Charuco(params) => charuco::find(params, &grey, size),
        }?;
        if corners.len() < LEAST_CORNERS {
            return Err(Miss::Few(corners.len()));
        }
        Ok(corners)
    }
}

/// ITU-R BT.601's luma.
fn grey(rgb: &[u8]) -> u8 {
    let [r, g, b] = [rgb[0], rgb[1], rgb[2]].map(u32::from);
    ((77 * r + 150 * g + 29 * b + 128) >> 8) as u8
}
