//! One person over time. In: the evidence that identity gave to this person. Out: the fitted pose. XNect §5.2.

mod bones;
mod filters;
mod first_pose;
mod gate;
mod known;
mod regain;
mod running_mean;
mod solving;
mod targets;

use glam::DVec3;

use self::bones::Bones;
use self::filters::Filters;
pub use self::first_pose::{best_branch, first_pose};
pub use self::known::KnownJoint;
pub use self::running_mean::{RunningMean, look_of_its_own};
use self::solving::cold_solve;
pub use self::targets::{SEEN_THROUGH, WEIGHTS_3D};
use crate::body::skeleton::{Pose, Posed, Skeleton};
use crate::fit::appearance::Appearance;
use crate::fit::config::FitConfig;
use crate::fit::energy::{Feet, Motion, MotionModel, PoseSolver, Problem, Targets};
use crate::fit::evidence::{Evidence, SwapMemory, Trust, place};
use crate::fit::scene::{Stature, lower};
use crate::joints::{
    ANKLES, BODY_JOINTS, EVIDENCE_JOINTS, KNEES, L_HIP, L_SHOULDER, NECK, PELVIS, R_HIP, R_SHOULDER,
};
use crate::message::JointState;
use crate::solve::Effort;

/// Mean cost of a joint, in variances, from which on a frame tells nothing of bones.
const STRAINED: f64 = 3.0;
/// What is seen tells left from right better than the prediction does where nobody was seen for longer than this,
/// seconds, or where pictures are farther apart and knees and ankles are predicted to swing by more than this on
/// average, metres: in a fifth of a second the legs of a runner pass each other.
const SIDES_TOLD: f64 = 0.15;
const MOST_SWING: f64 = 0.25;

/// What every track of a fitter shares.
#[derive(Debug)]
pub struct Context<'a> {
    /// The articulated body.
    pub skeleton: &'a Skeleton,
    /// Settings.
    pub config: &'a FitConfig,
    /// How people move.
    pub model: &'a MotionModel,
    /// Working memory.
    pub solver: &'a mut PoseSolver,
}

/// One person: identity, pose and everything that is remembered.
#[derive(Debug, Clone)]
pub struct Track {
    /// Identity; 0 until confirmed.
    pub id: u32,
    /// Score of the first observation, 0–1.
    pub first_score: f64,
    /// Observations so far.
    pub hits: u32,
    /// Seconds since the person was first seen.
    pub age: f64,
    /// Seconds since then, or since the person was last missed.
    pub seen_for: f64,
    /// Seconds since the person was last seen.
    pub unseen: f64,
    /// The pose now, at canonical stature.
    pub pose: Pose,
    /// Its forward kinematics.
    pub posed: Posed,
    /// Rotation vector of the pelvis as it was last published, to which the next one is near.
    pub turn: DVec3,
    /// Velocities.
    pub motion: Motion,
    /// Proportions.
    pub bones: Bones,
    /// Remembered appearance.
    pub appearance: Option<Appearance>,
    /// Seconds for which the person's looks were seen.
    pub looked_at: f64,
    /// Seconds since the appearance was refreshed.
    pub appearance_age: f64,
    /// Height.
    pub stature: Stature,
    /// Standing feet.
    pub feet: Feet,
    /// How each joint is known.
    pub states: [JointState; BODY_JOINTS],
    /// Recent distance between fit and Stage II, metres.
    pub deviations: [f64; BODY_JOINTS],
    /// How likely each evidence joint's last observation was right, 0–1; 0: not seen.
    pub seen_right: [f64; EVIDENCE_JOINTS],
    filters: Filters,
    swaps: SwapMemory,
    trust: Trust,
    /// The observation that the pose was started from, until the next one: whoever is recognised by it is fitted again.
    first_look: Option<Box<Evidence>>,
}

