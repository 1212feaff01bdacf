//! One person over time, as several views see them: the pose in world axes, how they are built and how they look.

use glam::DVec3;

use super::build::Build;
use super::energy::{Targets, ViewTarget};
use super::looks::Looks;
use super::met::{agree, mean_distance, meet, relative};
use super::seen::Seen;
use crate::body::skeleton::{Dof, LIMBS, Pose, Posed, Skeleton};
use crate::camera::View;
use crate::fit::{
    FitConfig, InSpace, Motion, MotionModel, MotionPrior, PoseSolver, Problem, SEEN_THROUGH,
    Solution, WEIGHTS_3D, best_branch, first_pose,
};
use crate::joints::{BODY_JOINTS, CANONICAL_STATURE, EVIDENCE_JOINTS, L_HIP, NECK, PELVIS, R_HIP};
use crate::message::JointState;
use crate::multiview::exchange::is_crossed;
use crate::multiview::people::{is_body, reach};
use crate::multiview::triangulate::Joints3d;
use crate::solve::Effort;

/// Share of its E3D weight before one camera that a joint keeps which so many views see: none, one, more. Several views
/// know where it is.
const SHARE_3D: [f64; 3] = [0.2, 0.56, 0.056];
/// The same of joints that no view sees by themselves: hands, tips of feet, middle of the head, spine.
const HIDDEN_3D: f64 = 0.28;
/// A limb is stuck where its joints lie so far from where rays meet, metres.
const STUCK: f64 = 0.15;
/// Rays meet in a joint when their mean robust cost is no more than this, square metres, however many they are.
const MET: f64 = 0.0035;
/// Seconds after which limbs that most views call by the other side's name are believed, or shoulders that point
/// another way than hips are not.
const PERSISTENCE: f64 = 0.4;
/// Joints that must be known for a pose to start.
const LEAST_JOINTS: usize = 8;

/// What all people of a fit share.
#[derive(Debug)]
pub struct Context<'a> {
    /// The cameras.
    pub views: &'a [View],
    /// Settings.
    pub config: &'a FitConfig,
    /// How people move.
    pub model: &'a MotionModel,
    /// Working memory.
    pub solver: &'a mut PoseSolver,
}

/// One person: identity, pose and everything that is remembered.
#[derive(Debug, Clone)]
pub struct Person {
    /// Identity; 0 until confirmed.
    pub id: u32,
    /// The pose now, world axes, metres.
    pub pose: Pose,
    /// Its forward kinematics.
    pub posed: Posed,
    /// Rotation vector of the pelvis as it was last published, to which the next one is near.
    pub turn: DVec3,
    /// Velocities.
    pub motion: Motion,
    /// Bone lengths and stature.
    pub build: Build,
    /// Remembered looks, one a view.
    pub looks: Vec<Looks>,
    /// Seconds, from instant to instant, for which three views or more have agreed about them, and two.
    pub proof: [f64; 2],
    /// Seconds since they were seen first.
    pub age: f64,
    /// Seconds since any view saw them.
    pub unseen: f64,
    /// Seconds since two views did.
    pub apart: f64,
    /// By view, whether it saw them when somebody last did.
    pub seen_by: Vec<bool>,
    /// Where they were when looks alone began to speak against a view whose rays meet those of the one that follows
    /// them, world axes, metres.
    pub doubted: Option<DVec3>,
    /// How each joint is known.
    pub states: [JointState; BODY_JOINTS],
    /// Recent distance between fit and where rays meet, metres.
    pub deviations: [f64; BODY_JOINTS],
    /// Seconds for which most views have called limbs by the other side's name, or shoulders have pointed another way
    /// than hips.
    pub(super) exchanged: f64,
}

