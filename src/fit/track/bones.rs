//! In: Stage II's joints and the fitted bone directions, frame by frame. Out: the person's bone lengths. XNect §5.2.
//!
//! One view does not tell how large somebody is: lengths are those at canonical stature. What several views see in
//! metres `multiview/live/build.rs` takes in.

use glam::DVec3;

use super::running_mean::{RunningMean, look_of_its_own};
use crate::body::skeleton::{BoneLengths, Posed, Skeleton};
use crate::joints::{BODY_JOINTS, CANONICAL_STATURE, MIRRORED, MIRRORED_EVIDENCE, PARENTS, PELVIS};

/// Errors last about this long, seconds, so that looks that come faster count for less.
const CORRELATED: f64 = 0.2;
/// Looks of their own after which lengths are first changed: a third of a second, two where frames are far apart. A
/// little less, so that rounding decides nothing.
const FIRST: f64 = 1.66;
/// Spread of people's proportions about the average, as a share of the length.
const PRIOR_SPREAD: f64 = 0.06;
/// Error of one frame's length, metres.
const FRAME_ERROR: f64 = 0.08;
/// Memory of the slow refinement, looks of their own.
const MEMORY: f64 = 300.0;
/// Farthest a length may be from the average person's, as a share.
const MOST: f64 = 0.2;
/// A frame's length farther from the estimate than this share (plus 5 cm) is an outlier.
const OUTLIER: f64 = 0.35;

/// Running estimate of one person's bone lengths at canonical stature.
#[derive(Debug, Clone)]
pub struct Bones {
    /// Length of every bone, metres.
    measured: [RunningMean; BODY_JOINTS],
    /// Looks of their own at the person.
    seen: f64,
    lengths: BoneLengths,
}

impl Bones {
    /// The average person.
    pub fn new(skeleton: &Skeleton) -> Self {
        Self {
            measured: skeleton.lengths().map(RunningMean::expecting),
            seen: 0.0,
            lengths: *skeleton.lengths(),
        }
    }

    /// Lengths at canonical stature, metres.
    pub fn lengths(&self) -> &BoneLengths {
        &self.lengths
    }

    /// Takes in a good frame, `dt` seconds after the last. A bone's length is its observed vector along the fitted
    /// direction: the noise across the bone, which would lengthen it, drops out.
    pub fn update(
        &mut self,
        skeleton: &Skeleton,
        points: &[DVec3; BODY_JOINTS],
        posed: &Posed,
        dt: f64,
    ) {
        let look = look_of_its_own(dt, CORRELATED);
        self.seen += look;
        for j in (0..BODY_JOINTS).filter(|&j| j != PELVIS) {
            let fitted = posed.joints[j] - posed.joints[PARENTS[j]];
            let length = (points[j] - points[PARENTS[j]]).dot(fitted.normalize_or_zero());
            let expected = self.measured[j].mean;
            if (length - expected).abs() > OUTLIER * expected + 0.05 {
                continue;
            }
            self.measured[j].add(length, look, MEMORY);
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
            lengths[j] = self.measured[j].beside(average[j], prior, FRAME_ERROR * FRAME_ERROR);
        }
        for [r, l] in MIRRORED {
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
        let sum: f64 = MIRRORED[..MIRRORED_EVIDENCE]
            .iter()
            .map(|&[r, _]| (self.lengths[r] / other.lengths[r]).ln().abs())
            .sum();
        Some(sum / MIRRORED_EVIDENCE as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::skeleton::Pose;
    use crate::joints::{ANKLES, KNEES, R_ANKLE, R_KNEE};

    /// How long a thigh a tenth longer than average is taken for, as a share of what it is longer by, after `seconds`
    /// at a rate.
    fn learned(fps: f64, seconds: f64) -> f64 {
        let s = Skeleton::builtin();
        let mut truth = *s.lengths();
        for j in KNEES {
            truth[j] *= 1.1;
        }
        let mut posed = Posed::default();
        s.pose(&Pose::facing_camera(3.0), &truth, &mut posed);
        let points = posed.joints.map(|p| p - posed.joints[PELVIS]);
        let mut bones = Bones::new(s);
        for _ in 0..(seconds * fps).round() as u32 {
            bones.update(s, &points, &posed, 1.0 / fps);
        }
        // Beside the shank: the whole is kept at canonical stature.
        let longer = |l: &BoneLengths| {
            (l[R_KNEE] / l[R_ANKLE]) / (s.lengths()[R_KNEE] / s.lengths()[R_ANKLE]) - 1.0
        };
        longer(bones.lengths()) / longer(&truth)
    }

    #[test]
    fn a_second_tells_the_same_at_any_rate() {
        let usual = learned(30.0, 3.0);
        assert!((0.3..0.8).contains(&usual), "{usual}");
        for fps in [240.0, 60.0, 10.0, 5.0] {
            let found = learned(fps, 3.0);
            assert!(
                (found / usual - 1.0).abs() < 0.02,
                "{fps} fps: {found}, {usual}"
            );
        }
        // No look tells more than one.
        assert!(learned(1.0, 15.0) < 1.02 * usual);
        for fps in [240.0, 30.0] {
            assert_eq!(learned(fps, 0.29), 0.0, "{fps} fps");
            assert!(learned(fps, 0.35) > 0.0, "{fps} fps");
        }
    }

    #[test]
    fn proportions_are_learned_and_outliers_are_not() {
        let s = Skeleton::builtin();
        let mut truth = *s.lengths();
        for [r, l] in [KNEES, ANKLES] {
            truth[r] *= 1.08;
            truth[l] *= 1.08;
        }
        let scale = 1.70 / s.stature(&truth);
        truth.iter_mut().for_each(|l| *l *= scale);
        let mut posed = Posed::default();
        let mut bones = Bones::new(s);
        let before: f64 = (truth[R_KNEE] - s.lengths()[R_KNEE]).abs();
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
                points[R_ANKLE] = DVec3::splat(5.0);
            }
            bones.update(s, &points, &posed, 1.0 / 30.0);
            if i < 8 {
                assert_eq!(
                    bones.lengths(),
                    s.lengths(),
                    "nothing changes before ten frames"
                );
            }
        }
        let after = (truth[R_KNEE] - bones.lengths()[R_KNEE]).abs();
        assert!(after < 0.5 * before, "{before} → {after}");
        assert!((s.stature(bones.lengths()) - 1.70).abs() < 0.01);
    }
}
