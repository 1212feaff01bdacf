//! Fitted bodies as the messages that every reader of bodies knows, in the calibration's world axes.
//!
//! Joints are the mesh body's; angles and bone rotations are those of the 29-degree skeleton laid into them.

use glam::{DQuat, DVec3};

use super::person::PersonFit;
use super::points;
use crate::body::BodyModel;
use crate::body::skeleton::{
    BoneLengths, Dof, Pose, Posed, Skeleton, bone_rotations, rotation_vector_near,
};
use crate::fit::{PoseEnergy, Posture, Problem, SEEN_THROUGH, first_pose};
use crate::joints::{BODY_JOINTS, PARENTS, PELVIS};
use crate::message::{Body, BodyState, JointState};
use crate::solve::{Effort, NormalEquations, Solver};

/// Joints of the skeleton that lie farther than this from the mesh body's, metres, may be of a pose beside the right
/// one.
const BESIDE: f64 = 0.1;
/// How sure a joint is that two views saw, one, or none, where Stage III does not tell.
const SURE: [f32; 3] = [0.95, 0.8, 0.5];

/// Where every joint should lie, metres: the energy is the sum of squared distances from there, square metres.
struct Places<'a>(&'a [DVec3; BODY_JOINTS]);

impl PoseEnergy for Places<'_> {
    fn cost(&self, _: &Pose, posed: &Posed) -> f64 {
        posed
            .joints
            .iter()
            .zip(self.0)
            .map(|(p, t)| p.distance_squared(*t))
            .sum()
    }

    fn linearise(&self, skeleton: &Skeleton, _: &Pose, posed: &Posed, out: &mut NormalEquations) {
        let rows = skeleton.elimination().rows();
        let mut columns: Vec<(usize, DVec3)> = Vec::new();
        for (j, target) in self.0.iter().enumerate() {
            let off = posed.joints[j] - *target;
            columns.clear();
            skeleton.jacobian(posed, j, |d, c| columns.push((rows[d], c)));
            for &(a, ca) in &columns {
                out.pull(a, ca.dot(off));
                for &(b, cb) in &columns {
                    if b <= a {
                        out.add(a, b, ca.dot(cb));
                    }
                }
            }
        }
    }
}

/// The skeleton, laid into one frame's joints after the other's.
struct Laying<'a> {
    skeleton: &'a Skeleton,
    lengths: &'a BoneLengths,
    solver: Solver,
    state: Posture,
    spare: Posture,
}

impl<'a> Laying<'a> {
    fn new(skeleton: &'a Skeleton, lengths: &'a BoneLengths) -> Self {
        Self {
            skeleton,
            lengths,
            solver: Solver::default(),
            state: Posture::default(),
            spare: Posture::default(),
        }
    }

    /// From where it lay, or, of who is turned like this and has not been seen just now, from rest; and where that ends
    /// beside, from the closed form of the limbs.
    fn lay(&mut self, targets: &[DVec3; BODY_JOINTS], turned: Option<DQuat>) -> &Posture {
        if let Some(rotation) = turned {
            self.state.pose = Pose {
                rotation,
                ..Pose::facing_camera(0.0)
            };
        }
        let iterations = if turned.is_some() { 60 } else { 12 };
        let off = self.solve(targets, iterations);
        if off > BESIDE {
            let before = self.state;
            let points = targets.map(|p| p - targets[PELVIS]);
            if let Some(pose) = first_pose(self.skeleton, targets[PELVIS], &points) {
                self.state.pose = pose;
                if self.solve(targets, 60) >= off {
                    self.state = before;
                }
            }
        }
        &self.state
    }

    /// Returns how far off the farthest joint is, metres.
    fn solve(&mut self, targets: &[DVec3; BODY_JOINTS], iterations: u32) -> f64 {
        let places = Places(targets);
        let problem = Problem::new(self.skeleton, self.lengths, &places);
        let effort = Effort {
            iterations,
            tolerance: 1e-6,
        };
        let state = &mut self.state;
        state.pose.position = targets[PELVIS];
        self.skeleton
            .pose(&state.pose, self.lengths, &mut state.posed);
        self.solver.solve(&problem, effort, state, &mut self.spare);
        let each = state.posed.joints.iter().zip(targets);
        each.map(|(p, t)| p.distance(*t)).fold(0.0, f64::max)
    }
}