impl Person {
    /// Starts a person from the detections of a group; `None` if they are no body.
    pub fn start(mut seen: Vec<Option<Seen>>, cx: &mut Context<'_>) -> Option<Self> {
        agree(cx.views, &mut seen);
        let joints = meet(cx.views, &seen);
        if !is_body(&joints.points) {
            return None;
        }
        let mut person = Self {
            id: 0,
            pose: Pose::facing_camera(0.0),
            posed: Posed::default(),
            turn: DVec3::ZERO,
            motion: Motion::default(),
            build: Build::new(Skeleton::builtin(), &joints.points, cx.config.height),
            looks: seen.iter().map(|s| Looks::first(s.as_ref())).collect(),
            proof: [0.0; 2],
            age: 0.0,
            unseen: 0.0,
            apart: 0.0,
            seen_by: seen.iter().map(Option::is_some).collect(),
            doubted: None,
            states: [JointState::OCCLUDED; BODY_JOINTS],
            deviations: [0.05; BODY_JOINTS],
            exchanged: 0.0,
        };
        person.restart(&seen, &joints, cx)?;
        person.settle(&seen, &joints, 0.0);
        Some(person)
    }

    /// Somebody of whom nothing else is known.
    #[cfg(test)]
    pub fn standing(id: u32) -> Self {
        let skeleton = Skeleton::builtin();
        let pose = Pose::facing_camera(0.0);
        let mut posed = Posed::default();
        skeleton.pose(&pose, skeleton.lengths(), &mut posed);
        Self {
            id,
            pose,
            posed,
            turn: DVec3::ZERO,
            motion: Motion::default(),
            build: Build::new(skeleton, &[None; EVIDENCE_JOINTS], None),
            looks: Vec::new(),
            proof: [0.0; 2],
            age: 0.0,
            unseen: 0.0,
            apart: 0.0,
            seen_by: Vec::new(),
            doubted: None,
            states: [JointState::OCCLUDED; BODY_JOINTS],
            deviations: [0.05; BODY_JOINTS],
            exchanged: 0.0,
        }
    }

    /// Where the person is expected `dt` seconds from now.
    pub fn ahead(&self, dt: f64, model: &MotionModel) -> (Pose, Posed) {
        let skeleton = Skeleton::builtin();
        let mut pose = self.motion.ahead(&self.pose, dt, model);
        skeleton.clamp(&mut pose.angles);
        let mut posed = Posed::default();
        skeleton.pose(&pose, self.build.lengths(), &mut posed);
        (pose, posed)
    }

    /// Takes in what views saw, one entry a view, `dt` seconds after the pose.
    pub fn observe(&mut self, mut seen: Vec<Option<Seen>>, dt: f64, cx: &mut Context<'_>) {
        let skeleton = Skeleton::builtin();
        let as_told = seen.clone();
        let predicted = self.motion.predict(&self.pose, dt, cx.model);
        let mut expected = Posed::default();
        skeleton.pose(&predicted, self.build.lengths(), &mut expected);
        let count = seen.iter().flatten().count();
        let mut healed = 0;
        for (view, seen) in cx.views.iter().zip(&mut seen) {
            if let Some(seen) = seen {
                healed += usize::from(seen.follow(view, &expected.joints) > 0);
            }
        }
        // A pose that had the sides wrong from the start would call every view wrong for ever.
        let mut joints = meet(cx.views, &seen);
        let most = 2 * healed > count || is_crossed(&joints.points) == Some(true);
        self.exchanged = if most {
            self.exchanged + dt
        } else {
            (self.exchanged - dt).max(0.0)
        };
        let wrong_sides = most && self.exchanged > PERSISTENCE && count > 1;
        if wrong_sides {
            seen = as_told;
            agree(cx.views, &mut seen);
            joints = meet(cx.views, &seen);
            self.exchanged = 0.0;
        }
        self.age += dt;
        self.unseen = 0.0;
        self.apart = if count > 1 { 0.0 } else { self.apart + dt };
        self.seen_by = seen.iter().map(Option::is_some).collect();
        self.doubted = self.doubted.filter(|_| count < 2);
        // Farther than anybody goes in a step.
        let elsewhere = mean_distance(&joints, &expected).is_some_and(|d| d > reach(0.0, dt));
        if !((wrong_sides || elsewhere) && self.restart(&seen, &joints, cx).is_some()) {
            self.follow(&seen, &joints, predicted, cx);
        }
        self.settle(&seen, &joints, dt);
        if count > 1 {
            let good: [Option<DVec3>; EVIDENCE_JOINTS] =
                std::array::from_fn(|j| joints.points[j].filter(|_| joints.costs[j] < MET));
            if cx.config.height.is_none() {
                self.build.update(skeleton, &good, &self.posed, dt);
            }
            if is_body(&joints.points) {
                self.proof[usize::from(count < 3)] += dt;
            }
        }
        let refresh = cx.config.identity.refresh;
        for (own, seen) in self.looks.iter_mut().zip(&seen) {
            own.pass(seen.as_ref(), dt, refresh);
        }
    }

