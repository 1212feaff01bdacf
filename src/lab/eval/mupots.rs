//! MuPoTS-3D's protocol (Mehta et al. 2018): 3DPCK of 14 joints over every person of a multi-person sequence.
//!
//! Predictions are matched in the truth's order by the number of joints within 40 px (head top left out), their bones
//! rescaled to the true lengths from the pelvis outwards, and people without a match count as wrong ("all") or are left
//! out ("matched"). Agrees with the data set's own `mpii_mupots_multiperson_eval` in its relative mode.

use edgecap_client::joints::{
    BODY_JOINTS, EVIDENCE_JOINTS, HEAD_TOP, NECK, PARENTS, PELVIS, ROOT_FIRST,
};
use serde::Serialize;

use super::geometry::{Point, mean, minus, norm, plus};
use super::pose3d::{area_under_curve, correct};

/// Joints this near in u and in v agree, pixels.
const NEAR: f64 = 40.0;
/// Joints that tell who is who: the evidence joints without the head top.
const MATCHED: std::ops::Range<usize> = 1..EVIDENCE_JOINTS;
/// Error of every joint of a person without a match: no threshold reaches it.
const MISSED: f64 = f64::INFINITY;

/// A person in one frame, true or predicted.
#[derive(Debug, Clone, PartialEq)]
pub struct MupotsPerson {
    /// Evidence joints, pixels; `None` where not given.
    pub joints2d: [Option<[f64; 2]>; EVIDENCE_JOINTS],
    /// Body joints, metres, any origin; `None` where not given.
    pub joints3d: [Option<[f64; 3]>; BODY_JOINTS],
}

/// What to do with people that nobody predicted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Protocol {
    /// All their joints are wrong.
    All,
    /// They are left out.
    Matched,
}

/// Gathers sequences.
#[derive(Debug, Clone, Default)]
pub struct Mupots {
    /// Per sequence, errors in metres of every person's joints, [`MISSED`] without a match.
    sequences: Vec<Vec<f64>>,
}

/// Scores of one protocol.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct MupotsScore {
    /// Which people count.
    pub protocol: Protocol,
    /// Sequences with people that count.
    pub sequences: usize,
    /// 3DPCK@150 mm over all joints.
    pub pck150: f64,
    /// Area under the curve over all joints.
    pub auc: f64,
    /// Mean over sequences of 3DPCK@150 mm.
    pub pck150_per_sequence: f64,
}

impl Mupots {
    /// Starts a sequence.
    pub fn begin_sequence(&mut self) {
        self.sequences.push(Vec::new());
    }

    /// Adds a frame of the current sequence.
    pub fn add(&mut self, truth: &[MupotsPerson], predicted: &[MupotsPerson]) {
        if self.sequences.is_empty() {
            self.begin_sequence();
        }
        let Some(errors) = self.sequences.last_mut() else {
            return;
        };
        let matches = claim(truth, predicted);
        for (t, p) in truth.iter().zip(matches) {
            let lifted = p.and_then(|p| rescaled(&predicted[p].joints3d, &t.joints3d));
            let Some(root) = t.joints3d[PELVIS] else {
                continue;
            };
            for j in 0..EVIDENCE_JOINTS {
                let Some(truth) = t.joints3d[j] else { continue };
                errors.push(match lifted.as_ref().map(|l| l[j]) {
                    Some(Some(q)) => norm(minus(q, minus(truth, root))),
                    _ => MISSED,
                });
            }
        }
    }

    /// The scores; `None` without any person.
    pub fn score(&self, protocol: Protocol) -> Option<MupotsScore> {
        let keep = |e: &&f64| protocol == Protocol::All || e.is_finite();
        let sequences: Vec<Vec<f64>> = self
            .sequences
            .iter()
            .map(|s| s.iter().filter(keep).copied().collect())
            .filter(|s: &Vec<f64>| !s.is_empty())
            .collect();
        let pooled: Vec<f64> = sequences.iter().flatten().copied().collect();
        (!pooled.is_empty()).then(|| MupotsScore {
            protocol,
            sequences: sequences.len(),
            pck150: correct(&pooled),
            auc: area_under_curve(&pooled),
            pck150_per_sequence: mean(&sequences.iter().map(|s| correct(s)).collect::<Vec<_>>()),
        })
    }
}

/// Prediction of every true person: in the truth's order, the free one with the most joints within 40 px in u and v.
fn claim(truth: &[MupotsPerson], predicted: &[MupotsPerson]) -> Vec<Option<usize>> {
    let agree = |t: &MupotsPerson, p: &MupotsPerson| {
        let near = |(a, b): &(&Option<[f64; 2]>, &Option<[f64; 2]>)| match (a, b) {
            (Some(a), Some(b)) => (a[0] - b[0]).abs() < NEAR && (a[1] - b[1]).abs() < NEAR,
            _ => false,
        };
        let pairs = t.joints2d[MATCHED].iter().zip(&p.joints2d[MATCHED]);
        pairs.filter(near).count()
    };
    let mut taken = vec![false; predicted.len()];
    let choose = |t: &MupotsPerson| {
        let mut best = (0, None);
        for (k, p) in predicted.iter().enumerate() {
            let n = if taken[k] { 0 } else { agree(t, p) };
            if n > best.0 {
                best = (n, Some(k));
            }
        }
        if let Some(k) = best.1 {
            taken[k] = true;
        }
        best.1
    };
    truth.iter().map(choose).collect()
}

/// Parent of a joint in the data set's `mpii_get_joints('relevant')`: ours, but that the head top hangs on the neck.
fn parent(joint: usize) -> usize {
    if joint == HEAD_TOP {
        NECK
    } else {
        PARENTS[joint]
    }
}

/// Predicted joints relative to the pelvis with the truth's bone lengths; a bone that the truth does not have keeps its
/// own.
fn rescaled(
    predicted: &[Option<Point>; BODY_JOINTS],
    truth: &[Option<Point>; BODY_JOINTS],
) -> Option<[Option<Point>; BODY_JOINTS]> {
    predicted[PELVIS]?;
    let mut out = [None; BODY_JOINTS];
    out[PELVIS] = Some([0.0; 3]);
    for &j in ROOT_FIRST.iter().filter(|j| **j != PELVIS) {
        let parent = parent(j);
        let (Some(base), Some(a), Some(b)) = (out[parent], predicted[parent], predicted[j]) else {
            continue;
        };
        let bone = minus(b, a);
        let length = match (truth[j], truth[parent]) {
            (Some(t), Some(u)) => norm(minus(t, u)),
            _ => norm(bone),
        };
        let own = norm(bone);
        let scale = if own > 0.0 { length / own } else { 0.0 };
        out[j] = Some(plus(base, scale, bone));
    }
    Some(out)
}
