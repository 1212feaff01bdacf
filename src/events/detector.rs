//! Looks at one frame after the other and says what has happened.

use std::collections::BTreeMap;

use serde::Serialize;

use super::config::EventConfig;
use super::hand::{Gesture, Hand, Seen};
use super::steady::Steady;
use crate::joints::{JOINT_NAMES, PELVIS};
use crate::message::{Body, BodyFrame, BodyState, JointState};

/// People who have been away for so long are forgotten, seconds; identities are not given twice.
const FORGET: f64 = 3600.0;

/// Something that has happened.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Event {
    /// Number of the frame in which it was certain.
    pub frame: u64,
    /// The time of that frame's bodies, nanoseconds.
    pub time_ns: u64,
    /// Whom it is about; none where nobody is the main person any more.
    pub person: Option<u32>,
    /// What.
    #[serde(flatten)]
    pub what: Happening,
}

/// What has happened. Times are seconds.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "event", rename_all = "snake_case")]
pub enum Happening {
    /// Somebody is there for the first time.
    Entered,
    /// Somebody is away.
    Left {
        /// How long they were there.
        seconds: f64,
    },
    /// Somebody who had left is there again.
    CameBack {
        /// How long they were away.
        seconds: f64,
    },
    /// Somebody has stepped into a zone.
    ZoneEntered {
        /// Its name.
        zone: String,
    },
    /// Somebody has stepped out of a zone, or left while in it.
    ZoneLeft {
        /// Its name.
        zone: String,
        /// How long they were in it.
        seconds: f64,
    },
    /// Somebody has been in a zone for its `dwell`.
    Dwelt {
        /// Its name.
        zone: String,
        /// How long by now.
        seconds: f64,
    },
    /// A hand is above the head.
    HandRaised {
        /// Which.
        hand: Side,
    },
    /// A raised hand is below the shoulder again.
    HandLowered {
        /// Which.
        hand: Side,
    },
    /// A hand has gone to and fro.
    Waved {
        /// Which.
        hand: Side,
    },
    /// Another person is the nearest.
    MainPerson,
}

/// The person's own left or right.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Side {
    /// Left.
    Left,
    /// Right.
    Right,
}

#[derive(Debug, Clone)]
struct Person {
    there: Steady<bool>,
    /// When they were last seen.
    seen: f64,
    has_been: bool,
    zones: Vec<Steady<bool>>,
    dwelt: Vec<bool>,
    hands: [Hand; 2],
}

/// Everybody of one camera.
#[derive(Debug, Clone)]
pub struct Detector {
    config: EventConfig,
    people: BTreeMap<u32, Person>,
    main: Steady<Option<u32>>,
    last: Option<f64>,
}

impl Detector {
    /// Nobody is there yet.
    pub fn new(config: EventConfig) -> Self {
        Self {
            config,
            people: BTreeMap::new(),
            main: Steady::new(None, 0.0),
            last: None,
        }
    }

    /// Takes in a frame; what has happened by it. A clock that goes back starts everything anew.
    pub fn look(&mut self, frame: &BodyFrame) -> Vec<Event> {
        let time = frame.pose_ns as f64 * 1e-9;
        if self.last.is_some_and(|last| time < last) {
            *self = Self::new(self.config.clone());
        }
        self.last = Some(time);
        let mut happened: Vec<(Option<u32>, Happening)> = Vec::new();
        for body in frame
            .bodies()
            .iter()
            .filter(|b| b.state == BodyState::TRACKED)
        {
            let zones = self.config.zone.len();
            let person = self.people.entry(body.id).or_insert_with(|| Person {
                there: Steady::new(false, time),
                seen: time,
                has_been: false,
                zones: vec![Steady::new(false, time); zones],
                dwelt: vec![false; zones],
                hands: [Hand::new(time), Hand::new(time)],
            });
            person.seen = time;
        }
        for (&id, person) in &mut self.people {
            let body = frame.bodies().iter().find(|b| b.id == id);
            let what = person.look(body, frame, time, &self.config);
            happened.extend(what.into_iter().map(|what| (Some(id), what)));
        }
        self.people.retain(|_, p| time - p.seen < FORGET);
        let nearest = self.nearest(frame);
        if let Some(main) = self.main.look(nearest, time, self.config.confirm) {
            happened.push((main, Happening::MainPerson));
        }
        let event = |(person, what)| Event {
            frame: frame.sequence,
            time_ns: frame.pose_ns,
            person,
            what,
        };
        happened.into_iter().map(event).collect()
    }

    /// Who is nearest to the camera; the main person until somebody is nearer by far.
    fn nearest(&self, frame: &BodyFrame) -> Option<u32> {
        let there = |b: &&Body| self.people.get(&b.id).is_some_and(|p| p.there.get());
        let distance = |b: &Body| {
            let away = b.joints3d[PELVIS].iter().map(|c| f64::from(*c).powi(2));
            let away = away.sum::<f64>().sqrt();
            match self.main.get() == Some(b.id) {
                true => away * (1.0 - self.config.nearer),
                false => away,
            }
        };
        let all = frame.bodies().iter().filter(there);
        let nearest = all.min_by(|a, b| distance(a).total_cmp(&distance(b)));
        // Whoever is out of sight for a moment stays it.
        let main = self
            .main
            .get()
            .filter(|id| self.people.get(id).is_some_and(|p| p.there.get()));
        nearest.map(|b| b.id).or(main)
    }
}

