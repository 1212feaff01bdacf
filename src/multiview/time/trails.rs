//! People followed in one view: detections frame by frame go in, smooth paths of joints on the plane z = 1 come out.

use glam::DVec2;

use super::interval;
use crate::assignment::Matcher;
use crate::joints::{EVIDENCE_JOINTS, MIRROR};
use crate::multiview::sight::{Plane, Sight, like};

/// Farthest somebody goes from frame to frame, as a share of their size.
const STRAY: f64 = 0.25;
/// Shared joints under which two detections cannot be compared.
const LEAST_SHARED: usize = 4;
/// Seconds for which somebody may be missed, and frames where that are more.
const MISSED: (f64, usize) = (0.1, 3);
/// Seconds between two frames after which nobody is followed any more, however few frames lie between.
const HOLE: f64 = 5.0;
/// Frames of the shortest path that tells anything.
const SHORTEST: usize = 8;
/// Standard deviation of the smoothing, frames. Both views are smoothed alike, else noise, which interpolation lessens,
/// would draw every offset to the middle between two frames.
const SMOOTH: f64 = 1.5;

/// A joint moves that goes so many times as far as its noise, and this share of the person's size, in so many seconds.
const FARTHER: f64 = 2.0;
const LEAST_WAY: f64 = 0.002;
const MOMENT: f64 = 0.3;
/// So many joints move of somebody who does.
const LEAST_MOVING: usize = 2;

/// The joints of one person in one frame, where seen.
pub type Joints = Plane;

/// One person over time.
#[derive(Debug, Clone)]
pub struct Trail {
    /// Seconds, rising.
    pub times: Vec<f64>,
    /// Smooth places.
    pub joints: Vec<Joints>,
    /// Smooth velocities, in sizes of the person a second.
    pub speeds: Vec<[Option<f64>; EVIDENCE_JOINTS]>,
    /// Longest time between two frames of which what lies between is known.
    gap: f64,
    /// Typical size of the person.
    size: f64,
    /// Joints that go farther than a detector's noise makes them seem to.
    moving: usize,
}

impl Trail {
    /// Of nobody's joints at so many times, seconds.
    #[cfg(test)]
    pub fn still(times: [f64; 2]) -> Self {
        Self {
            times: times.into(),
            joints: vec![[None; EVIDENCE_JOINTS]; 2],
            speeds: vec![[None; EVIDENCE_JOINTS]; 2],
            gap: 1.0,
            size: 1.0,
            moving: 0,
        }
    }

    /// Whether somebody moves, and no mere noise.
    pub fn moves(&self) -> bool {
        self.moving >= LEAST_MOVING
    }

    /// The first time and the last, seconds.
    pub fn span(&self) -> [f64; 2] {
        [self.times[0], self.times[self.times.len() - 1]]
    }

    /// Joints at a time, along straight lines between frames.
    pub fn at(&self, time: f64) -> Option<Joints> {
        let next = self.times.partition_point(|t| *t <= time);
        let (before, after) = match (next.checked_sub(1), self.times.get(next)) {
            (Some(b), Some(_)) => (b, next),
            (Some(b), None) if self.times[b] == time => (b, b),
            _ => return None,
        };
        let step = self.times[after] - self.times[before];
        if step > self.gap {
            return None;
        }
        let share = if step > 0.0 {
            (time - self.times[before]) / step
        } else {
            0.0
        };
        let (p, q) = (&self.joints[before], &self.joints[after]);
        Some(std::array::from_fn(|j| Some(p[j]?.lerp(q[j]?, share))))
    }
}

struct Raw {
    frames: Vec<usize>,
    joints: Vec<Joints>,
}

/// Frames for which somebody may be missed.
fn missed(times: &[f64]) -> usize {
    let step = interval(times);
    let frames = match step > 0.0 {
        true => (MISSED.0 / step).round() as usize,
        false => 0,
    };
    frames.max(MISSED.1)
}

