//! A person while joints are being added.

use edgecap_client::joints::{
    EVIDENCE_JOINTS, HEAD_TOP, L_HIP, LIMB_JOINTS, LIMBS, NECK, R_HIP, limb_to,
};

use super::limb::{self, PROPORTION};
use super::peaks::{Peak, Peaks};

/// Limbs whose length tells the person's size: head and trunk. Shoulders vanish in a side view.
const TRUNK: [usize; 3] = [limb_to(HEAD_TOP), limb_to(R_HIP), limb_to(L_HIP)];
/// How much longer than the rest a limb at the neck may seem before it is dropped; generous, as a person who leans
/// towards the camera shows a short trunk.
const TRUNK_SLACK: f32 = 1.4;

/// Shortest limb, over its length in a person of the known stature, that [`Person::oddity`] tells from shorter ones.
const SHORTEST: f32 = 0.05;

/// Chosen candidates of one person.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Person {
    /// Index of the chosen peak of each joint.
    pub peak: [Option<usize>; EVIDENCE_JOINTS],
    /// Score of each limb whose two joints were chosen.
    pub limb: [Option<f32>; LIMBS],
    /// Expected similarity with somebody who is there, once all joints are chosen.
    pub score: f32,
    /// Stature that each limb suggests: length over proportion, cells. A foreshortened limb suggests too little.
    suggested: [f32; LIMBS],
}

impl Person {
    /// Only a neck.
    pub fn from_neck(peak: usize) -> Self {
        let mut person = Self {
            peak: [None; EVIDENCE_JOINTS],
            limb: [None; LIMBS],
            score: 0.0,
            suggested: [0.0; LIMBS],
        };
        person.peak[NECK] = Some(peak);
        person
    }

    /// Adds the child of `limb`.
    pub fn attach(&mut self, limb: usize, peak: usize, score: f32, length: f32) {
        self.peak[LIMB_JOINTS[limb].0] = Some(peak);
        self.limb[limb] = Some(score);
        self.suggested[limb] = length / PROPORTION[limb];
    }

    /// Number of joints.
    pub fn joints(&self) -> usize {
        self.peak.iter().flatten().count()
    }

    /// Stature in cells: the greatest that a limb suggests, as projection only shortens. 0 for a bare neck.
    pub fn stature(&self) -> f32 {
        self.suggested.iter().copied().fold(0.0, f32::max)
    }

    /// Confidence of every joint, 0–1; 0 where there is none.
    pub fn confidences(&self, peaks: &Peaks) -> [f32; EVIDENCE_JOINTS] {
        let mut out = [0.0; EVIDENCE_JOINTS];
        for (j, peak) in self.chosen(peaks) {
            out[j] = peak.score.min(1.0);
        }
        out
    }

    /// Score of every limb; 0 where there is none.
    pub fn limb_scores(&self) -> [f32; LIMBS] {
        self.limb.map(|s| s.unwrap_or(0.0))
    }

    /// The chosen candidates with their joints.
    pub fn chosen<'a>(&'a self, peaks: &'a Peaks) -> impl Iterator<Item = (usize, &'a Peak)> {
        self.peak
            .iter()
            .enumerate()
            .filter_map(|(j, k)| k.map(|k| (j, &peaks.of(j)[k])))
    }

    /// Whether a limb of this length cannot belong to a person of the size seen so far. Without two limbs, one of them
    /// of the trunk, there is no size to compare with.
    pub fn is_absurd(&self, limb: usize, length: f32, limit: f32) -> bool {
        let known = self.limb.iter().flatten().count() >= 2
            && TRUNK.iter().any(|&l| self.limb[l].is_some());
        known && length / PROPORTION[limb] > limit * self.stature()
    }

    /// How far the stature that a limb of this length suggests is from the one known so far, as the logarithm of their
    /// ratio; 0 for a bare neck. Projection shortens limbs, so too short a one counts half.
    pub fn oddity(&self, limb: usize, length: f32) -> f32 {
        let known = self.stature();
        if known <= 0.0 {
            return 0.0;
        }
        let ratio = (length / PROPORTION[limb] / known).max(SHORTEST).ln();
        if ratio > 0.0 { ratio } else { -0.5 * ratio }
    }

    /// Drops the limbs at the neck that are absurdly long for the others.
    pub fn drop_absurd_trunk(&mut self, limit: f32) {
        for (limb, &(child, parent)) in LIMB_JOINTS.iter().enumerate() {
            if parent != NECK || self.limb[limb].is_none() {
                continue;
            }
            let known = TRUNK.iter().any(|&l| l != limb && self.limb[l].is_some());
            let rest = (0..LIMBS)
                .filter(|&l| l != limb)
                .map(|l| self.suggested[l])
                .fold(0.0, f32::max);
            if known && self.suggested[limb] > limit * TRUNK_SLACK * rest {
                self.peak[child] = None;
                self.limb[limb] = None;
                self.suggested[limb] = 0.0;
            }
        }
    }

    /// Whether `other` is the same person found twice: necks closer than `distance` of the stature, and at most one
    /// joint that both have in different places.
    pub fn is_same(&self, other: &Self, peaks: &Peaks, distance: f32) -> bool {
        let near = distance * self.stature().max(other.stature());
        let apart = |j: usize| match (self.peak[j], other.peak[j]) {
            (Some(a), Some(b)) => Some(limb::length(&peaks.of(j)[a], &peaks.of(j)[b])),
            _ => None,
        };
        if apart(NECK).is_none_or(|d| d > near) {
            return false;
        }
        let conflicts = (0..EVIDENCE_JOINTS)
            .filter(|&j| apart(j).is_some_and(|d| d > near))
            .count();
        conflicts <= 1
    }

    /// Takes over what `other` has and this one lacks.
    pub fn absorb(&mut self, other: &Self) {
        for (limb, &(child, parent)) in LIMB_JOINTS.iter().enumerate() {
            if self.peak[child].is_none() && self.peak[parent].is_some() {
                self.peak[child] = other.peak[child];
                self.limb[limb] = other.limb[limb];
                self.suggested[limb] = other.suggested[limb];
            }
        }
    }
}
