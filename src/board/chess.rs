//! Chessboards: the whole grid says which corner is which, and its colours which side is up.

use std::collections::BTreeMap;

use calib_targets_chessboard::{
    ChessboardDetection, ChessboardDetector, ChessboardParams, GrayImageView, detect_corners,
};
use glam::DVec2;

use super::corner::{Corner, Miss};
use super::front::front;

/// A board counts with so many of its corners.
const ENOUGH: f64 = 0.8;
/// So many corners more must lie in one place of the board than in the next one.
const CLEAR: usize = 3;
/// Black and white squares differ by so many grey values at least, on average.
const CONTRAST: f64 = 12.0;

/// Corners by column and row.
type Grid = BTreeMap<(i64, i64), DVec2>;

/// The detector of chessboards of any size.
pub fn detector() -> Result<ChessboardDetector, String> {
    ChessboardDetector::new(ChessboardParams::default()).map_err(|e| e.to_string())
}

/// The corners of a board of `corners` inner ones in a grey picture.
pub fn find(
    detector: &ChessboardDetector,
    corners: [u32; 2],
    grey: &[u8],
    size: [u32; 2],
) -> Result<Vec<Corner>, Miss> {
    let picture = GrayImageView {
        width: size[0] as usize,
        height: size[1] as usize,
        data: grey,
    };
    let cloud = detect_corners(&picture, &front());
    let mut miss = Miss::Nothing;
    for found in detector.detect_all(&cloud) {
        match whole(&right_handed(&found), corners) {
            Ok(grid) => return first_black(grid, corners, grey, size),
            Err(e) if miss == Miss::Nothing => miss = e,
            Err(_) => {}
        }
    }
    Err(miss)
}

/// The grid as found, x to the right of y from the front: a mirrored one is of nobody's board.
fn right_handed(found: &ChessboardDetection) -> Grid {
    let grid: Grid = found
        .corners
        .iter()
        .map(|c| {
            let at = (i64::from(c.grid.u), i64::from(c.grid.v));
            (at, DVec2::new(c.position.x.into(), c.position.y.into()))
        })
        .collect();
    let turn: f64 = grid
        .iter()
        .filter_map(|(&(u, v), p)| {
            let (right, down) = (*grid.get(&(u + 1, v))? - *p, *grid.get(&(u, v + 1))? - *p);
            Some(right.perp_dot(down))
        })
        .sum();
    if turn >= 0.0 {
        return grid;
    }
    grid.into_iter().map(|((u, v), p)| ((v, u), p)).collect()
}

/// The grid from 0, 0, long side as the board's, if it is the whole board. Corners that something beside the board
/// looks like are cut off.
fn whole(grid: &Grid, [columns, rows]: [u32; 2]) -> Result<Grid, Miss> {
    let (us, vs) = (|| grid.keys().map(|k| k.0), || grid.keys().map(|k| k.1));
    let (Some(left), Some(right)) = (us().min(), us().max()) else {
        return Err(Miss::Nothing);
    };
    let (Some(top), Some(bottom)) = (vs().min(), vs().max()) else {
        return Err(Miss::Nothing);
    };
    let found = [right - left + 1, bottom - top + 1];
    let wanted = [i64::from(columns), i64::from(rows)];
    // Upright, and turned by a quarter; of a square board that is the same.
    let ways = [wanted, [wanted[1], wanted[0]]];
    let ways = ways.into_iter().take(1 + usize::from(columns != rows));
    let windows = ways.enumerate().flat_map(|(turned, size)| {
        (0..=found[0] - size[0])
            .flat_map(move |u| (0..=found[1] - size[1]).map(move |v| (u, v)))
            .map(move |(u, v)| (turned == 1, size, (left + u, top + v)))
    });
    let inside = |size: [i64; 2], from: (i64, i64)| {
        grid.iter()
            .map(move |((u, v), p)| ((u - from.0, v - from.1), *p))
            .filter(move |((u, v), _)| (0..size[0]).contains(u) && (0..size[1]).contains(v))
    };
    let mut counted: Vec<_> = windows
        .map(|(turned, size, from)| (inside(size, from).count(), turned, size, from))
        .collect();
    counted.sort_by_key(|c| std::cmp::Reverse(c.0));
    let Some(&(most, turned, size, from)) = counted.first() else {
        return Err(Miss::Size(found[0] as u32, found[1] as u32));
    };
    // Between two places nobody can choose.
    let clear = counted.get(1).is_none_or(|second| second.0 + CLEAR <= most);
    if !clear || grid.len() > most + most / 5 {
        return Err(Miss::Size(found[0] as u32, found[1] as u32));
    }
    if (most as f64) < ENOUGH * f64::from(columns * rows) {
        return Err(Miss::Few(most));
    }
    // What goes down becomes x, what goes left becomes y.
    let place = |(u, v): (i64, i64)| if turned { (v, size[0] - 1 - u) } else { (u, v) };
    Ok(inside(size, from).map(|(at, p)| (place(at), p)).collect())
}