/// Follows everybody; `times` in seconds, rising.
pub fn trails(times: &[f64], frames: &[Vec<Sight>]) -> Vec<Trail> {
    let missed = missed(times);
    let mut matcher = Matcher::default();
    let (mut open, mut done): (Vec<Raw>, Vec<Raw>) = (Vec::new(), Vec::new());
    for (f, seen) in frames.iter().enumerate() {
        let seen: Vec<Joints> = seen
            .iter()
            .map(|s| s.rays.map(|r| Some(r?.plane)))
            .collect();
        let is_open = |raw: &Raw| {
            let last = raw.frames.last();
            last.is_some_and(|&l| f - l <= missed && times[f] - times[l] <= HOLE)
        };
        let (still, over): (Vec<Raw>, Vec<Raw>) = open.into_iter().partition(is_open);
        open = still;
        done.extend(over);
        let scores: Vec<f32> = open
            .iter()
            .flat_map(|raw| {
                let last = raw.joints.last().copied().unwrap_or_default();
                let reach = STRAY * size(&last);
                seen.iter().map(move |s| match apart(&last, s) {
                    Some(d) if d < reach => (1.0 - d / reach).max(1e-3) as f32,
                    _ => 0.0,
                })
            })
            .collect();
        let pairs = matcher.solve(open.len(), seen.len(), &scores).to_vec();
        let mut free = vec![true; seen.len()];
        for (raw, pair) in open.iter_mut().zip(pairs) {
            if let Some(k) = pair {
                let told = like(&raw.joints[raw.joints.len() - 1], &seen[k], 1.0);
                raw.frames.push(f);
                raw.joints.push(told);
                free[k] = false;
            }
        }
        for (joints, _) in seen.iter().zip(&free).filter(|(_, free)| **free) {
            open.push(Raw {
                frames: vec![f],
                joints: vec![*joints],
            });
        }
    }
    done.extend(open);
    done.iter()
        .filter(|raw| raw.frames.len() >= SHORTEST)
        .filter_map(|raw| smooth(times, raw, missed))
        .collect()
}

/// A line through every joint's places near each frame, weighted by a Gaussian: its value and its slope there.
/// `missed`: frames for which somebody may be missed.
fn smooth(times: &[f64], raw: &Raw, missed: usize) -> Option<Trail> {
    let at: Vec<f64> = raw.frames.iter().map(|f| times[*f]).collect();
    let interval =
        (at[at.len() - 1] - at[0]) / (raw.frames[raw.frames.len() - 1] - raw.frames[0]) as f64;
    let mut sizes: Vec<f64> = raw.joints.iter().map(size).collect();
    sizes.sort_by(f64::total_cmp);
    let typical = sizes[sizes.len() / 2];
    if !(interval > 0.0 && typical > 0.0) {
        return None;
    }
    let sigma = SMOOTH * interval;
    let mut trail = Trail {
        joints: vec![[None; EVIDENCE_JOINTS]; at.len()],
        speeds: vec![[None; EVIDENCE_JOINTS]; at.len()],
        gap: (missed as f64 + 1.5) * interval,
        times: at,
        size: typical,
        moving: 0,
    };
    for k in 0..trail.times.len() {
        let now = trail.times[k];
        let from = trail.times.partition_point(|t| *t < now - 3.0 * sigma);
        let to = trail.times.partition_point(|t| *t <= now + 3.0 * sigma);
        for j in 0..EVIDENCE_JOINTS {
            if raw.joints[k][j].is_none() {
                continue;
            }
            // Sums of w, w·t, w·t², w·p and w·t·p about now.
            let (mut w0, mut w1, mut w2) = (0.0, 0.0, 0.0);
            let (mut p0, mut p1) = (DVec2::ZERO, DVec2::ZERO);
            for i in from..to {
                let Some(p) = raw.joints[i][j] else {
                    continue;
                };
                let t = trail.times[i] - now;
                let w = (-0.5 * (t / sigma).powi(2)).exp();
                w0 += w;
                w1 += w * t;
                w2 += w * t * t;
                p0 += w * p;
                p1 += w * t * p;
            }
            let determinant = w0 * w2 - w1 * w1;
            if determinant < 1e-3 * w0 * w0 * sigma * sigma {
                continue;
            }
            trail.joints[k][j] = Some((w2 * p0 - w1 * p1) / determinant);
            let slope = (w0 * p1 - w1 * p0) / determinant;
            trail.speeds[k][j] = Some(slope.length() / typical);
        }
    }
    trail.moving = (0..EVIDENCE_JOINTS)
        .filter(|&j| is_moving(&trail, raw, j))
        .count();
    Some(trail)
}

