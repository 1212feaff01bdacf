//! Share of correct keypoints by the head's size: PCKh@0.5, the measure of MPII.

use edgecap_client::joints::{
    ANKLES, ELBOWS, EVIDENCE_JOINTS, HEAD_TOP, HIPS, JOINT_NAMES, KNEES, NECK, SHOULDERS, WRISTS,
};
use serde::Serialize;

use super::TruthPerson;
use super::oks::{self, Joints2d};

/// Share of the head's size within which a joint is right.
const FRACTION: f64 = 0.5;
/// MPII's head size over the diagonal of the head's rectangle (`SC_BIAS` of its own tool).
const OF_DIAGONAL: f64 = 0.6;
/// The same over the distance from upper neck to head top. MPII's lie about the rectangle's middle, 0.8 of its diagonal
/// apart: in its validation set within 1 % but for 45 of 2,932 people.
const OF_SEGMENT: f64 = 0.75;
/// Rows of MPII's tables: their names and joints.
const PARTS: [(&str, [usize; 2]); 7] = [
    ("head", [HEAD_TOP, NECK]),
    ("shoulder", SHOULDERS),
    ("elbow", ELBOWS),
    ("wrist", WRISTS),
    ("hip", HIPS),
    ("knee", KNEES),
    ("ankle", ANKLES),
];

/// The size of a head as MPII counts it, and what told it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HeadSize {
    pixels: f64,
    by_joints: bool,
}

impl HeadSize {
    /// Of the head's rectangle: its corners' x, y, x, y, pixels. None where it has no extent.
    pub fn of_rectangle([x0, y0, x1, y1]: [f64; 4]) -> Option<Self> {
        let pixels = OF_DIAGONAL * (x1 - x0).hypot(y1 - y0);
        (x1 > x0 && y1 > y0 && pixels.is_finite()).then_some(Self {
            pixels,
            by_joints: false,
        })
    }

    /// Of MPII's upper neck and head top, pixels. None where they are one point.
    pub fn of_joints(neck: [f64; 2], top: [f64; 2]) -> Option<Self> {
        let pixels = OF_SEGMENT * (top[0] - neck[0]).hypot(top[1] - neck[1]);
        (pixels > 0.0 && pixels.is_finite()).then_some(Self {
            pixels,
            by_joints: true,
        })
    }

    /// Pixels.
    pub fn pixels(&self) -> f64 {
        self.pixels
    }
}

/// Counts joints within half of the head's size of their label.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Pckh {
    hits: [usize; EVIDENCE_JOINTS],
    labels: [usize; EVIDENCE_JOINTS],
    people: usize,
    by_joints: usize,
    without_head: usize,
}

/// PCKh@0.5: shares of joints that are right, 0–1; none where no joint is labelled.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PckhScore {
    /// Over all joints of everybody.
    pub mean: f64,
    /// Means of both sides, named as in MPII's tables; the head's is that of its top and the upper neck.
    pub parts: Vec<(&'static str, Option<f64>)>,
    /// Joint by joint.
    pub per_joint: Vec<(&'static str, Option<f64>)>,
    /// People counted.
    pub people: usize,
    /// Those of them whose head's size is told by upper neck and head top, for want of its rectangle.
    pub head_by_joints: usize,
    /// People of whose head nothing is known: they are not counted.
    pub without_head: usize,
}

impl Pckh {
    /// Counts one labelled person and the prediction for it, if there is one: joints that were not predicted are wrong.
    /// Without a head's size there is no radius, and nothing is counted.
    pub fn add(&mut self, truth: &TruthPerson, predicted: Option<&Joints2d>) {
        let Some(head) = truth.head else {
            self.without_head += 1;
            return;
        };
        self.people += 1;
        self.by_joints += usize::from(head.by_joints);
        for k in truth.points.iter().filter(|k| k.is_labelled()) {
            let Some(j) = k.joint else { continue };
            self.labels[j] += 1;
            let hit = predicted.and_then(|p| oks::predicted(p[j]));
            let hit = hit.is_some_and(|[u, v]| (u - k.u).hypot(v - k.v) <= FRACTION * head.pixels);
            self.hits[j] += usize::from(hit);
        }
    }

    /// None where nobody of known head has a labelled joint.
    pub fn score(&self) -> Option<PckhScore> {
        let (hits, labels): (usize, usize) = (self.hits.iter().sum(), self.labels.iter().sum());
        if labels == 0 {
            return None;
        }
        let of =
            |j: usize| (self.labels[j] > 0).then(|| self.hits[j] as f64 / self.labels[j] as f64);
        let both = |joints: [usize; 2]| {
            let known: Vec<f64> = joints.into_iter().filter_map(of).collect();
            (!known.is_empty()).then(|| known.iter().sum::<f64>() / known.len() as f64)
        };
        Some(PckhScore {
            mean: hits as f64 / labels as f64,
            parts: PARTS.map(|(name, joints)| (name, both(joints))).into(),
            per_joint: (0..EVIDENCE_JOINTS)
                .map(|j| (JOINT_NAMES[j], of(j)))
                .collect(),
            people: self.people,
            head_by_joints: self.by_joints,
            without_head: self.without_head,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 005147875.jpg of MPII's training set.
    #[test]
    fn rectangle_and_joints_of_a_head_tell_one_size() {
        let rectangle = HeadSize::of_rectangle([749.0, 130.0, 845.0, 256.0]).unwrap();
        let joints = HeadSize::of_joints([803.3837, 256.0394], [790.6163, 129.9606]).unwrap();
        assert!((rectangle.pixels() - 0.6 * 96_f64.hypot(126.0)).abs() < 1e-9);
        assert!((joints.pixels() - rectangle.pixels()).abs() < 1e-3);
    }

    #[test]
    fn a_head_without_extent_has_no_size() {
        for flat in [
            [5.0, 5.0, 5.0, 9.0],
            [5.0, 5.0, 9.0, 5.0],
            [9.0, 5.0, 5.0, 9.0],
            [0.0, 0.0, f64::INFINITY, 1.0],
        ] {
            assert_eq!(HeadSize::of_rectangle(flat), None, "{flat:?}");
        }
        assert_eq!(HeadSize::of_joints([3.0, 4.0], [3.0, 4.0]), None);
    }
}
