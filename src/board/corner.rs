//! What a picture shows of a board: its corners, or why there are none.

use glam::DVec2;

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
