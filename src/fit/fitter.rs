//! The whole of Stage III. In: observation frames in order. Out: bodies with identities, at the frame's time or, on
//! request, a little later. Pure and deterministic: time comes from the frames alone. XNect §5; docs/fit.md.
//!
//! People are fitted one after the other: ten take less than waking a second thread for each would.

use crate::assignment::assign;
use crate::body::skeleton::{Posed, Skeleton, rotation_vector_near};
use crate::camera::RESTART_NS;
use crate::fit::config::{ConfigError, FitConfig};
use crate::fit::energy::MotionModel;
use crate::fit::energy::PoseSolver;
use crate::fit::evidence::Evidence;
use crate::fit::identity::Appearance;
use crate::fit::identity::{
    Look, confirmation, confirmed, dissimilarity, looks_may_tell, overlap, reidentification,
};
use crate::fit::publish::Header;
use crate::fit::publish::write_body;
use crate::fit::scene::FloorEstimate;
use crate::fit::scene::FloorPlane;
use crate::fit::scene::Lean;
use crate::fit::scene::SteadyFloor;
use crate::fit::scene::assumed;
use crate::fit::track::{Context, KnownJoint, Track};
use crate::joints::{BODY_JOINTS, CANONICAL_STATURE};
use crate::message::{
    Body, BodyFrame, FLAG_END_OF_STREAM, FLAG_FILE_TIME, MAX_PEOPLE, ObservationFrame,
};

/// Shortest and longest step between frames, seconds.
const STEP: [f64; 2] = [1e-3, 1.0];
/// Longest interval that a camera's frames may usually have, seconds: what is longer is a gap.
const LONGEST_INTERVAL: f64 = 10.0;
/// Most people remembered after they left.
const MAX_REMEMBERED: usize = 64;
/// Share of the threshold for people without identity: chance must not confirm anybody.
const NEWCOMER: f64 = 0.5;
/// Seconds that a newcomer without looks waits for them, while they may tell that it is somebody who was here.
const WAIT_FOR_LOOKS: f64 = 2.0;
/// How far a floor of the settings may be off, radians: who measures it is wrong by some degrees.
const GIVEN_ERROR: f64 = 3.0 * std::f64::consts::PI / 180.0;
/// Seconds between looks at standing feet.
const FEET_EVERY: f64 = 0.3;

/// Counters of a fitter's life.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct FitCounters {
    /// Frames taken in.
    pub frames: u64,
    /// Frames left out because they were older than the newest.
    pub stale_frames: u64,
    /// Times the input started over, or a gap was longer than people are remembered.
    pub restarts: u64,
    /// Identities given.
    pub births: u64,
    /// People recognised when they came back.
    pub returns: u64,
}

/// One person of a frame: geometry and looks.
type PersonEvidence = (Evidence, Option<Appearance>);

#[derive(Debug, Clone)]
struct Gone {
    track: Track,
    /// Seconds since they were seen.
    away: f64,
}

impl From<Track> for Gone {
    fn from(track: Track) -> Self {
        Self {
            away: track.unseen,
            track,
        }
    }
}

/// Stage III: identity, filters, bone lengths, fit.
#[derive(Debug)]
pub struct Fitter {
    config: FitConfig,
    model: MotionModel,
    solver: PoseSolver,
    /// Tentative people and those with an identity, seen or missed for a moment.
    present: Vec<Track>,
    gone: Vec<Gone>,
    next_id: u32,
    header: Option<Header>,
    feet: FloorEstimate,
    floor: SteadyFloor,
    lean: Lean,
    since_feet: f64,
    /// Seconds that the machine slept since the newest frame.
    slept: f64,
    /// Seconds between the two newest frames, at most [`LONGEST_INTERVAL`].
    interval: Option<f64>,
    counters: FitCounters,
}

/// Somebody known who is not seen at the moment: index into the present or into those gone.
#[derive(Debug, Clone, Copy)]
enum Absent {
    Present(usize),
    Gone(usize),
}

