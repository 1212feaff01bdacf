//! Looks at one frame after the other and says what has happened.

use std::collections::BTreeMap;

use super::config::{EventConfig, Zone};
use super::hand::{Gesture, Hand, Seen};
use super::steady::Steady;
use crate::camera::RESTART_NS;
use crate::joints::{JOINT_NAMES, PELVIS};
use crate::message::{Body, BodyFrame, BodyState, Event, EventKind, Hand as Side, JointState};

/// People who have been away for so long are forgotten, seconds; identities are not given twice.
const FORGET: f64 = 3600.0;
/// Of what is seen after a camera has been silent for longer, what began before tells nothing, seconds; or for longer
/// than twice the time between its frames, where that is longer.
const SILENCE: f64 = 3.0;
/// Frames that are further apart are those of a camera that was away, seconds.
const SLOWEST: f64 = 60.0;

#[derive(Debug, Clone)]
struct Person {
    there: Steady<bool>,
    /// When they were last seen.
    seen: f64,
    /// Of the time since then, how long nobody looked, seconds.
    unwatched: f64,
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
    last: Option<Newest>,
    /// Whether ids begin anew with the next frame, whatever its number and time.
    begins_anew: bool,
    /// Between the frames before, the newest first, seconds: one pause makes no slow camera. Bodies that are
    /// extrapolated or held until the next picture comes are none, their number is that of the frame before.
    steps: [f64; 2],
}

/// The newest message that told something.
#[derive(Debug, Clone, Copy)]
struct Newest {
    /// Number of its frame.
    sequence: u64,
    /// Its time, and that of the first message with this number, nanoseconds.
    pose_ns: u64,
    began_ns: u64,
}

impl Detector {
    /// Nobody is there yet.
    pub fn new(config: EventConfig) -> Self {
        Self {
            config,
            people: BTreeMap::new(),
            main: Steady::new(None, 0.0),
            last: None,
            begins_anew: false,
            steps: [0.0; 2],
        }
    }

    /// Takes in a frame; what has happened by it. One that was overtaken by an extrapolated one tells nothing. Where
    /// numbers go back, or the clock by more than [`RESTART_NS`], or after [`begin_anew`](Self::begin_anew), ids begin
    /// anew: everybody has left and everything starts anew.
    pub fn look(&mut self, frame: &BodyFrame) -> Vec<Event> {
        let time = seconds(frame.pose_ns);
        let mut happened = Vec::new();
        let begins_anew = std::mem::take(&mut self.begins_anew);
        if let Some(last) = self.last {
            let goes_back = frame.sequence < last.sequence
                || frame.pose_ns.saturating_add(RESTART_NS) < last.pose_ns;
            if begins_anew || goes_back {
                happened = self.everybody_leaves(seconds(last.pose_ns));
                *self = Self::new(self.config.clone());
            } else if frame.pose_ns < last.pose_ns {
                return Vec::new();
            }
        }
        let silence = SILENCE.max(2.0 * self.steps[0].min(self.steps[1]));
        let last = self.last;
        let same = last.filter(|last| last.sequence == frame.sequence);
        self.last = Some(Newest {
            sequence: frame.sequence,
            pose_ns: frame.pose_ns,
            began_ns: same.map_or(frame.pose_ns, |last| last.began_ns),
        });
        if let Some(last) = last.filter(|_| same.is_none()) {
            let step = time - seconds(last.began_ns);
            self.steps = [step.min(SLOWEST), self.steps[0]];
        }
        let gap = last.map(|last| time - seconds(last.pose_ns));
        let unwatched = gap.filter(|gap| *gap > silence).unwrap_or_default();
        for body in frame
            .bodies()
            .iter()
            .filter(|b| b.state == BodyState::TRACKED)
        {
            let zones = self.config.zone.len();
            let person = self.people.entry(body.id).or_insert_with(|| Person {
                there: Steady::new(false, time),
                seen: time,
                unwatched: 0.0,
                has_been: false,
                zones: vec![Steady::new(false, time); zones],
                dwelt: vec![false; zones],
                hands: [Hand::new(time), Hand::new(time)],
            });
            person.seen = time;
        }
        for (&id, person) in &mut self.people {
            person.lapse(time, silence);
            person.leave_out(unwatched, time);
            let body = frame.bodies().iter().find(|b| b.id == id);
            let what = person.look(body, frame, time, &self.config);
            happened.extend(what.into_iter().map(|event| Event {
                person: id,
                ..event
            }));
        }
        self.people
            .retain(|_, p| p.there.get() || time - p.seen < FORGET);
        let nearest = self.nearest(frame);
        if nearest.is_some() {
            self.main.lapse(time, silence);
        }
        if let Some(main) = self.main.look(nearest, time, self.config.confirm) {
            happened.push(Event {
                person: main.unwrap_or(0),
                ..event(EventKind::MAIN_PERSON)
            });
        }
        happened
    }

