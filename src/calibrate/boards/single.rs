//! One camera alone: its pictures of the board go in, its lens and where the boards were come out.

use glam::{DMat3, DVec2};

use super::adjust::{Camera, Free, Scene, Seen, adjust};
use super::homography::homography;
use super::lens::{Lens, candidates};
use super::placement::Placement;
use super::plane_pose::placed;
use crate::calibrate::pose::Pose;

/// Pictures are put aside when their corners are so many pixels off …
const FAR_PX: f64 = 1.0;
/// … and so many times further than those of the median picture.
const FAR_TIMES: f64 = 4.0;
/// Radial coefficients that are always looked for, and at most.
const LEAST_RADIAL: usize = 1;
const MOST_RADIAL: usize = 3;
/// Rounds of adjustment, outliers counting less in each.
const ROUNDS: usize = 3;

/// A picture: places on the board, metres, and the pixels that show them.
pub type Corners = Vec<(DVec2, DVec2)>;

/// A camera by its own pictures.
#[derive(Debug, Clone)]
pub struct Single {
    /// Its lens.
    pub lens: Lens,
    /// How many of k1, k2, k3 its pictures tell; `None` for a lens that was given.
    pub radial: Option<usize>,
    /// Uncertainty of the focal length, as a share of it; 0 for a lens that was given.
    pub uncertain: f64,
    /// Picture by picture, the board in the camera's axes; `None` where it was put aside.
    pub boards: Vec<Option<Placement>>,
    /// How far corners of every picture are off, pixels.
    pub off: Vec<f64>,
}

/// The camera of these pictures of `size` pixels. `known`: its lens, where it is. `None` if no picture tells a pose.
pub fn single(pictures: &[Corners], size: [u32; 2], known: Option<Lens>) -> Option<Single> {
    let starts = match known {
        Some(lens) => vec![lens],
        None => {
            let maps: Vec<DMat3> = pictures.iter().filter_map(|p| homography(p)).collect();
            candidates(&maps, size)
        }
    };
    let loose = f64::from(size[0]) / 100.0;
    let least = known.is_none().then_some(LEAST_RADIAL);
    let all = starts
        .into_iter()
        .filter_map(|lens| settled(pictures, lens, least, loose));
    let worth = |s: &Single| median(s.off.clone());
    let mut best = all.min_by(|a, b| worth(a).total_cmp(&worth(b)))?;
    while let Some(radial) = best.radial.filter(|r| *r < MOST_RADIAL) {
        let Some(more) = settled(pictures, best.lens, Some(radial + 1), loose) else {
            break;
        };
        if !tells(&best, &more, pictures) {
            break;
        }
        best = more;
    }
    Some(best)
}

/// Whether one coefficient more is demanded by corners, not by their noise (Schwarz's criterion): one that is not
/// needed bends the lens where no board was.
fn tells(less: &Single, more: &Single, pictures: &[Corners]) -> bool {
    let used = |s: &Single| s.boards.iter().flatten().count();
    // A picture near the edge may be the only one that shows what the lens does there.
    if used(more) != used(less) {
        return used(more) > used(less);
    }
    let (mut corners, mut squares) = (0.0, [0.0; 2]);
    for (k, picture) in pictures.iter().enumerate() {
        if less.boards[k].is_some() && more.boards[k].is_some() {
            let count = picture.len() as f64;
            corners += count;
            squares[0] += count * less.off[k] * less.off[k];
            squares[1] += count * more.off[k] * more.off[k];
        }
    }
    // Two coordinates a corner.
    let numbers = 2.0 * corners;
    numbers * f64::ln(squares[0] / squares[1]) > f64::ln(numbers)
}

fn settled(pictures: &[Corners], lens: Lens, radial: Option<usize>, loose: f64) -> Option<Single> {
    let mut found = Single {
        lens,
        radial,
        uncertain: f64::INFINITY,
        boards: Vec::new(),
        off: Vec::new(),
    };
    found.boards = pictures
        .iter()
        .map(|p| Some(placed(&lens, p, loose)?.0))
        .collect();
    refine(&mut found, pictures, loose)?;
    // By the lens as it is now, the other side of a board may fit better.
    for (board, picture) in found.boards.iter_mut().zip(pictures) {
        *board = placed(&found.lens, picture, loose).map(|b| b.0);
    }
    refine(&mut found, pictures, loose)?;
    let far = limit(&found.off);
    let mut aside = false;
    for (board, off) in found.boards.iter_mut().zip(&found.off) {
        if *off > far && board.take().is_some() {
            aside = true;
        }
    }
    if aside {
        let off = found.off.clone();
        refine(&mut found, pictures, loose)?;
        for ((now, before), board) in found.off.iter_mut().zip(off).zip(&found.boards) {
            if board.is_none() {
                *now = before;
            }
        }
    }
    Some(found)
}

/// What is further off is another board, or none.
pub fn limit(off: &[f64]) -> f64 {
    let known: Vec<f64> = off.iter().copied().filter(|o| o.is_finite()).collect();
    (FAR_TIMES * median(known)).max(FAR_PX)
}

/// Moves lens and boards.
fn refine(found: &mut Single, pictures: &[Corners], loose: f64) -> Option<()> {
    let used: Vec<usize> = (0..pictures.len())
        .filter(|k| found.boards[*k].is_some())
        .collect();
    if used.is_empty() {
        return None;
    }
    let mut scene = Scene {
        cameras: vec![Camera {
            lens: found.lens,
            pose: Pose::ORIGIN,
        }],
        boards: used.iter().filter_map(|k| found.boards[*k]).collect(),
    };
    let corners = used.iter().enumerate().flat_map(|(board, k)| {
        let one = move |(place, pixel): &(DVec2, DVec2)| Seen {
            camera: 0,
            board,
            place: *place,
            pixel: *pixel,
        };
        pictures[*k].iter().map(one)
    });
    let seen: Vec<Seen> = corners.collect();
    let moves = Free {
        lens: found.radial,
        pose: false,
    };
    let share = settle(&mut scene, &[moves], &seen, loose);
    found.uncertain = share[0];
    found.lens = scene.cameras[0].lens;
    found.off = vec![f64::INFINITY; pictures.len()];
    for (board, k) in used.iter().enumerate() {
        found.boards[*k] = Some(scene.boards[board]);
        let of_it = seen.iter().filter(|s| s.board == board);
        found.off[*k] = rms(of_it.map(|s| scene.off(s).length_squared()));
    }
    Some(())
}

/// Adjusts until outliers count little by the measure of the others; uncertainties of focal lengths, as shares.
pub fn settle(scene: &mut Scene, free: &[Free], seen: &[Seen], loose: f64) -> Vec<f64> {
    let mut sigma = loose;
    let mut shares = Vec::new();
    for _ in 0..ROUNDS {
        shares = adjust(scene, free, seen, sigma);
        let off = seen.iter().map(|s| scene.off(s).length()).collect();
        // The median of a Rayleigh distribution is 1.18 of its scale; 2.4 times that keeps 95 % of the efficiency.
        let noise = (median(off) / 1.18).clamp(0.02, loose);
        sigma = 2.4 * noise;
        shares.iter_mut().for_each(|s| *s *= noise);
    }
    shares
}

/// Root mean square of what has these squares.
pub fn rms(squares: impl Iterator<Item = f64>) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for square in squares {
        sum += square;
        count += 1.0;
    }
    f64::sqrt(sum / count)
}

/// The middle one; infinite for none.
pub fn median(mut values: Vec<f64>) -> f64 {
    let middle = values.len() / 2;
    if values.is_empty() {
        return f64::INFINITY;
    }
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}