    /// Lets `dt` seconds pass in which nobody saw them.
    pub fn coast(&mut self, dt: f64, cx: &Context<'_>) {
        let skeleton = Skeleton::builtin();
        self.pose = self.motion.coast(&self.pose, dt, cx.model);
        skeleton.clamp(&mut self.pose.angles);
        skeleton.pose(&self.pose, self.build.lengths(), &mut self.posed);
        self.age += dt;
        self.unseen += dt;
        self.apart += dt;
        self.states = [JointState::PREDICTED; BODY_JOINTS];
        for own in &mut self.looks {
            own.pass(None, dt, cx.config.identity.refresh);
        }
    }

    /// Difference of looks to somebody else as a share of the `most` that one person has, over views whose looks tell
    /// people apart; `None` where none does.
    pub fn unlike(&self, other: &Self, most: f64) -> Option<f64> {
        let both = self.looks.iter().zip(&other.looks);
        let each = both.filter_map(|(a, b)| {
            let (a, b) = (a.appearance.as_ref()?, b.appearance.as_ref()?);
            a.unlike(b, most)
        });
        let (sum, count) = each.fold((0.0, 0), |(s, n), d| (s + d, n + 1));
        (count > 0).then(|| sum / f64::from(count))
    }

    /// Takes over identity, proof, build and looks of somebody recognised who was gone for so many seconds: that they
    /// are here again is as good a proof as having been seen meanwhile.
    pub fn succeed(&mut self, old: Self, gone: f64) {
        self.id = old.id;
        self.turn = old.turn;
        for (own, old) in self.proof.iter_mut().zip(old.proof) {
            *own += old;
        }
        self.proof[1] += gone;
        self.age = self.age.max(old.age);
        self.build = old.build;
        for (own, old) in self.looks.iter_mut().zip(&old.looks) {
            own.succeed(old);
        }
    }

    /// Whether every number is finite.
    pub fn is_finite(&self) -> bool {
        self.pose.is_finite() && self.motion.is_finite()
    }

    /// The pose from these joints alone.
    fn restart(
        &mut self,
        seen: &[Option<Seen>],
        joints: &Joints3d,
        cx: &mut Context<'_>,
    ) -> Option<()> {
        if joints.points.iter().flatten().count() < LEAST_JOINTS {
            return None;
        }
        let skeleton = Skeleton::builtin();
        let hips = 0.5 * (joints.points[R_HIP]? + joints.points[L_HIP]?);
        joints.points[NECK]?;
        let pose = first_pose(skeleton, hips, &relative(joints, hips))?;
        let targets = self.targets(seen, pose, cx);
        let problem = Problem::new(skeleton, self.build.lengths(), &targets);
        let found = cx.solver.solve(&problem, &pose, Effort::COLD);
        if !found.pose.is_finite() {
            return None;
        }
        (self.pose, self.posed, self.motion) = (found.pose, found.posed, Motion::default());
        Some(())
    }

    /// The pose from the predicted one.
    fn follow(
        &mut self,
        seen: &[Option<Seen>],
        joints: &Joints3d,
        predicted: Pose,
        cx: &mut Context<'_>,
    ) {
        let mut targets = self.targets(seen, predicted, cx);
        targets.prior.weights = self.motion.weights(cx.model);
        let problem = Problem::new(Skeleton::builtin(), self.build.lengths(), &targets);
        let mut found = cx.solver.solve(&problem, &predicted, Effort::WARM);
        self.free_limbs(joints, &mut targets, &mut found, cx);
        if !found.pose.is_finite() {
            // The prediction is finite because every pose before it was.
            return;
        }
        let innovation = found.pose.step_from(&targets.prior.predicted);
        self.motion
            .correct(&innovation, &found.information, &targets.prior.weights);
        (self.pose, self.posed) = (found.pose, found.posed);
    }

