//! The whole of Stage III. In: observation frames in order. Out: bodies with identities, at the frame's time or, on
//! request, a little later. Pure and deterministic: time comes from the frames alone. XNect §5; docs/fit.md.
//!
//! People are fitted one after the other: ten take less than waking a second thread for each would.

mod clock;
mod floor;
mod identities;
mod people;

use self::clock::STEP;
use self::identities::Gone;
use crate::body::skeleton::{Skeleton, rotation_vector_near};
use crate::fit::appearance::Appearance;
use crate::fit::config::{ConfigError, FitConfig};
use crate::fit::energy::{MotionModel, PoseSolver};
use crate::fit::evidence::Evidence;
use crate::fit::publish::{Header, write_body};
use crate::fit::scene::{FloorEstimate, Lean, SteadyFloor};
use crate::fit::track::{KnownJoint, Track};
use crate::joints::BODY_JOINTS;
use crate::message::{Body, BodyFrame, FLAG_END_OF_STREAM, MAX_PEOPLE, ObservationFrame};

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
    /// Seconds between the two newest frames, at most what `clock` allows.
    interval: Option<f64>,
    counters: FitCounters,
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
