//! One person over time. In: the evidence that identity gave to this person. Out: the fitted pose. XNect §5.2.

mod bones;
mod first_pose;
mod gate;
mod known;

use glam::{DVec2, DVec3};

use crate::body::skeleton::LIMBS;
use crate::body::skeleton::{BoneLengths, Pose, Posed, Skeleton};
use crate::camera::translation::DEPTHS;
use crate::fit::config::FitConfig;
use crate::fit::energy::{ANKLES, Feet};
use crate::fit::energy::{Motion, MotionModel};
use crate::fit::energy::{PoseSolver, Problem, Solution};
use crate::fit::energy::{Targets, no_targets};
use crate::fit::evidence::Evidence;
use crate::fit::evidence::OneEuro;
use crate::fit::evidence::SwapMemory;
use crate::fit::evidence::Trust;
use crate::fit::evidence::place;
use crate::fit::identity::Appearance;
use crate::fit::scene::{Stature, lower};
use crate::joints::{BODY_JOINTS, DOF, EVIDENCE_JOINTS, PELVIS};
use crate::message::JointState;
use crate::solve::Effort;
use bones::Bones;
pub use first_pose::{best_branch, first_pose};
use gate::{Gate, Verdict};
pub use known::KnownJoint;

/// E3D weight of each joint: trunk and head are seen, ends of limbs are guessed. Falls with the error that Stage II has
/// on rendered clips, 16 mm at the hips, 130 mm at the wrists.
pub const WEIGHTS_3D: [f64; BODY_JOINTS] = [
    1.5, 2.0, 1.5, 0.8, 0.5, 1.5, 0.8, 0.5, 4.0, 1.0, 0.6, 4.0, 1.0, 0.6, 0.0, 3.0, 1.5, 0.3, 0.3,
    0.4, 0.4,
];
/// Share of its E3D weight that a joint keeps when its pixel was not seen.
const UNSEEN_3D: f64 = 0.35;
/// Evidence joints behind each body joint that is not one itself.
pub const SEEN_THROUGH: [usize; BODY_JOINTS] = [
    0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 8, 1, 0, 4, 7, 10, 13,
];
/// Standard deviation of an angle about rest, radians: only decides what nothing else does.
const REST_SIGMA: f64 = 1.5;
/// A joint farther than this (metres) from its prediction is an outlier.
const OUTLIER: f64 = 0.35;
/// Energy of a limb (two joints) above which another pose for it is tried.
const LIMB_STUCK: f64 = 14.0;
/// Mean cost of a joint, in variances, from which on a frame tells nothing of bones.
const STRAINED: f64 = 3.0;
/// Somebody not seen for this long (seconds) who is this far (metres, in the picture) from the expected place is placed
/// anew.
const REACQUIRE_AFTER: f64 = 0.25;
const REACQUIRE_APART: f64 = 0.2;
/// What is seen tells left from right better than the prediction does where nobody was seen for longer than this,
/// seconds, or where pictures are farther apart and knees and ankles are predicted to swing by more than this on
/// average, metres: in a fifth of a second the legs of a runner pass each other.
const SIDES_TOLD: f64 = 0.15;
const MOST_SWING: f64 = 0.25;
const KNEES: [usize; 2] = [9, 12];
/// Who is seen this many times as far away as they are expected, nearer than anybody is placed, is placed anew, too: of
/// a pose at the lens or behind it nothing is in the picture that could pull it back.
const FARTHER: f64 = 1.25;

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
    filters2d: [OneEuro<2>; EVIDENCE_JOINTS],
    filters3d: [OneEuro<3>; BODY_JOINTS],
    gates2d: [Gate; EVIDENCE_JOINTS],
    gates3d: [Gate; BODY_JOINTS],
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
            filters2d: [OneEuro::default(); EVIDENCE_JOINTS],
            filters3d: [OneEuro::default(); BODY_JOINTS],
            gates2d: [Gate::default(); EVIDENCE_JOINTS],
            gates3d: [Gate::default(); BODY_JOINTS],
            swaps: SwapMemory::default(),
            trust,
            first_look: Some(Box::new(evidence.clone())),
        };
        let pose = track.pose;
        track.start_filters(evidence);
        let mut targets = track.first_targets(evidence, evidence.root?.z, cx);
        let solution = cold_solve(
            &mut targets,
            &pose,
            track.bones.lengths(),
            cx,
            &mut track.posed,
        );
        track.pose = solution.pose;
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
        self.filter(&mut evidence, &expected, dt, cx);
        let depth = predicted.position.z.max(0.3);
        let mut targets = self.targets(&evidence, predicted, depth, cx);
        targets.contacts = self.feet.contacts(&cx.config.terms, self.unseen + dt);
        targets.weights_motion = self.motion.weights(cx.model);
        let lengths = *self.bones.lengths();
        let mut solution = cx.solver.solve(
            &problem(cx.skeleton, &lengths, &targets),
            &predicted,
            Effort::WARM,
            &mut self.posed,
        );
        if evidence.known3d {
            self.free_limbs(&mut targets, &mut solution, &lengths, cx);
        }
        predicted = targets.predicted;
        if !solution.pose.is_finite() {
            // Never seen to happen; the prediction is finite because every pose before it was.
            solution.pose = predicted;
            cx.skeleton.pose(&predicted, &lengths, &mut self.posed);
        }
        let innovation = solution.pose.step_from(&predicted);
        self.motion
            .correct(&innovation, &solution.information, &targets.weights_motion);
        self.pose = solution.pose;
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
        for f in &mut self.filters2d {
            f.skip(dt);
        }
        for f in &mut self.filters3d {
            f.skip(dt);
        }
        if self.unseen > 0.3 {
            self.feet.lift();
            for f in &mut self.filters2d {
                f.reset();
            }
            for f in &mut self.filters3d {
                f.reset();
            }
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

    /// Takes over identity, proportions, height and looks of somebody recognised who was seen `gone` seconds ago. What
    /// the newcomer's own first look tells is added: where frames are far apart everybody is a newcomer in each.
    pub fn succeed(&mut self, old: Track, gone: f64, cx: &mut Context<'_>) {
        self.id = old.id;
        self.turn = old.turn;
        self.bones = old.bones;
        self.stature = old.stature;
        self.appearance_age = 0.0;
        match (&mut self.appearance, old.appearance) {
            (Some(now), Some(before)) => now.blend(&before, 0.5),
            (now, before) => *now = now.or(before),
        }
        match self.first_look.take() {
            Some(evidence) => self.fit_again(&evidence, gone, cx),
            None => cx
                .skeleton
                .pose(&self.pose, self.bones.lengths(), &mut self.posed),
        }
    }

    /// Fits the first observation with the proportions of whoever was recognised by it, last seen `gone` seconds ago,
    /// and adds what it tells of proportions and height.
    fn fit_again(&mut self, evidence: &Evidence, gone: f64, cx: &mut Context<'_>) {
        let targets = self.first_targets(evidence, self.pose.position.z.max(0.3), cx);
        if self.tells_lengths(evidence, &targets) {
            self.bones
                .update(cx.skeleton, &evidence.points3d, &self.posed, gone);
        }
        let lengths = *self.bones.lengths();
        let found = cx.solver.solve(
            &problem(cx.skeleton, &lengths, &targets),
            &self.pose,
            Effort::COLD,
            &mut self.posed,
        );
        if found.pose.is_finite() {
            self.pose = found.pose;
        } else {
            // Never seen to happen; the first fit is finite.
            cx.skeleton.pose(&self.pose, &lengths, &mut self.posed);
        }
        self.settle(evidence, &targets);
        self.stature
            .update(cx.config, &self.posed, &self.states, gone);
    }

    /// Where the person is expected `dt` seconds from now.
    pub fn expected(&self, dt: f64, cx: &Context<'_>, out: &mut Posed) -> Pose {
        let mut pose = self.motion.ahead(&self.pose, dt, cx.model);
        cx.skeleton.clamp(&mut pose.angles);
        cx.skeleton.pose(&pose, self.bones.lengths(), out);
        pose
    }

    /// Whether the prediction says nothing: somebody comes back elsewhere than expected or turned round, too far for
    /// the filters to follow, or is expected at the lens and is not there.
    fn lost_sight(&self, evidence: &Evidence, expected: &Posed) -> bool {
        let depth = expected.joints[PELVIS].z;
        let seen_farther = |root: DVec3| root.z > FARTHER * depth;
        let is_elsewhere = || {
            let apart = evidence.distance2d(expected, 1.0);
            apart.is_some_and(|d| d > REACQUIRE_APART) || evidence.is_turned_from(expected)
        };
        depth < DEPTHS[0] && evidence.root.is_some_and(seen_farther)
            || self.unseen > REACQUIRE_AFTER && is_elsewhere()
    }

    /// Starts the pose from this observation alone, keeping identity and proportions.
    fn reacquire(&mut self, evidence: &Evidence, dt: f64, cx: &mut Context<'_>) -> bool {
        let Some(mut fresh) = Self::start(evidence, cx) else {
            return false;
        };
        fresh.id = self.id;
        fresh.turn = self.turn;
        fresh.first_score = self.first_score;
        fresh.hits = self.hits.saturating_add(1);
        fresh.age = self.age + dt;
        if self.unseen == 0.0 {
            fresh.seen_for = self.seen_for + dt;
        }
        fresh.swaps = SwapMemory::doubting_the_prediction();
        fresh.bones = self.bones.clone();
        fresh.appearance = self.appearance;
        fresh.looked_at = self.looked_at;
        fresh.appearance_age = self.appearance_age + dt;
        fresh.stature = self.stature;
        cx.skeleton
            .pose(&fresh.pose, fresh.bones.lengths(), &mut fresh.posed);
        *self = fresh;
        true
    }

    fn start_filters(&mut self, evidence: &Evidence) {
        let config = crate::fit::config::OneEuroConfig::default();
        for j in 0..EVIDENCE_JOINTS {
            if evidence.confidence[j] > 0.0 {
                self.filters2d[j].update(evidence.plane[j].to_array(), 0.0, 1.0, &config);
            }
        }
        if evidence.known3d {
            for j in 0..BODY_JOINTS {
                self.filters3d[j].update(evidence.points3d[j].to_array(), 0.0, 1.0, &config);
            }
        }
    }

    /// 1€ filters with outliers held back: a joint that jumps away from its prediction is left out for a moment.
    fn filter(&mut self, e: &mut Evidence, expected: &Posed, dt: f64, cx: &Context<'_>) {
        let root = expected.joints[PELVIS];
        let depth = root.z.max(0.3);
        for j in 0..EVIDENCE_JOINTS {
            let filter = &mut self.filters2d[j];
            if e.confidence[j] == 0.0 {
                filter.skip(dt);
                continue;
            }
            let p = expected.joints[j];
            let far = p.z > 0.2 && ((p.truncate() / p.z - e.plane[j]) * depth).length() > OUTLIER;
            match self.gates2d[j].look(far, dt) {
                Verdict::HeldBack => {
                    e.confidence[j] = 0.0;
                    filter.skip(dt);
                    continue;
                }
                Verdict::Anew => filter.reset(),
                Verdict::Counts => {}
            }
            let smooth = filter.update(e.plane[j].to_array(), dt, depth, &cx.config.filter2d);
            e.plane[j] = DVec2::from_array(smooth);
        }
        for j in 0..BODY_JOINTS {
            let filter = &mut self.filters3d[j];
            if !(e.known3d && e.tells3d[j]) {
                filter.skip(dt);
                continue;
            }
            let far = (expected.joints[j] - root - e.points3d[j]).length() > OUTLIER;
            match self.gates3d[j].look(far, dt) {
                Verdict::HeldBack => {
                    filter.skip(dt);
                    continue;
                }
                Verdict::Anew => filter.reset(),
                Verdict::Counts => {}
            }
            let smooth = filter.update(e.points3d[j].to_array(), dt, 1.0, &cx.config.filter3d);
            e.points3d[j] = DVec3::from_array(smooth);
        }
    }

    /// Targets of a first observation, which nothing predicts.
    fn first_targets(&self, e: &Evidence, depth: f64, cx: &Context<'_>) -> Targets {
        let mut targets = self.targets(e, self.pose, depth, cx);
        targets.weights_motion = [0.0; DOF];
        targets
    }

    fn targets(&self, e: &Evidence, predicted: Pose, depth: f64, cx: &Context<'_>) -> Targets {
        let terms = &cx.config.terms;
        let mut targets = no_targets(predicted);
        targets.depth = depth;
        targets.points2d = e.plane;
        targets.points3d = e.points3d;
        for j in 0..EVIDENCE_JOINTS {
            targets.weights2d[j] = terms.reprojection * e.confidence[j] / terms.sigma2d.powi(2);
        }
        if e.known3d {
            for j in 0..BODY_JOINTS {
                let seen = e.confidence[SEEN_THROUGH[j]] > 0.0;
                let held_back = self.gates3d[j].holds();
                let share = if held_back || !e.tells3d[j] {
                    0.0
                } else if seen {
                    1.0
                } else {
                    UNSEEN_3D
                };
                targets.weights3d[j] =
                    terms.position * WEIGHTS_3D[j] * share / terms.sigma3d.powi(2);
            }
        }
        targets.weight_rest = 1.0 / (REST_SIGMA * REST_SIGMA);
        targets
    }

    /// Tries the closed form on limbs whose joints lie far from what is seen, and keeps what lowers the energy clearly.
    fn free_limbs(
        &mut self,
        targets: &mut Targets,
        solution: &mut Solution,
        lengths: &BoneLengths,
        cx: &mut Context<'_>,
    ) {
        for limb in LIMBS {
            let strain = targets.joint_cost(&self.posed, limb.middle)
                + targets.joint_cost(&self.posed, limb.end);
            if strain < LIMB_STUCK {
                continue;
            }
            let Some(angles) = best_branch(
                cx.skeleton,
                limb,
                &self.posed,
                &targets.points3d,
                &solution.pose.angles,
            ) else {
                continue;
            };
            let mut trial = targets.clone();
            let mut start = solution.pose;
            for (k, angle) in limb.angles(cx.skeleton).into_iter().zip(angles) {
                start.angles[k] = angle;
                trial.predicted.angles[k] = angle;
                trial.weights_motion[6 + k] = 0.0;
            }
            let mut posed = Posed::default();
            let found = cx.solver.solve(
                &problem(cx.skeleton, lengths, &trial),
                &start,
                Effort::WARM,
                &mut posed,
            );
            if found.cost < solution.cost - 0.4 * strain {
                for k in limb.angles(cx.skeleton) {
                    trial.predicted.angles[k] = found.pose.angles[k];
                    self.motion.restart(6 + k);
                }
                *targets = trial;
                *solution = found;
                self.posed = posed;
            }
        }
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
        let torso = [1, 2, 5, 8, 11].iter().all(|&j| e.confidence[j] > 0.0);
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

/// XNect's order for a first frame: angles from 3D, then everything.
fn cold_solve(
    targets: &mut Targets,
    start: &Pose,
    lengths: &BoneLengths,
    cx: &mut Context<'_>,
    posed: &mut Posed,
) -> Solution {
    let weights2d = std::mem::replace(&mut targets.weights2d, [0.0; EVIDENCE_JOINTS]);
    let first = cx.solver.solve(
        &problem(cx.skeleton, lengths, targets),
        start,
        Effort::COLD,
        posed,
    );
    targets.weights2d = weights2d;
    cx.solver.solve(
        &problem(cx.skeleton, lengths, targets),
        &first.pose,
        Effort::COLD,
        posed,
    )
}

fn problem<'a>(
    skeleton: &'a Skeleton,
    lengths: &'a BoneLengths,
    targets: &'a Targets,
) -> Problem<'a> {
    Problem {
        skeleton,
        lengths,
        targets,
    }
}
