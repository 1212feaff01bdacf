//! Somebody who is followed from frame to frame in films and records: where they are, how fast they go, and who saw
//! them. Live cameras have `live/person.rs`.

use glam::DVec3;

use super::Joints;
use super::body_shape::is_body;
use super::distance::{DISTANCE_LEARNT, DISTANCE_TAKEN, shows_most};
use super::look::Look;
use crate::camera::View;
use crate::joints::EVIDENCE_JOINTS;
use crate::multiview::exchange;
use crate::multiview::moment::Moment;
use crate::multiview::one_body::median;
use crate::multiview::sight::LEAST_SHARED;

/// By how much, a second, somebody's velocity is learnt; the fastest that anybody goes, metres a second, and for how
/// long they are expected to go on, seconds.
const SPEED_LEARNT: f64 = 10.0;
const FASTEST: f64 = 10.0;
const GOES_ON: f64 = 1.0;

/// One person so far.
pub(super) struct Live {
    pub(super) moments: Vec<(usize, Moment)>,
    /// Exchanged limbs of every moment.
    pub(super) states: Vec<exchange::States>,
    pub(super) joints: Joints,
    /// Frame of the joints, and how fast they went there, metres a second.
    pub(super) at: usize,
    pub(super) velocity: DVec3,
    /// How far away they are, as a part of what one view alone takes them to be.
    pub(super) farther: f64,
    /// Last frame in which two views saw them, and one did.
    pub(super) met: usize,
    pub(super) seen: usize,
    /// Frames with three views, and with two.
    pub(super) proof: [usize; 2],
}

impl Live {
    /// Whether nobody saw them in the frame before.
    pub(super) fn is_absent(&self, f: usize) -> bool {
        f > self.seen + 1
    }

    /// Frames in which two views might have seen them and did not.
    pub(super) fn away(&self, f: usize) -> usize {
        (f - self.met).saturating_sub(1)
    }

    /// Which views saw them when somebody last did.
    pub(super) fn seen_by(&self) -> Vec<bool> {
        let last = self.moments.last();
        last.map_or_else(Vec::new, |(_, moment)| {
            moment.sights.iter().map(Option::is_some).collect()
        })
    }

    /// Where their joints are in a frame if they go on as they went.
    pub(super) fn ahead(&self, f: usize, rate: f64) -> Joints {
        let seconds = ((f - self.at) as f64 / rate).min(GOES_ON);
        self.joints.map(|p| p.map(|p| p + seconds * self.velocity))
    }

    /// Takes joints for theirs; those that are not known go along with the others. How fast that was is learnt.
    fn go(&mut self, f: usize, now: &Joints, rate: f64) {
        let each = self.joints.iter().zip(now);
        let ways: Vec<DVec3> = each
            .filter_map(|(was, now)| Some((*now)? - (*was)?))
            .collect();
        let mut by = DVec3::ZERO;
        if ways.len() >= LEAST_SHARED && f > self.at {
            by = median(&ways);
            let seconds = (f - self.at) as f64 / rate;
            let now = (by / seconds).clamp_length_max(FASTEST);
            self.velocity += (SPEED_LEARNT * seconds).min(1.0) * (now - self.velocity);
        }
        for (was, now) in self.joints.iter_mut().zip(now) {
            *was = now.or(was.map(|p| p + by));
        }
        self.at = f;
    }

    /// Goes on as one with somebody who was the same: of every frame what more views saw stays.
    pub(super) fn join(&mut self, other: Self) {
        let views = |moment: &Moment| moment.sights.iter().flatten().count();
        for ((f, moment), states) in other.moments.into_iter().zip(other.states) {
            match self.moments.binary_search_by_key(&f, |(own, _)| *own) {
                Ok(k) if views(&moment) > views(&self.moments[k].1) => {
                    (self.moments[k].1, self.states[k]) = (moment, states);
                }
                Ok(_) => {}
                Err(k) => {
                    self.moments.insert(k, (f, moment));
                    self.states.insert(k, states);
                }
            }
        }
        for (own, other) in self.proof.iter_mut().zip(other.proof) {
            *own = (*own).max(other);
        }
    }

    /// Adds a frame.
    pub(super) fn add(&mut self, views: &[View], f: usize, look: Look, rate: f64) {
        let known = look.joints.iter().flatten().count();
        self.seen = f;
        if look.is_met() {
            self.met = f;
            self.go(f, &look.joints, rate);
            if is_body(&look.joints) {
                self.proof[usize::from(look.count() < 3)] += 1;
                for (view, sight) in views.iter().zip(&look.sights) {
                    self.measure(view, sight.as_ref(), DISTANCE_LEARNT / rate);
                }
            }
        } else if let Some((view, sight)) = shows_most(views, &look.sights) {
            let now = self.followed(view, sight, DISTANCE_TAKEN / rate);
            self.go(f, &now, rate);
        }
        let joints = match known >= LEAST_SHARED {
            true => look.joints,
            false => [None; EVIDENCE_JOINTS],
        };
        let moment = Moment {
            sights: look.sights,
            joints,
            healed: 0,
            lifted: None,
            contours: Vec::new(),
        };
        self.moments.push((f, moment));
        self.states.push(look.states);
    }
}

/// Nobody yet.
pub(super) fn empty() -> Live {
    Live {
        moments: Vec::new(),
        states: Vec::new(),
        joints: [None; EVIDENCE_JOINTS],
        at: 0,
        velocity: DVec3::ZERO,
        farther: 1.0,
        met: 0,
        seen: 0,
        proof: [0; 2],
    }
}
