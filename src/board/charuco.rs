//! ChArUco boards: markers tell which corner is which.

use calib_targets_charuco::{CharucoDetector, CharucoParams, GrayImageView};
use glam::DVec2;

use super::find::{Corner, Miss};
use super::pattern::Marked;

/// The detector of one board.
pub fn detector(board: &Marked) -> Result<CharucoDetector, String> {
    let mut params = CharucoParams::for_board(board.layout()?.spec());
    params.chess = params.chess.with_refiner(calib_targets_core::ImageRefiner::saddle_point());
    CharucoDetector::new(params).map_err(|e| format!("no such ChArUco board: {e}"))
}

/// The corners in a grey picture.
pub fn find(detector: &CharucoDetector, grey: &[u8], size: [u32; 2]) -> Result<Vec<Corner>, Miss> {
    let picture = GrayImageView {
        width: size[0] as usize,
        height: size[1] as usize,
        data: grey,
    };
    let found = detector.detect(&picture).map_err(|_| Miss::Nothing)?;
    let inner = detector.board().expected_inner_cols();
    let one = |c: &calib_targets_charuco::CharucoCorner| Corner {
        place: DVec2::new(f64::from(c.id % inner), f64::from(c.id / inner)),
        pixel: DVec2::new(c.position.x.into(), c.position.y.into()),
    };
    Ok(found.corners.iter().map(one).collect())
}
