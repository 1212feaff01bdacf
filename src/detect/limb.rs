//! Part affinity field and two joint candidates go in, how well they make a limb comes out. Cao et al. 2017; XNect
//! §4.1.1.

use edgecap_client::joints::{EVIDENCE_JOINTS, LIMBS};

use super::AssociationConfig;
use super::peaks::Peak;
use crate::engine::{HEAD2D_CHANNELS, Maps};

/// Length of each limb of a standing person over the stature, from body proportions of adults (neck to head top, to
/// shoulder, upper arm, forearm, neck to hip, thigh, shin). Used only to tell the absurd from the possible.
pub(crate) const PROPORTION: [f32; LIMBS] = [
    0.18, 0.11, 0.17, 0.15, 0.11, 0.17, 0.15, 0.31, 0.24, 0.24, 0.31, 0.24, 0.24,
];

const MIN_SAMPLES: usize = 10;
const MAX_SAMPLES: usize = 40;
/// Below this length in cells a direction means nothing: a limb along the viewing ray.
const POINT_LENGTH: f32 = 0.7;

/// Distance of two candidates, cells.
pub(crate) fn length(child: &Peak, parent: &Peak) -> f32 {
    (parent.x - child.x).hypot(parent.y - child.y)
}

/// Mean of the field's component from `child` to `parent` over the line between them, less a penalty for lines longer
/// than half the map; `None` when it is below the threshold or holds on too small a part of the line.
pub(crate) fn score(
    maps: &Maps,
    limb: usize,
    child: &Peak,
    parent: &Peak,
    config: &AssociationConfig,
) -> Option<f32> {
    let (dx, dy) = (parent.x - child.x, parent.y - child.y);
    let length = dx.hypot(dy);
    if length < POINT_LENGTH {
        let [x, y] = sample(maps, limb, child.x + 0.5 * dx, child.y + 0.5 * dy);
        let strength = x.hypot(y);
        // Both joints in one cell are evidence of their own; a field that agrees adds to it.
        return strength
            .is_finite()
            .then(|| strength.clamp(config.limb_threshold, 1.0));
    }
    let samples = (length.ceil() as usize).clamp(MIN_SAMPLES, MAX_SAMPLES);
    let (ux, uy) = (dx / length, dy / length);
    let (mut sum, mut passed) = (0.0, 0);
    for k in 0..samples {
        let t = (k as f32 + 0.5) / samples as f32;
        let [x, y] = sample(maps, limb, child.x + t * dx, child.y + t * dy);
        let along = x * ux + y * uy;
        sum += along;
        if along > 0.5 * config.limb_threshold {
            passed += 1;
        }
    }
    let mean = sum / samples as f32;
    let half = 0.5 * maps.width.max(maps.height) as f32;
    let score = mean + (half / length - 1.0).min(0.0);
    (score > config.limb_threshold
        && score.is_finite()
        && passed as f32 >= config.pass_ratio * samples as f32)
        .then_some(score)
}

/// The field of `limb` at a place in cells, bilinear; the place is inside the map up to rounding.
fn sample(maps: &Maps, limb: usize, x: f32, y: f32) -> [f32; 2] {
    let x = x.clamp(0.0, (maps.width - 1) as f32);
    let y = y.clamp(0.0, (maps.height - 1) as f32);
    let (column, row) = (x as usize, y as usize);
    let (fx, fy) = (x - column as f32, y - row as f32);
    let right = (column + 1).min(maps.width - 1);
    let below = (row + 1).min(maps.height - 1);
    let read = |r: usize, c: usize| {
        let i = (r * maps.width + c) * HEAD2D_CHANNELS + EVIDENCE_JOINTS + 2 * limb;
        [maps.head2d[i], maps.head2d[i + 1]]
    };
    let (a, b) = (read(row, column), read(row, right));
    let (c, d) = (read(below, column), read(below, right));
    let mix = |i: usize| {
        let top = a[i] + fx * (b[i] - a[i]);
        let bottom = c[i] + fx * (d[i] - c[i]);
        top + fy * (bottom - top)
    };
    [mix(0), mix(1)]
}
