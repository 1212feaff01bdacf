//! The experiments: pieces by number of cameras, by whose 2D it is and whether paths are smooth.

use std::collections::BTreeSet;
use std::sync::Mutex;

use rayon::prelude::*;

use super::archive::{CAMERAS, HumanEva, HumanEvaError, Piece};
use super::cameras::{self, FittedCamera};
use super::compare::{Distances, Offsets, Pair};
use super::report::{CameraLine, HumanEvaTables, Line, Spread};
use super::trial::{Source, found, lifter};
use crate::camera::View;
use crate::lift::Lifter;

/// Cameras that are used together; those of one number are one line.
const SETS: [&[usize]; 7] = [&[0], &[1], &[2], &[0, 1], &[0, 2], &[1, 2], &[0, 1, 2]];

/// How much is tried.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct HumanEvaOptions {
    /// Pieces with fewer frames that all cameras saw are left out.
    pub least: usize,
    /// Frames of a piece at most, from its first on.
    pub most: usize,
}

impl HumanEvaOptions {
    /// Of so many frames a piece at most: whoever asks for few gets pieces of as few.
    pub fn of_frames(most: usize) -> Self {
        let whole = Self::default();
        Self {
            least: whole.least.min(most),
            most,
        }
    }
}

impl Default for HumanEvaOptions {
    /// A window of stage two at least, whole pieces.
    fn default() -> Self {
        Self {
            least: 30,
            most: usize::MAX,
        }
    }
}

/// What one piece gave with one set of cameras.
struct Outcome {
    subject: String,
    piece: usize,
    wanted: usize,
    pairs: Vec<Pair>,
}

/// Finds the cameras and runs all experiments, those of one camera where this build has weights that lift what it sees.
/// `progress` hears of every fit that is done, out of how many.
///
/// # Errors
/// When no piece is long enough, or points do not tell a camera.
pub fn tables(
    data: &HumanEva,
    options: HumanEvaOptions,
    progress: &(dyn Fn(u64, u64) + Sync),
) -> Result<HumanEvaTables, HumanEvaError> {
    tables_by(lifter().as_ref(), data, options, progress)
}

/// As [`tables`]; without a lifter there are no experiments of one camera.
///
/// # Errors
/// As there.
pub fn tables_by(
    lifter: Option<&Lifter>,
    data: &HumanEva,
    options: HumanEvaOptions,
    progress: &(dyn Fn(u64, u64) + Sync),
) -> Result<HumanEvaTables, HumanEvaError> {
    let chosen = |source: Source| -> Vec<(usize, &Piece)> {
        let all = data.pieces.iter().enumerate();
        all.filter(|(_, p)| source.whole(p, source.span(p, options.most)) >= options.least)
            .collect()
    };
    let sources = [Source::Exact, Source::Detected].map(|s| (s, chosen(s)));
    let count: usize = sources.iter().map(|(_, pieces)| pieces.len()).sum();
    if count == 0 {
        return Err(HumanEvaError::Short(options.least));
    }
    let cameras = cameras::all(data)?;
    let fewest = if lifter.is_some() { 1 } else { 2 };
    let sets = SETS.iter().filter(|set| set.len() >= fewest).count();
    let (done, total) = (Mutex::new(0), (2 * sets * count) as u64);
    let mut lines = Vec::new();
    for (source, pieces) in &sources {
        for views in fewest..=CAMERAS {
            for paths in [false, true] {
                let sets = SETS.iter().filter(|s| s.len() == views);
                let all: Vec<Vec<Outcome>> = sets
                    .map(|set| {
                        let each = pieces.par_iter().map(|&(number, piece)| {
                            let frames = source.span(piece, options.most);
                            let seen_by: Vec<View> =
                                set.iter().map(|c| camera(&cameras, piece, *c)).collect();
                            let result = Outcome {
                                subject: piece.subject().to_owned(),
                                piece: number,
                                wanted: source.whole(piece, frames.clone()),
                                pairs: found(
                                    piece,
                                    frames,
                                    (&seen_by, set),
                                    *source,
                                    paths,
                                    lifter,
                                ),
                            };
                            let mut done = done.lock().unwrap_or_else(|e| e.into_inner());
                            *done += 1;
                            progress(*done, total);
                            result
                        });
                        each.collect()
                    })
                    .collect();
                lines.push(line(*source, views, paths, &all));
            }
        }
    }
    Ok(HumanEvaTables {
        cameras: cameras
            .iter()
            .map(|c| CameraLine {
                name: c.view.name.clone(),
                rms_px: c.rms_px,
            })
            .collect(),
        least: options.least,
        is_lifted: lifter.is_some(),
        lines,
    })
}

fn camera(cameras: &[FittedCamera], piece: &Piece, number: usize) -> View {
    let mut own = cameras.iter().filter(|c| c.subject == piece.subject());
    let found = own.nth(number).expect("every person has cameras");
    found.view.clone()
}

/// Means of all sets by piece, then over pieces.
fn line(source: Source, views: usize, paths: bool, sets: &[Vec<Outcome>]) -> Line {
    let pieces: BTreeSet<usize> = sets.iter().flatten().map(|r| r.piece).collect();
    let mut all: Vec<(usize, Distances)> = Vec::new();
    for set in sets {
        for result in set.iter().filter(|r| !r.pairs.is_empty()) {
            let others = set.iter().filter(|r| r.subject != result.subject);
            let offsets = Offsets::learn(others.flat_map(|r| &r.pairs));
            let distances = Distances::new(&result.pairs, offsets.as_ref());
            all.push((result.piece, distances));
        }
    }
    let spread = |of: &dyn Fn(&Distances) -> Option<f64>| {
        let of_piece = |p: &usize| {
            let own = all.iter().filter(|(k, _)| k == p);
            let own: Vec<f64> = own.filter_map(|(_, d)| of(d)).collect();
            (!own.is_empty()).then(|| own.iter().sum::<f64>() / own.len() as f64)
        };
        Spread::new(&pieces.iter().filter_map(of_piece).collect::<Vec<f64>>())
    };
    let wanted: usize = sets.iter().flatten().map(|r| r.wanted).sum();
    let met: usize = sets.iter().flatten().map(|r| r.pairs.len()).sum();
    Line {
        detected: source == Source::Detected,
        views,
        paths,
        pieces: pieces.len(),
        frames: wanted / sets.len().max(1),
        found: met as f64 / wanted.max(1) as f64,
        named: spread(&|d| Some(d.named)),
        limbs: spread(&|d| Some(d.limbs)),
        named_aligned: spread(&|d| Some(d.named_aligned)),
        mapped: spread(&|d| d.mapped.map(|m| m[0])),
        mapped_aligned: spread(&|d| d.mapped.map(|m| m[1])),
    }
}