impl Fitter {
    /// A fitter that has seen nobody.
    ///
    /// # Errors
    /// [`ConfigError`] if a setting is out of range.
    pub fn new(config: FitConfig) -> Result<Self, ConfigError> {
        config.check()?;
        let skeleton = Skeleton::builtin();
        Ok(Self {
            model: MotionModel::new(skeleton, &config.terms, &config.prediction),
            config,
            solver: PoseSolver::default(),
            present: Vec::new(),
            gone: Vec::new(),
            next_id: 1,
            header: None,
            feet: FloorEstimate::default(),
            floor: SteadyFloor::default(),
            lean: Lean::default(),
            since_feet: 0.0,
            slept: 0.0,
            interval: None,
            counters: FitCounters::default(),
        })
    }

    /// The settings.
    pub fn config(&self) -> &FitConfig {
        &self.config
    }

    /// What happened so far.
    pub fn counters(&self) -> FitCounters {
        self.counters
    }

    /// The floor: from the settings, else as standing feet tell it. An estimated floor is as large or small as the
    /// stature that people are assumed to have.
    pub fn ground(&self) -> Option<FloorPlane> {
        match &self.config.ground {
            Some(known) => FloorPlane::from_config(known),
            None => self.feet.floor().map(|floor| FloorPlane {
                normal: floor.ground.normal,
                offset: floor.ground.offset * assumed(&self.config) / CANONICAL_STATURE as f64,
            }),
        }
    }

    /// The floor of the settings.
    fn given(&self) -> Option<FloorPlane> {
        self.config
            .ground
            .as_ref()
            .and_then(FloorPlane::from_config)
    }

    /// Takes from everybody the lean that all seem to have, where a floor tells what is upright.
    fn set_upright(&mut self, seen: &mut [PersonEvidence], dt: f64) {
        let given = self.given();
        let Some(up) = self.floor.ground(given).map(|ground| ground.normal) else {
            return;
        };
        let error = match (given, self.feet.floor()) {
            (Some(_), _) => GIVEN_ERROR,
            // The world follows what is found slowly.
            (None, Some(found)) => found.pitch_error + found.ground.normal.angle_between(up),
            // Lost: the camera was moved.
            (None, None) => f64::INFINITY,
        };
        let people = seen.iter().map(|(evidence, _)| evidence);
        let people: Vec<&Evidence> = people.filter(|_| error.is_finite()).collect();
        let watched = !self.present.is_empty();
        self.lean.look(&people, up, error, dt, watched);
        for (evidence, _) in seen {
            self.lean.take_from(evidence, up);
        }
    }

    /// Looks at who stands where: the floor, and how tall they are beside each other.
    fn learn_ground(&mut self, dt: f64) {
        if !self.config.estimate_ground || self.config.ground.is_some() {
            return;
        }
        self.since_feet += dt;
        if self.since_feet >= FEET_EVERY {
            self.since_feet = 0.0;
            let down = self.feet.down();
            for track in self.present.iter().filter(|t| t.id != 0 && t.unseen == 0.0) {
                for place in track.standing(down) {
                    self.feet.add(track.id, place);
                }
            }
            self.feet.update();
        }
        self.floor.follow(self.ground(), dt);
        if let Some(floor) = self.feet.floor() {
            for track in self.present.iter_mut().filter(|t| t.id != 0) {
                if let Some(share) = floor.stature(track.id) {
                    track.stature.follow(&self.config, share, dt);
                }
            }
        }
    }

    /// Tracks held in memory: present ones, with and without identity, and those remembered after they left.
    pub fn remembered(&self) -> usize {
        self.present.len() + self.gone.len()
    }

    /// What the confidence of everybody's joints rests on, in the newest frame, by identity.
    pub fn known_joints(&self) -> impl Iterator<Item = (u32, [KnownJoint; BODY_JOINTS])> {
        let named = self.present.iter().filter(|t| t.id != 0);
        named.map(|t| (t.id, std::array::from_fn(|j| t.known(j, 0.0))))
    }

