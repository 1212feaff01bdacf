//! How somebody is built. In: joints as several views meet in them, and the fitted skeleton. Out: bone lengths in
//! metres, and so the stature, which several views see and one does not. XNect §5.2; before one camera `fit` takes them
//! in at canonical stature.

use glam::DVec3;

use crate::body::skeleton::{BoneLengths, Posed, Skeleton};
use crate::fit::{RunningMean, look_of_its_own};
use crate::joints::{
    ELBOWS, EVIDENCE_JOINTS, HEAD, HEAD_TOP, HIPS, KNEES, L_ANKLE, L_ELBOW, L_FOOT_TIP, L_HAND,
    L_HIP, L_KNEE, L_SHOULDER, L_WRIST, NECK, R_ANKLE, R_ELBOW, R_FOOT_TIP, R_HAND, R_HIP, R_KNEE,
    R_SHOULDER, R_WRIST, SHOULDERS, SPINE,
};

/// Errors last about this long, seconds, so that looks that come faster count for less.
const CORRELATED: f64 = 1.0 / 6.0;
/// Memory of the estimate, looks of their own.
const MEMORY: f64 = 180.0;
/// What a segment that was never seen weighs in the size, looks.
const UNSEEN: f64 = 0.02;
/// Error of one frame's length, metres.
const FRAME_ERROR: f64 = 0.04;
/// Spread of people's proportions about the average, as a share of the length.
const PRIOR_SPREAD: f64 = 0.05;
/// What a length may be, as a share of the average adult's.
const BELIEVED: [f64; 2] = [0.4, 1.5];
/// By how much of itself a length may differ from what is known of it.
const UNLIKE: f64 = 0.35;
/// Looks of their own after which builds tell people apart, and lengths unlike what is known are not believed: half a
/// second, and a little less, so that rounding decides nothing.
const TELLING: f64 = 2.9;

/// What is measured between evidence joints, and the bones that follow it.
struct Segment {
    /// Middles of pairs of joints, from and to; both sides of the body.
    spans: &'static [[[usize; 2]; 2]],
    /// Bones by the joint that they end in.
    bones: &'static [usize],
}

/// A joint itself, where others are the middle of two.
const fn at(joint: usize) -> [usize; 2] {
    [joint; 2]
}

const SEGMENTS: [Segment; 8] = [
    // Thighs, shanks with feet.
    Segment {
        spans: &[[at(R_HIP), at(R_KNEE)], [at(L_HIP), at(L_KNEE)]],
        bones: &KNEES,
    },
    Segment {
        spans: &[[at(R_KNEE), at(R_ANKLE)], [at(L_KNEE), at(L_ANKLE)]],
        bones: &[R_ANKLE, L_ANKLE, R_FOOT_TIP, L_FOOT_TIP],
    },
    // Upper arms, forearms with hands.
    Segment {
        spans: &[[at(R_SHOULDER), at(R_ELBOW)], [at(L_SHOULDER), at(L_ELBOW)]],
        bones: &ELBOWS,
    },
    Segment {
        spans: &[[at(R_ELBOW), at(R_WRIST)], [at(L_ELBOW), at(L_WRIST)]],
        bones: &[R_WRIST, L_WRIST, R_HAND, L_HAND],
    },
    // Hips, shoulders, trunk, head.
    Segment {
        spans: &[[at(R_HIP), at(L_HIP)]],
        bones: &HIPS,
    },
    Segment {
        spans: &[[at(R_SHOULDER), at(L_SHOULDER)]],
        bones: &SHOULDERS,
    },
    Segment {
        spans: &[[HIPS, at(NECK)]],
        bones: &[SPINE, NECK],
    },
    Segment {
        spans: &[[at(NECK), at(HEAD_TOP)]],
        bones: &[HEAD, HEAD_TOP],
    },
];

/// Running estimate of one person's bone lengths.
#[derive(Debug, Clone)]
pub struct Build {
    /// Length of every segment as a share of the average person's of canonical stature.
    segments: [RunningMean; SEGMENTS.len()],
    lengths: BoneLengths,
    stature: f64,
    /// Stature where it is given.
    given: Option<f64>,
}

fn span(joints: &[Option<DVec3>], [from, to]: [[usize; 2]; 2]) -> Option<DVec3> {
    let middle = |[a, b]: [usize; 2]| Some(0.5 * (joints[a]? + joints[b]?));
    Some(middle(to)? - middle(from)?)
}