    /// Tries the closed form on limbs that lie far from where rays meet, and keeps what brings them clearly nearer.
    fn free_limbs(
        &mut self,
        joints: &Joints3d,
        targets: &mut Targets,
        found: &mut Solution,
        cx: &mut Context<'_>,
    ) {
        let skeleton = Skeleton::builtin();
        for limb in LIMBS {
            let off = |j: usize, at: &Solution| {
                let met = joints.points[j].filter(|_| joints.costs[j] < MET);
                met.map_or(0.0, |p| p.distance(at.posed.joints[j]))
            };
            if off(limb.middle, found).max(off(limb.end, found)) < STUCK {
                continue;
            }
            let points = relative(joints, found.posed.joints[PELVIS]);
            let angles = &found.pose.angles;
            let Some(angles) = best_branch(skeleton, limb, &found.posed, &points, angles) else {
                continue;
            };
            let mut trial = targets.clone();
            let mut start = found.pose;
            for (k, angle) in limb.angles(skeleton).into_iter().zip(angles) {
                start.angles[k] = angle;
                trial.prior.free(k, angle);
            }
            let problem = Problem::new(skeleton, self.build.lengths(), &trial);
            let other = cx.solver.solve(&problem, &start, Effort::WARM);
            let nearer = off(limb.middle, &other) + off(limb.end, &other)
                < 0.6 * (off(limb.middle, found) + off(limb.end, found));
            if nearer && other.pose.is_finite() {
                for k in limb.angles(skeleton) {
                    trial.prior.predicted.angles[k] = other.pose.angles[k];
                    self.motion.restart(Dof::Angle(k));
                }
                (*targets, *found) = (trial, other);
            }
        }
    }

    fn targets(&self, seen: &[Option<Seen>], predicted: Pose, cx: &Context<'_>) -> Targets {
        let terms = &cx.config.terms;
        let views: Vec<ViewTarget> = cx
            .views
            .iter()
            .zip(seen)
            .filter_map(|(view, seen)| {
                let sight = &seen.as_ref()?.sight;
                let weight = terms.reprojection / terms.sigma2d.powi(2);
                Some(ViewTarget {
                    rotation: view.rotation,
                    position: view.position,
                    plane: sight
                        .rays
                        .map(|r| r.map_or_else(Default::default, |r| r.plane)),
                    weights: sight.rays.map(|r| r.map_or(0.0, |r| weight * r.confidence)),
                    depth: view.to_camera(predicted.position).z.max(0.3),
                })
            })
            .collect();
        let mut targets = Targets {
            views,
            in_space: InSpace::unknown(),
            prior: MotionPrior::without_prediction(predicted),
        };
        let told: Vec<&[DVec3; BODY_JOINTS]> = seen
            .iter()
            .flatten()
            .filter_map(|s| s.points3d.as_ref())
            .collect();
        if told.is_empty() {
            return targets;
        }
        let scale = self.build.stature() / f64::from(CANONICAL_STATURE) / told.len() as f64;
        for j in 0..BODY_JOINTS {
            targets.in_space.points[j] = told.iter().map(|p| p[j]).sum::<DVec3>() * scale;
            let share = if j < EVIDENCE_JOINTS {
                let known = targets.views.iter().filter(|v| v.weights[j] > 0.0).count();
                SHARE_3D[known.min(2)]
            } else {
                HIDDEN_3D
            };
            targets.in_space.weights[j] =
                terms.position * WEIGHTS_3D[j] * share / terms.sigma3d.powi(2);
        }
        targets
    }

    fn settle(&mut self, seen: &[Option<Seen>], joints: &Joints3d, dt: f64) {
        let share = (dt / 0.3).min(1.0);
        for (j, met) in joints.points.iter().enumerate() {
            if let Some(met) = met {
                let off = met.distance(self.posed.joints[j]).min(0.5);
                self.deviations[j] += share * (off - self.deviations[j]);
            }
        }
        for (state, through) in self.states.iter_mut().zip(SEEN_THROUGH) {
            let is_seen = seen
                .iter()
                .flatten()
                .any(|s| s.sight.rays[through].is_some());
            *state = if is_seen {
                JointState::OBSERVED
            } else {
                JointState::OCCLUDED
            };
        }
    }
}