    /// Takes in a frame and writes everyone with an identity into `out`, `pose_ns` being the frame's `capture_ns`.
    /// `publish_ns` and `fit_us` are left to whoever publishes.
    ///
    /// A frame that is not newer than the newest, whatever its number, changes nothing and yields the newest bodies; a
    /// step back of more than half a second, or from the times of a file to those of a camera, starts over with nobody
    /// present and no floor (identities are never given again). After more than a second without a frame everybody is
    /// looked for anew and recognised at first sight; after a gap longer than the identities' memory people are
    /// forgotten, the floor is not. An end of stream without people changes nothing.
    pub fn update(&mut self, frame: &ObservationFrame, out: &mut BodyFrame) {
        let ended = frame.flags & FLAG_END_OF_STREAM != 0;
        if ended && frame.count == 0 {
            if let Some(header) = &mut self.header {
                header.flags = frame.flags;
            } else {
                self.header = Some(Header::of(frame));
            }
            let pose_ns = self.header.map_or(frame.capture_ns, |h| h.capture_ns);
            self.publish(pose_ns, 0.0, out);
            return;
        }
        let Some(passed) = self.step(frame) else {
            self.counters.stale_frames += 1;
            let pose_ns = self.header.map_or(frame.capture_ns, |h| h.capture_ns);
            self.publish(pose_ns, 0.0, out);
            return;
        };
        let (dt, pause) = (passed.min(STEP[1]), (passed > STEP[1]).then_some(passed));
        for gone in &mut self.gone {
            gone.away += passed;
        }
        self.counters.frames += 1;
        let header = Header::of(frame);
        if self.header.is_some_and(|last| !last.same_camera(&header)) {
            self.forget_floor();
        }
        self.header = Some(header);
        let camera = header.intrinsics;
        let mut seen: Vec<PersonEvidence> = frame
            .people()
            .iter()
            .filter_map(|person| {
                let evidence = Evidence::new(person, &camera, self.config.min_joint_confidence)?;
                Some((evidence, Appearance::new(person)))
            })
            .collect();
        self.set_upright(&mut seen, dt);
        let matches = self.match_people(&seen, dt);
        self.advance(&seen, &matches, dt);
        self.start_people(&seen, &matches);
        self.confirm(pause);
        self.learn_ground(dt);
        self.forget();
        for track in &mut self.present {
            track.turn = rotation_vector_near(track.pose.rotation, track.turn);
        }
        self.publish(frame.capture_ns, 0.0, out);
    }

    /// Says that the machine slept for so long since the newest frame, seconds. Frames' times stand still meanwhile,
    /// people do not: it is like a pause without frames.
    pub fn slept(&mut self, seconds: f64) {
        self.slept += seconds.max(0.0);
    }

    /// Writes everyone as they are expected at `pose_ns`, at most `prediction.max` seconds after the newest frame.
    /// Changes nothing: call it as often as the display wants.
    pub fn predict(&self, pose_ns: u64, out: &mut BodyFrame) {
        let newest = self.header.map_or(pose_ns, |h| h.capture_ns);
        let most = (self.config.prediction.max * 1e9) as u64;
        let ahead = pose_ns.saturating_sub(newest).min(most);
        self.publish(newest.saturating_add(ahead), ahead as f64 * 1e-9, out);
    }

    /// Seconds since the last frame; `None` for a stale frame. Starts over where the input did.
    fn step(&mut self, frame: &ObservationFrame) -> Option<f64> {
        let Some(last) = self.header else {
            self.slept = 0.0;
            return Some(STEP[0]);
        };
        if self.config.stills {
            self.present.clear();
            self.gone.clear();
            self.forget_floor();
            return Some(STEP[0]);
        }
        let (now, before) = (frame.capture_ns, last.capture_ns);
        if (frame.flags ^ last.flags) & FLAG_FILE_TIME != 0 {
            self.start_over();
            return Some(STEP[0]);
        }
        if now <= before {
            if before - now <= RESTART_NS {
                return None;
            }
            self.start_over();
            return Some(STEP[0]);
        }
        let slept = std::mem::take(&mut self.slept);
        let interval = (now - before) as f64 * 1e-9;
        let dt = interval + slept;
        // Of the first two frames nobody knows whether there is a gap between them.
        let interval = interval.min(LONGEST_INTERVAL);
        let usual = self.interval.replace(interval).unwrap_or(interval);
        if dt - usual > self.config.identity.memory.max(STEP[1]) {
            // The camera is the same: where it was moved meanwhile, feet will contradict the floor.
            self.forget_people();
            return Some(STEP[0]);
        }
        if dt > STEP[1] {
            // A long pause: everybody is somewhere else now, but may be recognised. Those without identity are
            // remembered until the next frame: where frames are so far apart, somebody seen in two of them has been
            // seen often enough.
            self.gone.extend(self.present.drain(..).map(Gone::from));
        }
        Some(dt.max(STEP[0]))
    }