impl Build {
    /// From a first sight: proportions of the average person, as tall as the joints are far apart. `given`: stature,
    /// metres.
    pub fn new(
        skeleton: &Skeleton,
        joints: &[Option<DVec3>; EVIDENCE_JOINTS],
        given: Option<f64>,
    ) -> Self {
        let mut rest = Posed::default();
        skeleton.pose(
            &crate::body::skeleton::Pose::facing_camera(0.0),
            skeleton.lengths(),
            &mut rest,
        );
        let average = rest.joints.map(Some);
        let (mut seen, mut usual) = (0.0, 0.0);
        for spans in SEGMENTS.iter().flat_map(|s| s.spans) {
            if let (Some(s), Some(u)) = (span(joints, *spans), span(&average, *spans)) {
                // One joint that is elsewhere must not make a giant.
                seen += s
                    .length()
                    .clamp(BELIEVED[0] * u.length(), BELIEVED[1] * u.length());
                usual += u.length();
            }
        }
        let scale = if usual > 0.0 { seen / usual } else { 1.0 };
        let mut build = Self {
            segments: [RunningMean::expecting(scale); SEGMENTS.len()],
            lengths: *skeleton.lengths(),
            stature: 0.0,
            given,
        };
        build.settle(skeleton);
        build
    }

    /// Bone lengths, metres.
    pub fn lengths(&self) -> &BoneLengths {
        &self.lengths
    }

    /// Metres.
    pub fn stature(&self) -> f64 {
        self.stature
    }

    /// Takes in joints where rays met, `dt` seconds after the last time, beside the pose that was fitted to them. A
    /// length is taken along the fitted direction: noise across it, which would lengthen it, drops out.
    pub fn update(
        &mut self,
        skeleton: &Skeleton,
        joints: &[Option<DVec3>; EVIDENCE_JOINTS],
        posed: &Posed,
        dt: f64,
    ) {
        let look = look_of_its_own(dt, CORRELATED);
        let fitted = posed.joints.map(Some);
        for (segment, known) in SEGMENTS.iter().zip(&mut self.segments) {
            let own = self.lengths[segment.bones[0]] / skeleton.lengths()[segment.bones[0]];
            let each = segment.spans.iter().filter_map(|s| {
                let (seen, f) = (span(joints, *s)?, span(&fitted, *s)?);
                Some(own * seen.dot(f) / f.length_squared().max(1e-6))
            });
            let (sum, count) = each.fold((0.0, 0.0), |(s, n), v| (s + v, n + 1.0));
            if count == 0.0 {
                continue;
            }
            let share = sum / count;
            // A first sight alone may be all wrong.
            let is_unlike = known.looks >= TELLING && (share / known.mean - 1.0).abs() > UNLIKE;
            if is_unlike || !(BELIEVED[0]..BELIEVED[1]).contains(&share) {
                continue;
            }
            known.add(share, look, MEMORY);
        }
        self.settle(skeleton);
    }

    /// Weighs segments against the proportions of the average person of the same size.
    fn settle(&mut self, skeleton: &Skeleton) {
        let average = skeleton.lengths();
        let size = |s: &Segment| -> f64 { average[s.bones[0]] };
        let (mut sum, mut weights) = (0.0, 0.0);
        for (segment, known) in SEGMENTS.iter().zip(&self.segments) {
            let w = size(segment) * (known.looks + UNSEEN);
            sum += w * known.mean;
            weights += w;
        }
        let scale = sum / weights;
        self.lengths = average.map(|l| scale * l);
        for (segment, known) in SEGMENTS.iter().zip(&self.segments) {
            // In looks, of which each has a variance of 1.
            let prior = (FRAME_ERROR / (PRIOR_SPREAD * size(segment))).powi(2);
            let own = known.beside(scale, prior, 1.0);
            for &bone in segment.bones {
                self.lengths[bone] = own * average[bone];
            }
        }
        self.stature = skeleton.stature(&self.lengths);
        if let Some(given) = self.given {
            let by = given / self.stature;
            self.lengths.iter_mut().for_each(|l| *l *= by);
            self.stature = given;
        }
    }

