//! What detections of one frame show of somebody, and which of them show one person twice.

use glam::DVec3;

use super::live_track::{Live, empty};
use super::near::{REACH, mean_distance};
use super::{Frame, Joints, is_proven};
use crate::camera::View;
use crate::joints::{EVIDENCE_JOINTS, MIRROR};
use crate::multiview::exchange;
use crate::multiview::sight::{LEAST_SHARED, Sight};
use crate::multiview::triangulate::{Joints3d, triangulate};

/// Bodies whose joints are so near on average are one person's, metres.
const ONE_BODY: f64 = 0.12;

/// What detections of one frame, one a view, are of somebody.
pub(super) struct Look {
    pub(super) chosen: Vec<Option<usize>>,
    /// Exchanged limbs healed, a view that is about somebody else left out.
    pub(super) sights: Vec<Option<Sight>>,
    pub(super) states: exchange::States,
    pub(super) joints: Joints,
}

impl Look {
    /// `None` where no view sees them.
    pub(super) fn new(
        views: &[View],
        frame: &Frame<'_>,
        chosen: Vec<Option<usize>>,
    ) -> Option<Self> {
        let each = chosen.iter().enumerate();
        let mut sights: Vec<Option<Sight>> =
            each.map(|(v, d)| Some(frame[v][(*d)?].clone())).collect();
        let count = sights.iter().flatten().count();
        if count == 0 {
            return None;
        }
        let mut states = exchange::agree(views, &mut sights);
        let mut joints = solve(views, &sights);
        if count > 2 {
            let off = |v: usize| {
                sights[v].as_ref().map_or(0.0, |s| {
                    mean_distance(&views[v], s, &joints.points, REACH).unwrap_or(0.0)
                })
            };
            let worst = (0..views.len())
                .map(|v| (v, off(v)))
                .max_by(|a, b| a.1.total_cmp(&b.1));
            if let Some((v, _)) = worst.filter(|(_, off)| *off > REACH) {
                sights[v] = None;
                states.iter_mut().for_each(|state| *state &= !(1 << v));
                joints = solve(views, &sights);
            }
        }
        Some(Self {
            chosen,
            sights,
            states,
            joints: joints.points,
        })
    }

    /// Views that see them.
    pub(super) fn count(&self) -> usize {
        self.sights.iter().flatten().count()
    }

    /// Whether two views tell where they are.
    pub(super) fn is_met(&self) -> bool {
        self.count() >= 2 && self.joints.iter().flatten().count() >= LEAST_SHARED
    }

    /// Whether another look is of the same body, all sides exchanged or not.
    fn is_of_one(&self, other: &Self) -> bool {
        let near = |swapped: bool| {
            let to = |j: usize| if swapped { MIRROR[j] } else { j };
            let each = 0..EVIDENCE_JOINTS;
            let pairs = each.filter_map(|j| Some((self.joints[j]?, other.joints[to(j)]?)));
            is_one_body(pairs)
        };
        self.is_met() && other.is_met() && (near(false) || near(true))
    }
}

/// Whether joints of two bodies, pair by pair, lie so near that they are one person's; too few pairs tell nothing.
pub(in crate::multiview) fn is_one_body(pairs: impl Iterator<Item = (DVec3, DVec3)>) -> bool {
    let (sum, count) = pairs.fold((0.0, 0), |(s, n), (p, q)| (s + p.distance(q), n + 1));
    count >= LEAST_SHARED && sum < ONE_BODY * count as f64
}

/// Of two looks that are of one body one person gets what both show: who is proven, else who was there first. Somebody
/// proven whose look was taken has a past of their own and goes on alone; anybody else was the same person all along.
pub(super) fn merge(
    views: &[View],
    frame: &Frame<'_>,
    looks: &mut [Option<Look>],
    live: &mut [Live],
    needed: [usize; 2],
) {
    for k in 1..looks.len() {
        let (before, rest) = looks.split_at(k);
        let Some(own) = &rest[0] else {
            continue;
        };
        let is_same = |l: &Option<Look>| l.as_ref().is_some_and(|l| l.is_of_one(own));
        let Some(first) = before.iter().position(is_same) else {
            continue;
        };
        let [is_first, is_own] = [first, k].map(|k| is_proven(live[k].proof, needed));
        let (one, double) = match is_own && !is_first {
            true => (k, first),
            false => (first, k),
        };
        let Some((own, other)) = looks[double].take().zip(looks[one].take()) else {
            continue;
        };
        let both = other.chosen.iter().zip(&own.chosen);
        let both = both.map(|(one, other)| one.or(*other)).collect();
        looks[one] = Look::new(views, frame, both);
        if !(is_first && is_own) {
            let double = std::mem::replace(&mut live[double], empty());
            live[one].join(double);
        }
    }
}

/// Where the joints are in space by what views see of one person.
pub(super) fn solve(views: &[View], sights: &[Option<Sight>]) -> Joints3d {
    let all: Vec<_> = sights.iter().map(Option::as_ref).collect();
    triangulate(views, &all)
}