    fn start_over(&mut self) {
        self.slept = 0.0;
        self.interval = None;
        self.forget_people();
        self.forget_floor();
    }

    /// Starts over with nobody.
    fn forget_people(&mut self) {
        self.present.clear();
        self.gone.clear();
        self.counters.restarts += 1;
    }

    /// Another view: feet that stood before say nothing about it.
    fn forget_floor(&mut self) {
        self.feet = FloorEstimate::default();
        self.floor.forget();
        self.lean = Lean::default();
        self.since_feet = 0.0;
    }

    /// The track of every person seen. Those with an identity choose first: a newcomer must not take an observation
    /// from somebody known because it fits a little better.
    fn match_people(&mut self, seen: &[PersonEvidence], dt: f64) -> Vec<Option<usize>> {
        let cx = Context {
            skeleton: Skeleton::builtin(),
            config: &self.config,
            model: &self.model,
            solver: &mut self.solver,
        };
        let config = &self.config.identity;
        let mut matches = vec![None; seen.len()];
        let mut expected = Posed::default();
        for known in [true, false] {
            let tracks: Vec<usize> = (0..self.present.len())
                .filter(|&t| (self.present[t].id != 0) == known)
                .collect();
            let free: Vec<usize> = (0..seen.len()).filter(|&i| matches[i].is_none()).collect();
            let mut costs = Vec::with_capacity(free.len() * tracks.len());
            for &t in &tracks {
                let track = &self.present[t];
                track.expected(dt, &cx, &mut expected);
                for &i in &free {
                    let (evidence, looks) = &seen[i];
                    costs.push(dissimilarity(
                        track,
                        &expected,
                        evidence,
                        looks.as_ref(),
                        dt,
                        config,
                    ));
                }
            }
            let limit = config.threshold * if known { 1.0 } else { NEWCOMER };
            let pairs = assign(&costs, tracks.len(), free.len(), limit);
            for (row, pair) in pairs.iter().enumerate() {
                if let Some(column) = pair {
                    matches[free[*column]] = Some(tracks[row]);
                }
            }
        }
        matches
    }

    /// Fits everyone who was seen, lets the others coast.
    fn advance(&mut self, seen: &[PersonEvidence], matches: &[Option<usize>], dt: f64) {
        let mut cx = Context {
            skeleton: Skeleton::builtin(),
            config: &self.config,
            model: &self.model,
            solver: &mut self.solver,
        };
        for (t, track) in self.present.iter_mut().enumerate() {
            match matches.iter().position(|m| *m == Some(t)) {
                Some(person) => {
                    let (evidence, looks) = &seen[person];
                    let alone = is_alone(seen, person);
                    if let Some(looks) = looks {
                        remember_looks(track, looks, alone, dt, self.config.identity.refresh);
                    }
                    track.observe(evidence.clone(), dt, &mut cx);
                }
                None => track.coast(dt, &mut cx),
            }
        }
    }

    /// Starts a track for everyone whom nobody owns.
    fn start_people(&mut self, seen: &[PersonEvidence], matches: &[Option<usize>]) {
        let mut cx = Context {
            skeleton: Skeleton::builtin(),
            config: &self.config,
            model: &self.model,
            solver: &mut self.solver,
        };
        for ((evidence, looks), owner) in seen.iter().zip(matches) {
            if owner.is_some() || self.present.len() >= 2 * MAX_PEOPLE {
                continue;
            }
            if let Some(mut track) = Track::start(evidence, &mut cx) {
                track.appearance = *looks;
                self.present.push(track);
            }
        }
    }