impl Track {
    /// Starts a person from a first observation; `None` if it does not determine a pose.
    pub fn start(evidence: &Evidence, cx: &mut Context<'_>) -> Option<Self> {
        let evidence = &mut evidence.clone();
        let trust = Trust::first(evidence);
        let mut track = Self {
            id: 0,
            first_score: evidence.score,
            hits: 0,
            age: 0.0,
            seen_for: 0.0,
            unseen: 0.0,
            pose: first_pose(cx.skeleton, evidence.root?, &evidence.points3d)?,
            posed: Posed::default(),
            turn: DVec3::ZERO,
            motion: Motion::default(),
            bones: Bones::new(cx.skeleton),
            appearance: None,
            looked_at: 0.0,
            appearance_age: 0.0,
            stature: Stature::default(),
            feet: Feet::default(),
            states: [JointState::PREDICTED; BODY_JOINTS],
            deviations: [0.05; BODY_JOINTS],
            seen_right: evidence.confidence,
            filters: Filters::started(evidence),
            swaps: SwapMemory::default(),
            trust,
            first_look: Some(Box::new(evidence.clone())),
        };
        let pose = track.pose;
        let mut targets = track.targets(evidence, pose, evidence.root?.z, cx);
        let solution = cold_solve(&mut targets, &pose, track.bones.lengths(), cx);
        (track.pose, track.posed) = (solution.pose, solution.posed);
        track.settle(evidence, &targets);
        track.stature.first(cx.config, &track.posed, &track.states);
        track.hits = 1;
        (track.pose.is_finite()).then_some(track)
    }

    /// Takes in evidence, `dt` seconds after the pose.
    pub fn observe(&mut self, mut evidence: Evidence, dt: f64, cx: &mut Context<'_>) {
        self.first_look = None;
        let mut predicted = self.motion.predict(&self.pose, dt, cx.model);
        let mut expected = Posed::default();
        cx.skeleton
            .pose(&predicted, self.bones.lengths(), &mut expected);
        if self.lost_sight(&evidence, &expected) && self.reacquire(&evidence, dt, cx) {
            return;
        }
        let swings = || self.unseen + dt > SIDES_TOLD && self.swing(&expected) > MOST_SWING;
        if self.unseen > SIDES_TOLD || swings() {
            self.swaps = SwapMemory::doubting_the_prediction();
        }
        self.swaps.undo(&mut evidence, &expected, dt);
        evidence.root = place(&evidence, Some(predicted.position.z));
        self.trust.judge(&mut evidence, dt);
        self.filters.smooth(&mut evidence, &expected, dt, cx.config);
        let depth = predicted.position.z.max(0.3);
        let mut targets = self.targets(&evidence, predicted, depth, cx);
        targets.contacts = self.feet.contacts(&cx.config.terms, self.unseen + dt);
        targets.prior.weights = self.motion.weights(cx.model);
        let lengths = *self.bones.lengths();
        let problem = Problem::new(cx.skeleton, &lengths, &targets);
        let mut solution = cx.solver.solve(&problem, &predicted, Effort::WARM);
        if evidence.known3d {
            self.free_limbs(&mut targets, &mut solution, &lengths, cx);
        }
        predicted = targets.prior.predicted;
        if !solution.pose.is_finite() {
            // Never seen to happen; the prediction is finite because every pose before it was.
            solution.pose = predicted;
            cx.skeleton.pose(&predicted, &lengths, &mut solution.posed);
        }
        let innovation = solution.pose.step_from(&predicted);
        self.motion
            .correct(&innovation, &solution.information, &targets.prior.weights);
        (self.pose, self.posed) = (solution.pose, solution.posed);
        self.seen_for = if self.unseen > 0.0 {
            0.0
        } else {
            self.seen_for + dt
        };
        self.unseen = 0.0;
        self.hits = self.hits.saturating_add(1);
        self.age += dt;
        self.appearance_age += dt;
        self.settle_after(&evidence, &targets, dt, cx);
    }

    /// Whether the person has never been missed.
    pub fn is_steady(&self) -> bool {
        self.seen_for >= self.age
    }

    /// Lets `dt` seconds pass without evidence.
    pub fn coast(&mut self, dt: f64, cx: &mut Context<'_>) {
        self.pose = self.motion.coast(&self.pose, dt, cx.model);
        cx.skeleton.clamp(&mut self.pose.angles);
        cx.skeleton
            .pose(&self.pose, self.bones.lengths(), &mut self.posed);
        self.age += dt;
        self.unseen += dt;
        self.appearance_age += dt;
        self.states = [JointState::PREDICTED; BODY_JOINTS];
        self.filters.skip(dt);
        if self.unseen > 0.3 {
            self.feet.lift();
            self.filters.reset();
        }
    }