    /// Says that the next frame is another recording's or another run's, which its number and time need not show.
    pub fn begin_anew(&mut self) {
        self.begins_anew = true;
    }

    /// What it means that nothing is seen any more after `last`.
    fn everybody_leaves(&mut self, last: f64) -> Vec<Event> {
        let mut happened = Vec::new();
        for (&id, person) in self.people.iter_mut().filter(|(_, p)| p.there.get()) {
            let mut what = Vec::new();
            person.leave(last, person.there.since(), &self.config, &mut what);
            happened.extend(what.into_iter().map(|event| Event {
                person: id,
                ..event
            }));
        }
        if self.main.get().is_some() {
            happened.push(event(EventKind::MAIN_PERSON));
        }
        happened
    }

    /// How many people are there.
    pub fn present(&self) -> usize {
        self.people.values().filter(|p| p.there.get()).count()
    }

    /// Who is the main person.
    pub fn main_person(&self) -> Option<u32> {
        self.main.get()
    }

    /// Who is nearest to the camera, or to what the settings say; the main person until somebody is nearer by far.
    fn nearest(&self, frame: &BodyFrame) -> Option<u32> {
        let is_there = |id: &u32| self.people.get(id).is_some_and(|p| p.there.get());
        let there = frame.bodies().iter().filter(|b| is_there(&b.id));
        let away: Vec<(u32, f64)> = there.map(|b| (b.id, self.away(b, frame))).collect();
        let by_far = |distance: f64| distance * (1.0 - self.config.nearer);
        // Whoever is out of sight for a moment stays it.
        let main = self.main.get().filter(is_there);
        let most = away.iter().find(|(id, _)| Some(*id) == main);
        let most = most.map(|(_, distance)| by_far(*distance));
        let nearer = |(_, distance): &&(u32, f64)| match most {
            Some(most) => distance.total_cmp(&most).is_lt(),
            None => true,
        };
        let Some(nearest) = away
            .iter()
            .filter(nearer)
            .min_by(|a, b| a.1.total_cmp(&b.1))
        else {
            return main;
        };
        // Of two side by side each is the nearer one by turns, and neither would ever be so for long enough: whoever is
        // about to become the main person stays so until somebody is nearer by far, too.
        let next = self.main.becomes().flatten();
        let stays = |(id, distance): &&(u32, f64)| {
            Some(*id) == next && by_far(*distance).total_cmp(&nearest.1).is_le()
        };
        let chosen = away.iter().filter(nearer).find(stays).unwrap_or(nearest);
        Some(chosen.0)
    }

    /// How far somebody is from the camera, or from what the settings say, metres.
    fn away(&self, body: &Body, frame: &BodyFrame) -> f64 {
        let pelvis = body.joints3d[PELVIS];
        match self.config.main_near.filter(|_| frame.world.is_known()) {
            Some([x, z]) => {
                let [at_x, _, at_z] = frame.world.point(pelvis).map(f64::from);
                (at_x - x).hypot(at_z - z)
            }
            None => {
                let squares = pelvis.iter().map(|c| f64::from(*c).powi(2));
                squares.sum::<f64>().sqrt()
            }
        }
    }
}

impl Person {
    /// Forgets what began before a camera fell silent. Not that somebody is away: who has gone meanwhile leaves.
    fn lapse(&mut self, time: f64, silence: f64) {
        if !self.there.get() {
            self.there.lapse(time, silence);
        }
        self.zones.iter_mut().for_each(|z| z.lapse(time, silence));
        self.hands.iter_mut().for_each(|h| h.lapse(time, silence));
    }

    /// Leaves the time in which nobody looked, before this frame, out of every stay. Who has gone meanwhile was there
    /// until last seen, which is before it. Both in seconds.
    fn leave_out(&mut self, unwatched: f64, time: f64) {
        self.unwatched += unwatched;
        if self.seen < time {
            return;
        }
        let unwatched = std::mem::take(&mut self.unwatched);
        if self.there.get() {
            self.there.put_off(unwatched);
            self.zones.iter_mut().for_each(|z| z.put_off(unwatched));
        }
    }