    /// Gives identities to those seen often enough: their old one if they are recognised. `pause`: seconds since the
    /// last frame, if these are long.
    fn confirm(&mut self, pause: Option<f64>) {
        let config = &self.config.identity;
        let after_pause = pause.is_some();
        let absent = self.absent();
        let known = || {
            let each = absent.iter().map(|(who, gone)| (self.track(*who), *gone));
            each.filter(|(track, _)| track.id != 0)
        };
        // Waiting only tells newcomers from those who come back: with nobody away there is nothing to wait for. After
        // a pause everybody is away, and at such a pace no second look would ever come.
        let nobody_waited_for = after_pause || known().next().is_none();
        let is_sure = |track: &Track| nobody_waited_for && track.first_score >= config.sure_score;
        let often_enough = |track: &Track| {
            self.config.stills
                || after_pause
                || is_sure(track)
                || track.hits >= config.confirm_hits
                || track.hits >= 2 && track.is_steady() && track.age >= config.confirm_time
        };
        let ready: Vec<usize> = (0..self.present.len())
            .filter(|&t| {
                let track = &self.present[t];
                let waits = || {
                    let looks_may_come = track.appearance.is_none() && track.age < WAIT_FOR_LOOKS;
                    let mut known = known();
                    looks_may_come
                        && !after_pause
                        && known.any(|(left, gone)| looks_may_tell(track, left, gone))
                };
                track.id == 0 && track.unseen == 0.0 && often_enough(track) && !waits()
            })
            .collect();
        if ready.is_empty() {
            return;
        }
        let mut costs = Vec::with_capacity(ready.len() * absent.len());
        for &t in &ready {
            for (who, gone) in &absent {
                let (newcomer, left) = (&self.present[t], self.track(*who));
                costs.push(reidentification(newcomer, left, *gone, config));
            }
        }
        let pairs = assign(&costs, ready.len(), absent.len(), 1.0);
        // Newcomers where somebody stood in the last frame, long ago, as whom nobody of this one is recognised.
        let is_confirmed = confirmed(&pairs, absent.len(), |newcomer, k| {
            let (who, away) = absent[k];
            match pause {
                Some(pause) if away <= pause => {
                    let newcomer = &self.present[ready[newcomer]];
                    confirmation(newcomer, self.track(who), away, config)
                }
                _ => f64::INFINITY,
            }
        });
        let (mut from_present, mut from_gone) = (Vec::new(), Vec::new());
        for ((&t, pair), is_confirmed) in ready.iter().zip(pairs).zip(is_confirmed) {
            let Some(who) = pair else {
                let track = &self.present[t];
                let apart = track.age / f64::from(track.hits.saturating_sub(1).max(1));
                let telling = track.is_steady() && apart >= config.confirm_time;
                if track.age < config.birth_time
                    && !telling
                    && !is_sure(track)
                    && !self.config.stills
                    && !is_confirmed
                {
                    continue;
                }
                self.present[t].id = self.next_id;
                self.next_id = self.next_id.wrapping_add(1).max(1);
                self.counters.births += 1;
                continue;
            };
            let (who, gone) = absent[who];
            match who {
                Absent::Present(p) => from_present.push(p),
                Absent::Gone(g) => from_gone.push(g),
            }
            let old = self.track(who).clone();
            let mut cx = Context {
                skeleton: Skeleton::builtin(),
                config: &self.config,
                model: &self.model,
                solver: &mut self.solver,
            };
            self.present[t].succeed(old, gone, &mut cx);
            if self.present[t].id != 0 {
                self.counters.returns += 1;
                continue;
            }
            self.present[t].id = self.next_id;
            self.next_id = self.next_id.wrapping_add(1).max(1);
            self.counters.births += 1;
        }
        remove_all(&mut self.present, from_present);
        remove_all(&mut self.gone, from_gone);
    }

