//! Share of correct keypoints: single people in pictures, Leeds Sports Pose's measure.

use edgecap_client::joints::{EVIDENCE_JOINTS, L_SHOULDER, R_HIP};

use super::TruthPerson;
use super::oks::{self, Joints2d};

/// Left shoulder and right hip, whose distance is the torso's size.
pub const TORSO: (usize, usize) = (L_SHOULDER, R_HIP);

/// Counts joints within a fraction of the torso of their label.
#[derive(Debug, Clone, PartialEq)]
pub struct Pck {
    fraction: f64,
    hits: [usize; EVIDENCE_JOINTS],
    labels: [usize; EVIDENCE_JOINTS],
    people: usize,
}

impl Pck {
    /// Nothing counted; `fraction` of the torso is the radius (0.2 for PCK@0.2).
    pub fn new(fraction: f64) -> Self {
        Self {
            fraction,
            hits: [0; EVIDENCE_JOINTS],
            labels: [0; EVIDENCE_JOINTS],
            people: 0,
        }
    }

    /// Counts one labelled person and the prediction for it, if there is one: joints that were not predicted are wrong.
    /// Returns whether the torso was labelled, without which there is no radius and nothing is counted.
    pub fn add(&mut self, truth: &TruthPerson, predicted: Option<&Joints2d>) -> bool {
        let Some(torso) = torso(truth) else {
            return false;
        };
        self.people += 1;
        for k in truth.points.iter().filter(|k| k.is_labelled()) {
            let Some(j) = k.joint else { continue };
            self.labels[j] += 1;
            let hit = predicted.and_then(|p| oks::predicted(p[j]));
            let hit = hit.is_some_and(|[u, v]| (u - k.u).hypot(v - k.v) < self.fraction * torso);
            self.hits[j] += usize::from(hit);
        }
        true
    }

    /// People counted.
    pub fn people(&self) -> usize {
        self.people
    }

    /// Share of correct joints over all labels; 0 without any.
    pub fn mean(&self) -> f64 {
        let (hits, labels): (usize, usize) = (self.hits.iter().sum(), self.labels.iter().sum());
        hits as f64 / labels.max(1) as f64
    }

    /// Share of correct joints, joint by joint; `None` where there was no label.
    pub fn per_joint(&self) -> [Option<f64>; EVIDENCE_JOINTS] {
        std::array::from_fn(|j| {
            (self.labels[j] > 0).then(|| self.hits[j] as f64 / self.labels[j] as f64)
        })
    }
}

/// Size of the labelled torso, pixels.
fn torso(truth: &TruthPerson) -> Option<f64> {
    let at = |j: usize| {
        let mut points = truth.points.iter();
        points.find(|k| k.joint == Some(j) && k.is_labelled())
    };
    let (a, b) = (at(TORSO.0)?, at(TORSO.1)?);
    Some((a.u - b.u).hypot(a.v - b.v)).filter(|d| *d > 0.0)
}