    fn look(
        &mut self,
        body: Option<&Body>,
        frame: &BodyFrame,
        time: f64,
        config: &EventConfig,
    ) -> Vec<Event> {
        let mut happened = Vec::new();
        let is_seen = self.seen == time;
        let hold = if is_seen { config.confirm } else { config.gone };
        let before = self.there.since();
        // Whether somebody has come who is missed in this frame, and still expected, it does not tell.
        let is_open = !is_seen && !self.there.get() && body.is_some();
        let changed = if is_open {
            self.there.lapse(time, config.confirm);
            None
        } else {
            self.there.look(is_seen, time, hold)
        };
        match changed {
            Some(true) if self.has_been => happened.push(Event {
                seconds: (self.there.since() - before) as f32,
                ..event(EventKind::CAME_BACK)
            }),
            Some(true) => {
                self.has_been = true;
                happened.push(event(EventKind::ENTERED));
            }
            Some(false) => {
                self.leave(time, before, config, &mut happened);
                self.there = Steady::new(false, self.seen);
                self.hands = [Hand::new(time), Hand::new(time)];
            }
            None => {}
        }
        let body = body.filter(|_| is_seen && self.there.get());
        match body.filter(|_| frame.world.is_known()) {
            Some(body) => {
                let [x, _, z] = frame.world.point(body.joints3d[PELVIS]).map(f64::from);
                self.look_at_zones([x, z], time, config, &mut happened);
            }
            None => {
                let zones = self.zones.iter_mut();
                zones.for_each(|zone| zone.lapse(time, config.confirm));
            }
        }
        for (n, hand) in [Side::RIGHT, Side::LEFT].into_iter().enumerate() {
            let seen = body.map(|body| seen_hand(body, frame, hand, config.confidence));
            let seen = seen.unwrap_or_default();
            for gesture in self.hands[n].look(seen, time, config) {
                let kind = match gesture {
                    Gesture::Raised => EventKind::HAND_RAISED,
                    Gesture::Lowered => EventKind::HAND_LOWERED,
                    Gesture::Waved => EventKind::WAVED,
                };
                happened.push(Event {
                    hand,
                    ..event(kind)
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
        happened: &mut Vec<Event>,
    ) {
        for (n, zone) in config.zone.iter().enumerate() {
            let state = &mut self.zones[n];
            let before = state.since();
            match state.look(zone.holds(place), time, config.confirm) {
                Some(true) => {
                    self.dwelt[n] = false;
                    happened.push(of_zone(EventKind::ZONE_ENTERED, zone, 0.0));
                }
                Some(false) => {
                    let seconds = state.since() - before;
                    happened.push(of_zone(EventKind::ZONE_LEFT, zone, seconds));
                }
                None => {}
            }
            let seconds = time - state.since();
            let long = zone.dwell.is_some_and(|dwell| seconds >= dwell);
            if state.get() && long && !self.dwelt[n] {
                self.dwelt[n] = true;
                happened.push(of_zone(EventKind::DWELT, zone, seconds));
            }
        }
    }

    /// Somebody who was there from `since` on has left.
    fn leave(&mut self, time: f64, since: f64, config: &EventConfig, happened: &mut Vec<Event>) {
        self.leave_zones(time, config, happened);
        // Of the time in which the camera was away nobody knows.
        happened.push(Event {
            seconds: (self.seen - since) as f32,
            ..event(EventKind::LEFT)
        });
    }

    fn leave_zones(&mut self, time: f64, config: &EventConfig, happened: &mut Vec<Event>) {
        for (zone, state) in config.zone.iter().zip(&mut self.zones) {
            if state.get() {
                let seconds = self.seen - state.since();
                happened.push(of_zone(EventKind::ZONE_LEFT, zone, seconds));
            }
            *state = Steady::new(false, time);
        }
    }
}

fn seconds(ns: u64) -> f64 {
    ns as f64 * 1e-9
}

fn event(kind: EventKind) -> Event {
    Event {
        kind,
        ..Event::default()
    }
}

fn of_zone(kind: EventKind, zone: &Zone, seconds: f64) -> Event {
    let mut event = Event {
        seconds: seconds as f32,
        ..event(kind)
    };
    event.set_zone(&zone.name);
    event
}

/// Where a hand is, as far as the joints that this is measured between are seen well enough.
fn seen_hand(body: &Body, frame: &BodyFrame, side: Side, least: f32) -> Seen {
    let prefix = if side == Side::RIGHT { "r" } else { "l" };
    let joint = |name: &str| {
        let j = JOINT_NAMES.iter().position(|n| *n == name)?;
        if body.joint_states[j] != JointState::OBSERVED || body.confidence[j] < least {
            return None;
        }
        let [x, y, z] = body.joints3d[j];
        let upright = match frame.world.is_known() {
            true => frame.world.point([x, y, z]),
            false => [x, -y, -z],
        };
        Some(upright.map(f64::from))
    };
    let of_side = |name: &str| joint(&format!("{prefix}_{name}"));
    let wrist = of_side("wrist");
    let above = |other: Option<[f64; 3]>| Some(wrist?[1] - other?[1]);
    let beside = || {
        let (wrist, elbow) = (wrist?, of_side("elbow")?);
        let (right, left) = (joint("r_shoulder")?, joint("l_shoulder")?);
        // To the person's left, along the floor.
        let [sx, sz] = [left[0] - right[0], left[2] - right[2]];
        let width = sx.hypot(sz).max(1e-3);
        let [dx, dz] = [wrist[0] - elbow[0], wrist[2] - elbow[2]];
        Some((dx * sx + dz * sz) / width)
    };
    Seen {
        above_head: above(joint("head_top")),
        above_shoulder: above(of_side("shoulder")),
        beside: beside(),
    }
}