    /// Who may stand here under another name, with the seconds since they were seen: those missed for a moment as well
    /// as those who left.
    fn absent(&self) -> Vec<(Absent, f64)> {
        let present = self.present.iter().enumerate();
        let missed = present
            .filter(|(_, t)| t.id != 0 && t.unseen > 0.0)
            .map(|(p, t)| (Absent::Present(p), t.unseen));
        let gone = self.gone.iter().enumerate();
        missed
            .chain(gone.map(|(g, gone)| (Absent::Gone(g), gone.away)))
            .collect()
    }

    fn track(&self, who: Absent) -> &Track {
        match who {
            Absent::Present(p) => &self.present[p],
            Absent::Gone(g) => &self.gone[g].track,
        }
    }

    /// Lets go of those missed for too long, and of the memory of those who left long ago.
    fn forget(&mut self) {
        let config = &self.config.identity;
        let mut t = 0;
        while t < self.present.len() {
            let track = &self.present[t];
            let grace = if track.id == 0 {
                config.tentative_grace
            } else {
                config.grace.max(config.hold)
            };
            let broken = !(track.pose.is_finite() && track.motion.is_finite());
            if broken || track.unseen > grace {
                let track = self.present.swap_remove(t);
                if track.id != 0 && !broken {
                    self.gone.push(Gone::from(track));
                }
            } else {
                t += 1;
            }
        }
        self.gone
            .retain(|g| g.track.id != 0 && g.away <= config.memory);
        self.gone
            .sort_by(|a, b| b.away.total_cmp(&a.away).then(a.track.id.cmp(&b.track.id)));
        let extra = self.gone.len().saturating_sub(MAX_REMEMBERED);
        self.gone.drain(..extra);
    }

    fn publish(&self, pose_ns: u64, ahead: f64, out: &mut BodyFrame) {
        let Some(header) = self.header else {
            *out = BodyFrame {
                pose_ns,
                ..BodyFrame::default()
            };
            return;
        };
        let grace = self.config.identity.grace;
        let shown = |t: &&Track| t.id != 0 && t.unseen <= grace && !header.has_left(t);
        let mut known: Vec<&Track> = self.present.iter().filter(shown).collect();
        // Those seen first, should there be more than fit.
        known.sort_by(|a, b| a.unseen.total_cmp(&b.unseen).then(a.id.cmp(&b.id)));
        known.truncate(MAX_PEOPLE);
        known.sort_by_key(|t| t.id);
        header.write(pose_ns, out);
        out.count = known.len() as u32;
        out.world = self.floor.world(self.given());
        for (body, track) in out.bodies.iter_mut().zip(&known) {
            write_body(
                track,
                ahead,
                &header.intrinsics,
                &self.config,
                &self.model,
                body,
            );
        }
        out.bodies[known.len()..].fill(Body::default());
    }
}

fn remove_all<T>(items: &mut Vec<T>, mut indices: Vec<usize>) {
    indices.sort_unstable();
    for i in indices.into_iter().rev() {
        items.remove(i);
    }
}

/// Whether nobody else stands before a person, or behind.
fn is_alone(seen: &[PersonEvidence], person: usize) -> bool {
    let (evidence, _) = &seen[person];
    let mut others = seen.iter().enumerate().filter(|(i, _)| *i != person);
    !others.any(|(_, (other, _))| overlap(evidence.bounds(), other.bounds()))
}

/// Learns the looks of new people, seen `dt` seconds after the last, and refreshes those of others now and then, while
/// nobody stands before them.
fn remember_looks(track: &mut Track, looks: &Appearance, alone: bool, dt: f64, refresh: f64) {
    let look = Look {
        hits: track.hits,
        looked_at: track.looked_at,
        age: track.appearance_age,
        alone,
    };
    track.looked_at += dt;
    let share = match &track.appearance {
        None => Some(1.0),
        Some(_) => look.share(refresh),
    };
    let Some(share) = share else {
        return;
    };
    track.appearance.get_or_insert(*looks).blend(looks, share);
    track.appearance_age = 0.0;
}