    /// Difference of statures, natural logarithm; `None` while either is not known.
    pub fn difference(&self, other: &Self) -> Option<f64> {
        let known = |b: &Self| b.segments.iter().all(|s| s.looks >= TELLING);
        (known(self) && known(other)).then(|| (self.stature / other.stature).ln().abs())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::skeleton::Pose;

    /// Somebody whose thighs are a tenth longer than average after `seconds` at a rate.
    fn learned(fps: f64, seconds: f64) -> Build {
        let s = Skeleton::builtin();
        let mut truth = *s.lengths();
        for bone in KNEES {
            truth[bone] *= 1.1;
        }
        let (pose, mut posed) = (Pose::facing_camera(3.0), Posed::default());
        s.pose(&pose, &truth, &mut posed);
        let joints = std::array::from_fn(|j| Some(posed.joints[j]));
        let mut build = Build::new(s, &joints, None);
        for _ in 0..(seconds * fps).round() as u32 {
            s.pose(&pose, build.lengths(), &mut posed);
            build.update(s, &joints, &posed, 1.0 / fps);
        }
        build
    }

    #[test]
    fn a_second_tells_the_same_at_any_rate() {
        let thigh = |build: &Build| build.lengths()[R_KNEE] / build.lengths()[R_ANKLE];
        let [before, usual, after] = [0.0, 1.0, 20.0].map(|s| thigh(&learned(30.0, s)));
        let share = (usual - before) / (after - before);
        assert!((0.1..0.9).contains(&share), "{share}");
        for fps in [240.0, 60.0, 10.0, 6.0] {
            let found = (thigh(&learned(fps, 1.0)) - before) / (usual - before);
            assert!((found - 1.0).abs() < 0.02, "{fps} fps: {found}");
            let [early, late] = [0.3, 0.6].map(|s| learned(fps, s));
            let telling = |b: &Build| b.difference(b).is_some();
            assert!(!telling(&early) && telling(&late), "{fps} fps");
        }
    }

    /// Two views that stand beside each other may take somebody for a giant, or for a dwarf, at first sight.
    #[test]
    fn a_wrong_first_sight_is_forgotten() {
        let s = Skeleton::builtin();
        let pose = Pose::facing_camera(3.0);
        for (size, first) in [(0.75, 1.6), (1.0, 1.6), (1.0, 0.5)] {
            let truth = s.lengths().map(|l| size * l);
            let mut posed = Posed::default();
            s.pose(&pose, &truth, &mut posed);
            let joints: [Option<DVec3>; EVIDENCE_JOINTS] =
                std::array::from_fn(|j| Some(posed.joints[j]));
            let sight = joints.map(|p| p.map(|p| first * p));
            let mut build = Build::new(s, &sight, None);
            for _ in 0..300 {
                s.pose(&pose, build.lengths(), &mut posed);
                build.update(s, &joints, &posed, 1.0 / 30.0);
            }
            let found = build.stature() / s.stature(&truth);
            assert!((found - 1.0).abs() < 0.03, "{size}, {first}: {found}");
        }
    }

    #[test]
    fn stature_and_proportions_are_observed() {
        let s = Skeleton::builtin();
        // A child with long legs.
        let mut truth = s.lengths().map(|l| 0.75 * l);
        for bone in [R_KNEE, R_ANKLE, L_KNEE, L_ANKLE] {
            truth[bone] *= 1.06;
        }
        let mut posed = Posed::default();
        let mut build = None;
        for i in 0..300u32 {
            let mut pose = Pose::facing_camera(3.0);
            pose.angles[13] = 0.01 * f64::from(i % 60);
            s.pose(&pose, &truth, &mut posed);
            let mut joints: [Option<DVec3>; EVIDENCE_JOINTS] =
                std::array::from_fn(|j| Some(posed.joints[j]));
            for (j, p) in joints.iter_mut().enumerate() {
                let n = |k: u32| f64::from((i * 31 + j as u32 * 17 + k * 7) % 41) / 20.0 - 1.0;
                *p = p.map(|p| p + DVec3::new(n(1), n(2), n(3)) * 0.03);
            }
            if i.is_multiple_of(7) {
                joints[R_ANKLE] = None;
            }
            if i.is_multiple_of(11) {
                joints[R_WRIST] = Some(DVec3::splat(5.0));
            }
            let build = build.get_or_insert_with(|| Build::new(s, &joints, None));
            let mut fitted = Posed::default();
            s.pose(&pose, build.lengths(), &mut fitted);
            build.update(s, &joints, &fitted, 1.0 / 30.0);
        }
        let build = build.unwrap();
        let stature = s.stature(&truth);
        assert!(
            (build.stature() - stature).abs() < 0.02,
            "{} instead of {stature}",
            build.stature()
        );
        let thigh = build.lengths()[9] / truth[9];
        assert!((thigh - 1.0).abs() < 0.025, "{thigh}");
        let given = Build::new(
            s,
            &posed.joints[..14]
                .iter()
                .map(|p| Some(*p))
                .collect::<Vec<_>>()
                .try_into()
                .unwrap(),
            Some(1.2),
        );
        assert!((given.stature() - 1.2).abs() < 1e-9);
    }
}
