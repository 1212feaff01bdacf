//! How much joints shake: mean acceleration of 3D joints.

use std::collections::BTreeMap;

use edgecap_client::joints::BODY_JOINTS;

use super::geometry::{Point, minus, norm, plus};

/// Joints of one track at one time.
type Sample = (u64, f64, [Point; BODY_JOINTS]);

/// Gathers tracks frame by frame; each is known by a key.
#[derive(Debug, Clone, Default)]
pub struct Jitter<K> {
    tracks: BTreeMap<K, Vec<Sample>>,
    sum: f64,
    count: usize,
}

impl<K: Ord> Jitter<K> {
    /// Adds one person: frame index, time in seconds, joints in metres. Frames of a track come in order; a gap starts
    /// it anew, as do equal times.
    pub fn add(&mut self, track: K, frame: u64, seconds: f64, joints: &[[f64; 3]; BODY_JOINTS]) {
        let samples = self.tracks.entry(track).or_default();
        if samples
            .last()
            .is_some_and(|s| s.0 + 1 != frame || s.1 >= seconds)
        {
            samples.clear();
        }
        samples.push((frame, seconds, *joints));
        if samples.len() > 3 {
            samples.remove(0);
        }
        if let [a, b, c] = &samples[..] {
            let (before, after) = (b.1 - a.1, c.1 - b.1);
            for j in 0..BODY_JOINTS {
                // Second difference for unequal steps.
                let first = minus(b.2[j], a.2[j]).map(|x| x / before);
                let second = minus(c.2[j], b.2[j]).map(|x| x / after);
                self.sum += norm(plus(second, -1.0, first)) / (0.5 * (before + after));
                self.count += 1;
            }
        }
    }

    /// Mean norm of the acceleration, m/s²; `None` before any track had three frames in a row.
    pub fn mean(&self) -> Option<f64> {
        (self.count > 0).then(|| self.sum / self.count as f64)
    }
}