/// Corners of a grid such that the square right of and below the first one is black, as OpenCV draws boards.
fn first_black(
    grid: Grid,
    [columns, rows]: [u32; 2],
    grey: &[u8],
    size: [u32; 2],
) -> Result<Vec<Corner>, Miss> {
    let mut sums = [(0.0, 0.0); 2];
    for (&(u, v), p) in &grid {
        let others = [(u + 1, v), (u, v + 1), (u + 1, v + 1)].map(|k| grid.get(&k));
        let [Some(a), Some(b), Some(c)] = others else {
            continue;
        };
        let middle = (*p + *a + *b + *c) / 4.0;
        let (x, y) = (middle.x.round(), middle.y.round());
        if x >= 0.0 && y >= 0.0 && x < f64::from(size[0]) && y < f64::from(size[1]) {
            let (sum, count) = &mut sums[((u + v) % 2) as usize];
            *sum += f64::from(grey[y as usize * size[0] as usize + x as usize]);
            *count += 1.0;
        }
    }
    let [even, odd] = sums.map(|(sum, count)| sum / count);
    let contrast = (even - odd).abs();
    if contrast.is_nan() || contrast < CONTRAST {
        return Err(Miss::Pale);
    }
    let (last_u, last_v) = (i64::from(columns) - 1, i64::from(rows) - 1);
    let corner = |((u, v), pixel): ((i64, i64), DVec2)| {
        let (u, v) = if even > odd && (columns + rows) % 2 == 1 {
            (last_u - u, last_v - v)
        } else {
            (u, v)
        };
        Corner {
            place: DVec2::new(u as f64, v as f64),
            pixel,
        }
    };
    Ok(grid.into_iter().map(corner).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid(columns: i64, rows: i64) -> Grid {
        let all = (0..columns).flat_map(|u| (0..rows).map(move |v| (u, v)));
        all.map(|(u, v)| ((u, v), DVec2::new(u as f64, v as f64)))
            .collect()
    }

    #[test]
    fn the_board_is_found_whichever_way_it_lies() {
        assert_eq!(whole(&grid(9, 6), [9, 6]), Ok(grid(9, 6)));
        assert_eq!(whole(&grid(7, 7), [7, 7]), Ok(grid(7, 7)));
        // A quarter turn, not a mirror image.
        let turned = whole(&grid(6, 9), [9, 6]).unwrap();
        assert_eq!(turned[&(0, 0)], DVec2::new(5.0, 0.0));
        assert_eq!(turned[&(8, 0)], DVec2::new(5.0, 8.0));
        assert_eq!(turned[&(0, 5)], DVec2::new(0.0, 0.0));
    }

    #[test]
    fn what_lies_beside_the_board_is_cut_off_and_parts_are_refused() {
        let mut more = grid(9, 6);
        more.insert((3, -1), DVec2::ZERO);
        assert_eq!(whole(&more, [9, 6]), Ok(grid(9, 6)));
        assert_eq!(whole(&grid(9, 7), [9, 6]), Err(Miss::Size(9, 7)));
        assert_eq!(whole(&grid(8, 6), [9, 6]), Err(Miss::Size(8, 6)));
        let mut few = grid(9, 6);
        few.retain(|(u, v), _| *u == 0 || *v == 0 || *u == 8 || *v == 5);
        assert_eq!(whole(&few, [9, 6]), Err(Miss::Few(26)));
    }
}