/// Whether a joint goes farther in a moment than what was seen of it lies from its smooth path. Medians: some of it
/// lies anywhere.
fn is_moving(trail: &Trail, raw: &Raw, joint: usize) -> bool {
    let noise = trail.joints.iter().zip(&raw.joints);
    let noise = median(noise.filter_map(|(p, q)| Some(p[joint]?.distance(q[joint]?))));
    let later = |t: f64| trail.at(t + MOMENT)?[joint];
    let ways = trail.times.iter().zip(&trail.joints);
    let way = median(ways.filter_map(|(t, p)| Some(p[joint]?.distance(later(*t)?))));
    match (noise, way) {
        (Some(noise), Some(way)) => way > (FARTHER * noise).max(LEAST_WAY * trail.size),
        _ => false,
    }
}

fn median(values: impl Iterator<Item = f64>) -> Option<f64> {
    let mut all: Vec<f64> = values.collect();
    all.sort_by(f64::total_cmp);
    (all.len() >= SHORTEST).then(|| all[all.len() / 2])
}

/// Mean distance of the joints that both show, sides exchanged where that is nearer.
fn apart(a: &Joints, b: &Joints) -> Option<f64> {
    let of = |other: bool| {
        let each = (0..EVIDENCE_JOINTS).filter_map(|j| {
            let k = if other { MIRROR[j] } else { j };
            Some(a[j]?.distance(b[k]?))
        });
        let (sum, count) = each.fold((0.0, 0), |(s, n), d| (s + d, n + 1));
        (count >= LEAST_SHARED).then(|| sum / count as f64)
    };
    match (of(false), of(true)) {
        (Some(x), Some(y)) => Some(x.min(y)),
        (x, y) => x.or(y),
    }
}

/// Diagonal of the box round the joints seen.
fn size(joints: &Joints) -> f64 {
    let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
    for p in joints.iter().flatten() {
        (low, high) = (low.min(*p), high.max(*p));
    }
    let size = (high - low).length();
    if size.is_finite() { size } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::View;
    use crate::message::Observation;

    #[test]
    fn for_how_long_somebody_may_be_missed_goes_by_seconds() {
        let mut seen = Observation::default();
        for (k, joint) in seen.joints2d.iter_mut().enumerate() {
            *joint = [400.0 + 20.0 * k as f32, 500.0 + 40.0 * k as f32, 0.9];
        }
        let sight = Sight::new(&View::around(0.0), &seen);
        // Frames a second, frames without them, and whether they are the same before and after.
        for (rate, away, goes_on) in [
            (30.0, 2, true),
            (30.0, 3, false),
            (120.0, 11, true),
            (120.0, 12, false),
            (10.0, 2, true),
        ] {
            let times: Vec<f64> = (0..60).map(|k| f64::from(k) / rate).collect();
            let mut frames = vec![vec![sight.clone()]; times.len()];
            frames[20..20 + away].fill(Vec::new());
            let found = trails(&times, &frames).len();
            assert_eq!(found == 1, goes_on, "{away} frames at {rate}: {found}");
        }
    }
}
