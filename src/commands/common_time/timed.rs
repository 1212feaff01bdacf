//! One view on the clock of all: who was seen at any instant.

use crate::commands::view_file::ViewFile;
use crate::message::Observation;
use crate::multiview::between;

/// Frames nearer than this are of one instant, seconds.
pub const SAME: f64 = 1e-3;
/// Longest time between two frames that is interpolated, in frames.
const GAP: f64 = 4.0;
/// Rate of views whose files tell no times.
pub const USUAL_RATE: f64 = 30.0;

/// A view, and when its frames were on the clock of all.
pub struct Timed<'a> {
    /// The view.
    pub file: &'a ViewFile,
    /// Frames a second.
    pub rate: f64,
    /// When every frame was, seconds after the first view's start, rising.
    pub seconds: Vec<f64>,
}

impl<'a> Timed<'a> {
    /// A view that started `shift` seconds before the first one; it tells its times.
    pub fn new(file: &'a ViewFile, shift: f64) -> Self {
        let seconds = |t: &u64| (t - file.times[0]) as f64 * 1e-9 - shift;
        Self {
            file,
            rate: file.rate().unwrap_or(USUAL_RATE),
            seconds: file.times.iter().map(seconds).collect(),
        }
    }

    /// When its last frame was, seconds after the first view's start.
    pub fn end(&self) -> f64 {
        self.seconds[self.seconds.len() - 1]
    }

    /// The frame nearest to an instant.
    pub fn nearest(&self, now: f64) -> usize {
        let next = self.seconds.partition_point(|t| *t <= now);
        let near = [next.saturating_sub(1), next.min(self.seconds.len() - 1)];
        let off = |k: usize| (self.seconds[k] - now).abs();
        if off(near[0]) <= off(near[1]) {
            near[0]
        } else {
            near[1]
        }
    }

    /// Who was seen at an instant; nobody where frames are too far from it.
    pub fn at(&self, now: f64) -> Vec<Observation> {
        let off = |k: usize| (self.seconds[k] - now).abs();
        let nearest = self.nearest(now);
        let frames = &self.file.frames;
        if off(nearest) < SAME {
            return frames[nearest].clone();
        }
        let next = self.seconds.partition_point(|t| *t <= now);
        if next == 0 || next == frames.len() {
            return Vec::new();
        }
        let step = self.seconds[next] - self.seconds[next - 1];
        if step > GAP / self.rate {
            return Vec::new();
        }
        let other = if nearest == next { next - 1 } else { next };
        between(&frames[nearest], &frames[other], off(nearest) / step, step)
    }
}
