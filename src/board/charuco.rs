//! ChArUco boards: markers tell which corner is which.

use calib_targets_charuco::{CharucoCorner, CharucoDetector, CharucoParams, GrayImageView};
use glam::DVec2;

use super::corner::{Corner, Miss};
use super::front::front;
use super::pattern::Marked;

/// Corners weaker than this share of the strong ones are left out, one share after the other: in small or sharp
/// pictures the bits of markers have corners too, and which of them are in the way nobody knows beforehand.
const SHARES: [f32; 3] = [0.0, 0.25, 0.4];
/// The strength that shares are of is that of this corner, counted from the strongest.
const STRONG: usize = 10;

/// How one board is looked for.
pub fn params(board: &Marked) -> Result<CharucoParams, String> {
    let mut params = CharucoParams::for_board(board.layout()?.spec());
    params.chess = front();
    Ok(params)
}

/// The corners in a grey picture.
pub fn find(params: &CharucoParams, grey: &[u8], size: [u32; 2]) -> Result<Vec<Corner>, Miss> {
    let picture = GrayImageView {
        width: size[0] as usize,
        height: size[1] as usize,
        data: grey,
    };
    let cloud = calib_targets_chessboard::detect_corners(&picture, &params.chess);
    let mut strengths: Vec<f32> = cloud.iter().map(|c| c.strength).collect();
    strengths.sort_by(|a, b| b.total_cmp(a));
    let strong = strengths.get(STRONG).copied().ok_or(Miss::Nothing)?;
    let all = params.board.cols.saturating_sub(1) * params.board.rows.saturating_sub(1);
    let mut most: Vec<CharucoCorner> = Vec::new();
    for share in SHARES {
        let mut params = params.clone();
        let least = &mut params.chessboard.min_corner_strength;
        *least = least.max(share * strong);
        let Ok(detector) = CharucoDetector::new(params) else {
            return Err(Miss::Nothing);
        };
        let found = detector.detect_with_corners(&picture, &cloud);
        let corners = found.map_or_else(|_| Vec::new(), |f| f.corners);
        if corners.len() > most.len() {
            most = corners;
        }
        if most.len() == all as usize {
            break;
        }
    }
    if most.is_empty() {
        return Err(Miss::Nothing);
    }
    let inner = params.board.cols - 1;
    let one = |c: &CharucoCorner| Corner {
        place: DVec2::new(f64::from(c.id % inner), f64::from(c.id / inner)),
        pixel: DVec2::new(c.position.x.into(), c.position.y.into()),
    };
    Ok(most.iter().map(one).collect())
}
