//! In: Stage II's joints and the fitted bone directions, frame by frame. Out: the person's bone lengths. XNect §5.2.

use glam::DVec3;

use crate::body::skeleton::{BoneLengths, Posed, Skeleton};
use crate::joints::{BODY_JOINTS, CANONICAL_STATURE, PARENTS, PELVIS};

/// Frames after which lengths are first changed.
const FIRST: u32 = 10;
/// Spread of people's proportions about the average, as a share of the length.
const PRIOR_SPREAD: f64 = 0.06;
/// Error of one frame's length, metres.
const FRAME_ERROR: f64 = 0.08;
/// Errors last about this many frames, so that only every so many counts.
const CORRELATED_FRAMES: f64 = 6.0;
/// Memory of the slow refinement, frames.
const MEMORY: f64 = 1800.0;
/// Farthest a length may be from the average person's, as a share.
const MOST: f64 = 0.2;
/// A frame's length farther from the estimate than this share (plus 5 cm) is an outlier.
const OUTLIER: f64 = 0.35;

/// Bones whose left and right lengths are taken as equal: (right, left).
const PAIRS: [(usize, usize); 8] = [
    (2, 5),
    (3, 6),
    (4, 7),
    (8, 11),
    (9, 12),
    (10, 13),
    (17, 18),
    (19, 20),
];

/// Running estimate of one person's bone lengths at canonical stature.
#[derive(Debug, Clone)]
pub struct Bones {
    mean: BoneLengths,
    frames: [f64; BODY_JOINTS],
    seen: u32,
    lengths: BoneLengths,
}

impl Bones {
    /// The average person.
    pub fn new(skeleton: &Skeleton) -> Self {
        Self {
            mean: *skeleton.lengths(),
            frames: [0.0; BODY_JOINTS],
            seen: 0,
            lengths: *skeleton.lengths(),
        }
    }

    /// Lengths at canonical stature, metres.
    pub fn lengths(&self) -> &BoneLengths {
        &self.lengths
    }

    /// Takes in a good frame. A bone's length is its observed vector along the fitted direction: the noise across the
    /// bone, which would lengthen it, drops out.
    pub fn update(&mut self, skeleton: &Skeleton, points: &[DVec3; BODY_JOINTS], posed: &Posed) {
        self.seen = self.seen.saturating_add(1);
        for j in (0..BODY_JOINTS).filter(|&j| j != PELVIS) {
            let direction = posed.frames[j] * skeleton.directions()[j];
            let length = (points[j] - points[PARENTS[j]]).dot(direction);
            let expected = self.mean[j];
            if (length - expected).abs() > OUTLIER * expected + 0.05 {
                continue;
            }
            self.frames[j] = (self.frames[j] + 1.0).min(MEMORY);
            self.mean[j] += (length - expected) / self.frames[j];
        }
        if self.seen >= FIRST {
            self.settle(skeleton);
        }
    }

    /// Weighs means against the average person, makes both sides equal and brings the whole to canonical stature.
    fn settle(&mut self, skeleton: &Skeleton) {
        let average = skeleton.lengths();
        let mut lengths = *average;
        for j in (0..BODY_JOINTS).filter(|&j| j != PELVIS) {
            let prior = (PRIOR_SPREAD * average[j]).powi(-2);
            let seen = self.frames[j] / CORRELATED_FRAMES / (FRAME_ERROR * FRAME_ERROR);
            lengths[j] = (prior * average[j] + seen * self.mean[j]) / (prior + seen);
        }
        for (r, l) in PAIRS {
            let both = 0.5 * (lengths[r] + lengths[l]);
            lengths[r] = both;
            lengths[l] = both;
        }
        let scale = CANONICAL_STATURE as f64 / skeleton.stature(&lengths);
        for (length, average) in lengths.iter_mut().zip(average) {
            *length = (*length * scale).clamp((1.0 - MOST) * average, (1.0 + MOST) * average);
        }
        self.lengths = lengths;
    }

    /// Mean difference to another person's proportions, as a share of the length; `None` while either is unknown.
    pub fn difference(&self, other: &Self) -> Option<f64> {
        if self.seen < FIRST || other.seen < FIRST {
            return None;
        }
        let sum: f64 = PAIRS[..6]
            .iter()
            .map(|&(r, _)| (self.lengths[r] / other.lengths[r]).ln().abs())
            .sum();
        Some(sum / 6.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::skeleton::Pose;

    #[test]
    fn proportions_are_learned_and_outliers_are_not() {
        let s = Skeleton::builtin();
        let mut truth = *s.lengths();
        for (r, l) in [(9, 12), (10, 13)] {
            truth[r] *= 1.08;
            truth[l] *= 1.08;
        }
        let scale = 1.70 / s.stature(&truth);
        truth.iter_mut().for_each(|l| *l *= scale);
        let mut posed = Posed::default();
        let mut bones = Bones::new(s);
        let before: f64 = (truth[9] - s.lengths()[9]).abs();
        for i in 0..400u32 {
            let mut pose = Pose::facing_camera(3.0);
            pose.angles[13] = 0.01 * (i % 60) as f64;
            s.pose(&pose, &truth, &mut posed);
            let mut points = posed.joints.map(|p| p - posed.joints[PELVIS]);
            for (j, p) in points.iter_mut().enumerate() {
                let n = |k: u32| ((i * 31 + j as u32 * 17 + k * 7) % 41) as f64 / 20.0 - 1.0;
                *p += DVec3::new(n(1), n(2), n(3)) * 0.05;
            }
            if i.is_multiple_of(7) {
                points[10] = DVec3::splat(5.0);
            }
            bones.update(s, &points, &posed);
            if i < 8 {
                assert_eq!(
                    bones.lengths(),
                    s.lengths(),
                    "nothing changes before ten frames"
                );
            }
        }
        let after = (truth[9] - bones.lengths()[9]).abs();
        assert!(after < 0.5 * before, "{before} → {after}");
        assert!((s.stature(bones.lengths()) - 1.70).abs() < 0.01);
    }
}
