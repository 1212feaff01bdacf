//! Heatmaps go in, joint candidates with sub-cell positions come out.

use edgecap_client::joints::{EVIDENCE_JOINTS, NECK};

use super::AssociationConfig;
use crate::engine::{HEAD2D_CHANNELS, Maps};

/// A local maximum of one joint's heatmap.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Peak {
    /// Column, cells, sub-cell.
    pub x: f32,
    /// Row, cells, sub-cell.
    pub y: f32,
    /// Heatmap value at the cell.
    pub score: f32,
    /// Index of the cell, row-major.
    pub cell: usize,
}

/// Candidates of every joint, highest first.
#[derive(Debug, Clone, Default)]
pub(crate) struct Peaks {
    lists: [Vec<Peak>; EVIDENCE_JOINTS],
}

impl Peaks {
    /// Candidates of one joint.
    pub fn of(&self, joint: usize) -> &[Peak] {
        &self.lists[joint]
    }

    /// Replaces the candidates by those of `maps`.
    pub fn find(&mut self, maps: &Maps, config: &AssociationConfig) {
        for list in &mut self.lists {
            list.clear();
        }
        let mut threshold = [config.joint_threshold; EVIDENCE_JOINTS];
        threshold[NECK] = config.neck_threshold;
        for (cell, values) in maps.head2d.chunks_exact(HEAD2D_CHANNELS).enumerate() {
            for (joint, &t) in threshold.iter().enumerate() {
                let v = values[joint];
                if v > t && v.is_finite() && is_maximum(maps, joint, cell, v) {
                    self.lists[joint].push(refined(maps, joint, cell, v));
                }
            }
        }
        for list in &mut self.lists {
            list.sort_unstable_by(|a, b| b.score.total_cmp(&a.score).then(a.cell.cmp(&b.cell)));
            list.truncate(config.max_peaks);
        }
    }
}

fn at(maps: &Maps, joint: usize, cell: usize) -> f32 {
    maps.head2d[cell * HEAD2D_CHANNELS + joint]
}

/// No neighbour is higher, and none of those that come earlier is as high: a plateau counts once.
fn is_maximum(maps: &Maps, joint: usize, cell: usize, v: f32) -> bool {
    let (row, column) = (cell / maps.width, cell % maps.width);
    for r in row.saturating_sub(1)..=(row + 1).min(maps.height - 1) {
        for c in column.saturating_sub(1)..=(column + 1).min(maps.width - 1) {
            let other = r * maps.width + c;
            let n = at(maps, joint, other);
            if n > v || (n == v && other < cell) {
                return false;
            }
        }
    }
    true
}

/// Position of the maximum of the parabola through the logarithms of three neighbours, along each axis.
///
/// The training target is a Gaussian, whose logarithm is a parabola: this is exact for it, where a parabola through the
/// values themselves would be pulled to the cell's centre by up to a tenth of a cell.
fn refined(maps: &Maps, joint: usize, cell: usize, score: f32) -> Peak {
    let (row, column) = (cell / maps.width, cell % maps.width);
    let level = |cell: usize| {
        // Targets end at 0.01; NaN counts as nothing, too.
        at(maps, joint, cell).max(0.01).ln()
    };
    let offset = |before: usize, after: usize| {
        let (a, b, c) = (level(before), level(cell), level(after));
        let bend = a - 2.0 * b + c;
        if bend < -1e-6 {
            (0.5 * (a - c) / bend).clamp(-0.5, 0.5)
        } else {
            0.0
        }
    };
    let dx = if column > 0 && column + 1 < maps.width {
        offset(cell - 1, cell + 1)
    } else {
        0.0
    };
    let dy = if row > 0 && row + 1 < maps.height {
        offset(cell - maps.width, cell + maps.width)
    } else {
        0.0
    };
    Peak {
        x: column as f32 + dx,
        y: row as f32 + dy,
        score,
        cell,
    }
}