/// One message body a frame of a person, with the frame's number. `stature` in metres, `rate` in frames a second.
pub fn bodies(person: &PersonFit, stature: f64, rate: f64) -> Vec<(usize, Body)> {
    let skeleton = Skeleton::builtin();
    if person.frames.is_empty() {
        return Vec::new();
    }
    let joints: Vec<[DVec3; BODY_JOINTS]> = person
        .frames
        .iter()
        .map(|f| points::all(&f.body.posed))
        .collect();
    let lengths = bone_lengths(&joints);
    let mut laying = Laying::new(skeleton, &lengths);
    let is_next = |k: usize| {
        let next = person.frames.get(k + 1);
        next.is_some_and(|next| next.frame == person.frames[k].frame + 1)
    };
    let mut out = Vec::with_capacity(joints.len());
    let mut turn = DVec3::ZERO;
    for (k, (f, targets)) in person.frames.iter().zip(&joints).enumerate() {
        let goes_on = k > 0 && is_next(k - 1);
        // The mesh body at rest looks along z with y up, as the skeleton does.
        let turned = (!goes_on).then_some(f.body.pose.rotations[0]);
        let state = laying.lay(targets, turned);
        let seen = SEEN_THROUGH.map(|j| {
            let sights = f.moment.sights.iter().flatten();
            sights.filter(|s| s.rays[j].is_some()).count()
        });
        let is_seen = seen.iter().any(|s| *s > 0);
        let confidence = match &f.moment.lifted {
            Some(lifted) => lifted.confidence,
            None => std::array::from_fn(|j| SURE[2 - seen[j].min(2)]),
        };
        turn = rotation_vector_near(state.pose.rotation, turn);
        // Over a pause nobody knows how fast they went.
        let near = [k - usize::from(goes_on), k + usize::from(is_next(k))];
        let span =
            (person.frames[near[1]].frame - person.frames[near[0]].frame).max(1) as f64 / rate;
        let velocity = (joints[near[1]][PELVIS] - joints[near[0]][PELVIS]) / span;
        let message = Body {
            id: person.id,
            state: match is_seen {
                true => BodyState::TRACKED,
                false => BodyState::PREDICTED,
            },
            position: targets[PELVIS].as_vec3().to_array(),
            orientation: state.pose.rotation.normalize().as_quat().to_array(),
            velocity: velocity.as_vec3().to_array(),
            angles: std::array::from_fn(|d| match Dof::of(d) {
                Dof::Position(axis) => targets[PELVIS][axis] as f32,
                Dof::Rotation(axis) => turn[axis] as f32,
                Dof::Angle(k) => state.pose.angles[k] as f32,
            }),
            joints3d: targets.map(|p| p.as_vec3().to_array()),
            score: confidence.iter().sum::<f32>() / BODY_JOINTS as f32,
            confidence,
            height: stature as f32,
            bone_lengths: std::array::from_fn(
                |j| if j == PELVIS { 0.0 } else { lengths[j] as f32 },
            ),
            bone_rotations: bone_rotations(&state.posed).map(|q| q.as_quat().to_array()),
            joint_states: std::array::from_fn(|j| match seen[j] {
                0 if is_seen => JointState::OCCLUDED,
                0 => JointState::PREDICTED,
                _ => JointState::OBSERVED,
            }),
            ..Body::default()
        };
        out.push((f.frame, message));
    }
    out
}

/// Mean distances between joints: the body's, apart from what a spine and shoulders bend.
fn bone_lengths(joints: &[[DVec3; BODY_JOINTS]]) -> BoneLengths {
    std::array::from_fn(|j| {
        let each = joints.iter().map(|p| p[j].distance(p[PARENTS[j]]));
        each.sum::<f64>() / joints.len() as f64
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::mesh::MeshPose;
    use crate::multiview::PersonFrame;
    use crate::multiview::prior::PosePrior;

    /// Somebody turned about y who holds up the right forearm.
    fn waving(frame: usize, turned: f64) -> PersonFrame {
        let mut rotations = PosePrior::shipped().mean();
        rotations[0] = DQuat::from_rotation_y(turned);
        rotations[17] = DQuat::from_rotation_z(-0.2);
        rotations[19] = DQuat::from_rotation_y(1.3) * DQuat::from_rotation_z(-1.8);
        let pose = MeshPose {
            pelvis: DVec3::new(0.2 * frame as f64, 0.9, 0.0),
            rotations,
        };
        PersonFrame::unseen(frame, pose)
    }

    #[test]
    fn angles_are_those_of_the_joints_from_the_first_frame_on_and_after_a_pause() {
        let half = std::f64::consts::PI;
        let turns = [(0, 0.0), (1, 0.1), (40, half), (41, half)];
        let person = PersonFit {
            id: 1,
            betas: vec![0.0; 10],
            frames: turns.map(|(frame, turned)| waving(frame, turned)).to_vec(),
        };
        let skeleton = Skeleton::builtin();
        for (frame, body) in bodies(&person, 1.7, 30.0) {
            let pose = Pose {
                position: DVec3::from(body.position.map(f64::from)),
                rotation: glam::Quat::from_array(body.orientation).as_dquat(),
                angles: std::array::from_fn(|d| f64::from(body.angles[Dof::Angle(d).number()])),
            };
            let mut posed = Posed::default();
            skeleton.pose(&pose, &body.bone_lengths.map(f64::from), &mut posed);
            let each = posed.joints.iter().zip(&body.joints3d);
            let off = each.map(|(p, j)| p.distance(DVec3::from(j.map(f64::from))));
            let off = off.fold(0.0, f64::max);
            assert!(off < 0.1, "frame {frame}: {off} m");
            // 0.2 m a frame before and after the pause.
            assert!((body.velocity[0] - 6.0).abs() < 0.02, "{:?}", body.velocity);
        }
    }

    #[test]
    fn rotation_vectors_follow_each_other_without_a_leap() {
        let half = std::f64::consts::PI;
        let turns = [half - 0.1, half + 0.1, half - 0.05];
        let frames = turns.into_iter().enumerate();
        let person = PersonFit {
            id: 1,
            betas: vec![0.0; 10],
            frames: frames.map(|(k, turned)| waving(k, turned)).collect(),
        };
        let found = bodies(&person, 1.7, 30.0);
        let vector =
            |k: usize| DVec3::from_array([3, 4, 5].map(|d| f64::from(found[k].1.angles[d])));
        for k in 1..turns.len() {
            let step = vector(k).distance(vector(k - 1));
            assert!(step < 0.5, "frame {k}: {step}");
        }
    }
}
