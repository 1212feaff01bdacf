//! What is printed on a board: `9x6` or `charuco:8x6:DICT_5X5_100`.

use std::fmt;
use std::str::FromStr;

use calib_targets_charuco::{CharucoBoard, CharucoBoardSpec, Dictionary, resolve_dictionary};

/// Fewest squares a side: fewer corners do not tell a pose well.
const LEAST_SQUARES: u32 = 3;
/// Fewest corners by which a board counts as found: fewer do not tell a pose.
pub(super) const LEAST_CORNERS: usize = 8;
/// Most squares a side.
const MOST_SQUARES: u32 = 100;
/// Side of a marker as a share of its square's, where nobody says another.
const USUAL_MARKER: f64 = 0.75;

/// A flat board of squares.
///
/// Places on it are in squares: x along its rows, y down its columns, the first inner corner at 0, 0; seen from the
/// front, x goes right where y goes down.
#[derive(Debug, Clone, Copy)]
pub enum Board {
    /// A chessboard.
    Chess {
        /// Inner corners in a row, and rows of them.
        corners: [u32; 2],
    },
    /// A chessboard with a marker in every white square, whose first square is black, as OpenCV has them since 4.6.
    Charuco(Marked),
}

/// A ChArUco board.
#[derive(Debug, Clone, Copy)]
pub struct Marked {
    /// Squares in a row, and rows of them.
    pub squares: [u32; 2],
    /// Whose markers they are.
    pub dictionary: Dictionary,
    /// Side of a marker as a share of its square's.
    pub marker: f64,
}

impl Marked {
    /// The board as its detector has it.
    ///
    /// # Errors
    /// One line when the dictionary has too few markers, or markers do not fit into squares.
    pub fn layout(&self) -> Result<CharucoBoard, String> {
        let [columns, rows] = self.squares;
        let marker = self.marker as f32;
        let spec = CharucoBoardSpec::new(rows, columns, 1.0, marker, self.dictionary);
        CharucoBoard::new(spec).map_err(|e| format!("no such ChArUco board: {e}"))
    }
}

impl Board {
    /// Inner corners in a row, and rows of them.
    pub fn corners(&self) -> [u32; 2] {
        match self {
            Self::Chess { corners } => *corners,
            Self::Charuco(marked) => marked.squares.map(|n| n - 1),
        }
    }

    /// Whether it looks the same from another side, so that nobody can tell which corner is the first.
    pub fn looks_alike_turned(&self) -> bool {
        match self {
            Self::Chess { corners: [a, b] } => (a + b) % 2 == 0,
            Self::Charuco(_) => false,
        }
    }
}

impl FromStr for Board {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || {
            format!(
                "expected inner corners as in 9x6, or squares and a dictionary as in charuco:8x6:DICT_5X5_100, found '{text}'"
            )
        };
        let size = |text: &str| -> Option<[u32; 2]> {
            let (a, b) = text.split_once(['x', 'X'])?;
            Some([a.trim().parse().ok()?, b.trim().parse().ok()?])
        };
        let fits = |size: [u32; 2], least: u32, what: &str| {
            let enough = size.iter().all(|n| (least..=MOST_SQUARES).contains(n));
            enough.then_some(()).ok_or_else(|| {
                format!(
                    "expected a board of {least}x{least} to {MOST_SQUARES}x{MOST_SQUARES} {what}, found {}x{}",
                    size[0], size[1]
                )
            })
        };
        let Some(rest) = text.strip_prefix("charuco:") else {
            let corners = size(text).ok_or_else(wrong)?;
            fits(corners, LEAST_SQUARES, "inner corners")?;
            return Ok(Self::Chess { corners });
        };
        let (squares, name) = rest.split_once(':').ok_or_else(wrong)?;
        let squares = size(squares).ok_or_else(wrong)?;
        fits(squares, LEAST_SQUARES, "squares")?;
        let corners = (squares[0] - 1) * (squares[1] - 1);
        if (corners as usize) < LEAST_CORNERS {
            return Err(format!(
                "expected a board of at least {LEAST_CORNERS} inner corners, such as 4x4 squares, found {}x{} with {corners}",
                squares[0], squares[1]
            ));
        }
        let dictionary = resolve_dictionary(name).ok_or_else(|| {
            format!("expected a dictionary of OpenCV's, such as DICT_4X4_50, DICT_5X5_100 or DICT_APRILTAG_36h11, found '{name}'")
        })?;
        let marked = Marked {
            squares,
            dictionary,
            marker: USUAL_MARKER,
        };
        marked.layout()?;
        Ok(Self::Charuco(marked))
    }
}

impl fmt::Display for Board {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Chess { corners: [a, b] } => write!(f, "{a}x{b}"),
            Self::Charuco(m) => {
                let [a, b] = m.squares;
                write!(f, "charuco:{a}x{b}:{}", m.dictionary.name())
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_board_is_what_is_typed() {
        let chess: Board = "9x6".parse().unwrap();
        assert_eq!(chess.corners(), [9, 6]);
        assert!(!chess.looks_alike_turned());
        assert!("8x6".parse::<Board>().unwrap().looks_alike_turned());
        let charuco: Board = "charuco:8x6:DICT_5X5_100".parse().unwrap();
        assert_eq!(charuco.corners(), [7, 5]);
        assert_eq!(charuco.to_string(), "charuco:8x6:DICT_5X5_100");
    }

    #[test]
    fn what_is_no_board_is_said() {
        for (text, words) in [
            ("9", "9x6"),
            ("2x6", "3x3"),
            ("charuco:8x6", "DICT_5X5_100"),
            ("charuco:3x4:DICT_4X4_50", "8 inner corners"),
            ("charuco:8x6:DICT_9X9", "DICT_9X9"),
            ("charuco:20x20:DICT_4X4_50", "200 markers"),
        ] {
            let error = text.parse::<Board>().unwrap_err();
            assert!(error.contains(words), "{text}: {error}");
        }
    }
}