impl Person {
    fn look(
        &mut self,
        body: Option<&Body>,
        frame: &BodyFrame,
        time: f64,
        config: &EventConfig,
    ) -> Vec<Happening> {
        let mut happened = Vec::new();
        let is_seen = self.seen == time;
        let hold = if is_seen { config.confirm } else { config.gone };
        let before = self.there.since();
        match self.there.look(is_seen, time, hold) {
            Some(true) if self.has_been => happened.push(Happening::CameBack {
                seconds: self.there.since() - before,
            }),
            Some(true) => {
                self.has_been = true;
                happened.push(Happening::Entered);
            }
            Some(false) => {
                self.leave_zones(time, config, &mut happened);
                happened.push(Happening::Left {
                    seconds: self.there.since() - before,
                });
                self.hands = [Hand::new(time), Hand::new(time)];
            }
            None => {}
        }
        let Some(body) = body.filter(|_| is_seen && self.there.get()) else {
            return happened;
        };
        if frame.world.is_known() {
            let [x, _, z] = frame.world.point(body.joints3d[PELVIS]).map(f64::from);
            self.look_at_zones([x, z], time, config, &mut happened);
        }
        for (n, hand) in [Side::Right, Side::Left].into_iter().enumerate() {
            let seen = seen_hand(body, frame, hand, config.confidence);
            for gesture in self.hands[n].look(seen, time, config) {
                happened.push(match gesture {
                    Gesture::Raised => Happening::HandRaised { hand },
                    Gesture::Lowered => Happening::HandLowered { hand },
                    Gesture::Waved => Happening::Waved { hand },
                });
            }
        }
        happened
    }

    fn look_at_zones(
        &mut self,
        place: [f64; 2],
        time: f64,
        config: &EventConfig,
        happened: &mut Vec<Happening>,
    ) {
        for (n, zone) in config.zone.iter().enumerate() {
            let state = &mut self.zones[n];
            let before = state.since();
            let name = || zone.name.clone();
            match state.look(zone.holds(place), time, config.confirm) {
                Some(true) => {
                    self.dwelt[n] = false;
                    happened.push(Happening::ZoneEntered { zone: name() });
                }
                Some(false) => happened.push(Happening::ZoneLeft {
                    zone: name(),
                    seconds: state.since() - before,
                }),
                None => {}
            }
            let seconds = time - state.since();
            let long = zone.dwell.is_some_and(|dwell| seconds >= dwell);
            if state.get() && long && !self.dwelt[n] {
                self.dwelt[n] = true;
                happened.push(Happening::Dwelt {
                    zone: name(),
                    seconds,
                });
            }
        }
    }

    fn leave_zones(&mut self, time: f64, config: &EventConfig, happened: &mut Vec<Happening>) {
        for (zone, state) in config.zone.iter().zip(&mut self.zones) {
            if state.get() {
                happened.push(Happening::ZoneLeft {
                    zone: zone.name.clone(),
                    seconds: self.seen - state.since(),
                });
            }
            *state = Steady::new(false, time);
        }
    }
}

/// Where a hand is, if its joints are seen well enough.
fn seen_hand(body: &Body, frame: &BodyFrame, side: Side, least: f32) -> Option<Seen> {
    let prefix = if side == Side::Right { "r" } else { "l" };
    let index = |name: &str| JOINT_NAMES.iter().position(|n| *n == name);
    let joint = |name: &str| {
        let j = index(name)?;
        let [x, y, z] = body.joints3d[j];
        let upright = match frame.world.is_known() {
            true => frame.world.point([x, y, z]),
            false => [x, -y, -z],
        };
        Some((j, upright.map(f64::from)))
    };
    let (wrist_index, wrist) = joint(&format!("{prefix}_wrist"))?;
    let (_, elbow) = joint(&format!("{prefix}_elbow"))?;
    let (_, shoulder) = joint(&format!("{prefix}_shoulder"))?;
    let (_, head) = joint("head_top")?;
    let (_, right) = joint("r_shoulder")?;
    let (_, left) = joint("l_shoulder")?;
    if body.joint_states[wrist_index] != JointState::OBSERVED
        || body.confidence[wrist_index] < least
    {
        return None;
    }
    // To the person's left, along the floor.
    let [sx, sz] = [left[0] - right[0], left[2] - right[2]];
    let width = sx.hypot(sz).max(1e-3);
    let [dx, dz] = [wrist[0] - elbow[0], wrist[2] - elbow[2]];
    Some(Seen {
        above_head: wrist[1] - head[1],
        above_shoulder: wrist[1] - shoulder[1],
        beside: (dx * sx + dz * sz) / width,
    })
}
