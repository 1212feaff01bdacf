//! When who moved how fast: joint speeds of two views go in, the lags at which they are alike come out.

use super::trails::Trail;
use crate::joints::{EVIDENCE_JOINTS, MIRROR};

/// Seconds between samples of the speeds.
pub const STEP: f64 = 0.02;
/// Least common time of two views, seconds, and as a share of the shorter.
const COMMON: [f64; 2] = [1.0, 0.3];

/// Speeds of joints in one view over time, both sides of the body and all people together.
pub struct Speeds {
    /// Time of the first sample, seconds.
    start: f64,
    /// Sums of speeds; of a joint and of its mirror image under the lower number.
    samples: Vec<[f64; EVIDENCE_JOINTS]>,
}

impl Speeds {
    /// Of everybody whom a view follows from `start` to `end`, seconds.
    pub fn new(trails: &[Trail], start: f64, end: f64) -> Self {
        let count = ((end - start) / STEP).max(0.0) as usize + 1;
        let mut samples = vec![[0.0; EVIDENCE_JOINTS]; count];
        for trail in trails {
            for (k, pair) in trail.times.windows(2).enumerate() {
                let from = ((pair[0] - start) / STEP).ceil().max(0.0) as usize;
                let to = (((pair[1] - start) / STEP).ceil().max(0.0) as usize).min(count);
                for (s, sample) in samples.iter_mut().enumerate().take(to).skip(from) {
                    let share = (start + s as f64 * STEP - pair[0]) / (pair[1] - pair[0]);
                    for j in 0..EVIDENCE_JOINTS {
                        if let (Some(a), Some(b)) = (trail.speeds[k][j], trail.speeds[k + 1][j]) {
                            sample[j.min(MIRROR[j])] += a + share * (b - a);
                        }
                    }
                }
            }
        }
        Self { start, samples }
    }

    /// Pearson's correlation of all speeds with another view's, that view's clock being ahead by `lag` samples beyond
    /// the starts; `None` where too little is common.
    fn correlation(&self, other: &Self, lag: isize) -> Option<f64> {
        let (n, m) = (self.samples.len() as isize, other.samples.len() as isize);
        let (from, to) = ((-lag).max(0), (m - lag).min(n));
        let least = (COMMON[0] / STEP).max(COMMON[1] * n.min(m) as f64);
        if ((to - from) as f64) < least {
            return None;
        }
        let (mut both, mut own, mut others) = (0.0, 0.0, 0.0);
        for j in 0..EVIDENCE_JOINTS {
            let (mut a, mut b, mut aa, mut bb, mut ab) = (0.0, 0.0, 0.0, 0.0, 0.0);
            for s in from..to {
                let x = self.samples[s as usize][j];
                let y = other.samples[(s + lag) as usize][j];
                a += x;
                b += y;
                aa += x * x;
                bb += y * y;
                ab += x * y;
            }
            let count = (to - from) as f64;
            both += ab - a * b / count;
            own += aa - a * a / count;
            others += bb - b * b / count;
        }
        let scale = (own * others).sqrt();
        (scale > 1e-12).then(|| both / scale)
    }

    /// Offsets of the other view's clock, at most `most` seconds, at which speeds are more alike than just before and
    /// after: the likest first.
    pub fn alike(&self, other: &Self, most: f64) -> Vec<f64> {
        let beyond = ((self.start - other.start) / STEP).round() as isize;
        let reach = (most / STEP) as isize;
        let all: Vec<(f64, Option<f64>)> = (-reach..=reach)
            .map(|lag| {
                let offset = lag as f64 * STEP;
                (offset, self.correlation(other, lag + beyond))
            })
            .collect();
        let mut peaks: Vec<(f64, f64)> = (0..all.len())
            .filter_map(|k| {
                let (offset, own) = (all[k].0, all[k].1?);
                let near = [k.checked_sub(1), Some(k + 1)].into_iter().flatten();
                let is_peak = near
                    .filter_map(|n| all.get(n)?.1)
                    .all(|beside| beside <= own);
                is_peak.then_some((own, offset))
            })
            .collect();
        peaks.sort_by(|a, b| b.0.total_cmp(&a.0));
        peaks.into_iter().map(|(_, offset)| offset).collect()
    }
}
