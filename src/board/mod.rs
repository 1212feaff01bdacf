//! Boards to calibrate by: what is printed on one goes in as the user types it, a picture goes in, and where the
//! picture shows the corners of the board comes out.
//!
//! Corners are found by Bennett & Lasenby's ChESS (*ChESS – Quick and robust detection of chess-board features*, 2014)
//! in the crates of calib-targets; which corner is which, a chessboard's colours and a ChArUco board's markers tell.

mod charuco;
mod chess;
mod corner;
mod find;
mod front;
mod pattern;

pub use corner::{Corner, Miss};
pub use find::Finder;
pub use pattern::{Board, Marked};