    /// How far the prediction takes knees and ankles about the pelvis on average, metres.
    fn swing(&self, expected: &Posed) -> f64 {
        let about = |posed: &Posed, j: usize| posed.joints[j] - posed.joints[PELVIS];
        let legs = KNEES.into_iter().chain(ANKLES);
        let sum: f64 = legs
            .map(|j| about(expected, j).distance(about(&self.posed, j)))
            .sum();
        sum / (KNEES.len() + ANKLES.len()) as f64
    }

    /// Where feet stand, canonical stature: those at rest, else the lower one of somebody who walks. `down`: unit
    /// vector towards the floor, camera axes.
    pub fn standing(&self, down: DVec3) -> impl Iterator<Item = DVec3> + '_ {
        let resting = self.feet.places().next().is_some();
        let seen = ANKLES
            .into_iter()
            .filter(|&ankle| self.states[ankle] == JointState::OBSERVED)
            .map(|ankle| self.posed.joints[ankle]);
        let lower = lower(seen, down).filter(|_| !resting);
        self.feet.places().chain(lower)
    }

    /// Where the person is expected `dt` seconds from now.
    pub fn expected(&self, dt: f64, cx: &Context<'_>, out: &mut Posed) -> Pose {
        let mut pose = self.motion.ahead(&self.pose, dt, cx.model);
        cx.skeleton.clamp(&mut pose.angles);
        cx.skeleton.pose(&pose, self.bones.lengths(), out);
        pose
    }

    /// What the confidence of a joint rests on, `ahead` seconds after the person was last looked at.
    pub fn known(&self, joint: usize, ahead: f64) -> KnownJoint {
        KnownJoint {
            state: self.states[joint],
            seen_right: self.seen_right[SEEN_THROUGH[joint]],
            deviation: self.deviations[joint],
            unseen: self.unseen + ahead,
        }
    }

    fn settle_after(&mut self, e: &Evidence, targets: &Targets, dt: f64, cx: &Context<'_>) {
        let share = (dt / 0.3).min(1.0);
        if e.known3d {
            for j in (0..BODY_JOINTS).filter(|&j| e.tells3d[j]) {
                let d = (self.posed.joints[j] - self.posed.joints[PELVIS] - e.points3d[j]).length();
                self.deviations[j] += share * (d - self.deviations[j]);
            }
        }
        self.seen_right = e.confidence;
        self.settle(e, targets);
        if self.tells_lengths(e, targets) {
            self.bones.update(cx.skeleton, &e.points3d, &self.posed, dt);
        }
        self.feet.update(
            cx.skeleton,
            &self.posed,
            &self.motion.velocity,
            &self.states,
            dt,
        );
        self.stature
            .update(cx.config, &self.posed, &self.states, dt);
    }

    /// Whether an observation shows enough of the person, and the fit agrees with it well enough, to measure bones.
    fn tells_lengths(&self, e: &Evidence, targets: &Targets) -> bool {
        let torso = [NECK, R_SHOULDER, L_SHOULDER, R_HIP, L_HIP]
            .iter()
            .all(|&j| e.confidence[j] > 0.0);
        let strain: f64 = (0..BODY_JOINTS)
            .map(|j| targets.joint_cost(&self.posed, j))
            .sum();
        let known = e.known3d && e.tells3d == [true; BODY_JOINTS];
        torso && known && e.joints_seen() >= 10 && strain < STRAINED * BODY_JOINTS as f64
    }

    fn settle(&mut self, e: &Evidence, targets: &Targets) {
        for j in 0..BODY_JOINTS {
            let through = SEEN_THROUGH[j];
            // Beyond three standard deviations, or at the lens, the pose does not rest on this observation.
            let deviation = targets.deviation2d(&self.posed, through);
            let seen = e.confidence[through] > 0.0 && deviation.is_some_and(|d| d < 9.0);
            self.states[j] = if seen {
                JointState::OBSERVED
            } else {
                JointState::OCCLUDED
            };
        }
    }
}
